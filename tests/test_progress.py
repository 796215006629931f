"""How much of a long calculation is done: what is reported, and what a terminal or a log shows of
it.
"""

import io
import logging
import multiprocessing
import os
import signal
import sys
import termios
from types import SimpleNamespace

import numpy as np
import pytest
from snakemake_interface_logger_plugins.common import LogEvent

from brownpipe import analysis, progress
from brownpipe.engines import engine_of_request
from brownpipe.engines.exact import run as exact_run
from brownpipe.engines.timestep import simulation as timestep
from brownpipe.errors import RequestError, RunError
from brownpipe.processes import calculated
from brownpipe.storage.trajectories import write_trajectories
from scenes import PERIODIC, box, mixture
from snakemake_logger_plugin_brownpipe import LogHandler
from synthetic import render

SCENE = mixture(box(6, 6, PERIODIC), [(1, 0.6, 9), (30, 0.25, 1)], 4.0).replace(equilibrate=4.0)
EXACT = engine_of_request("exact", {})
STEPS = engine_of_request("timestep", {"time_step": 0.01})


@pytest.fixture
def reported(monkeypatch):
    """The stages that are reported during the test: unit, done and total."""
    found = []
    monkeypatch.setattr(progress, "listeners", [lambda *stage: found.append(stage)])
    return found


# -- what is reported ------------------------------------------------------------------------------


def test_what_is_reported_within_a_piece_is_a_fraction_of_it(reported):
    for _ in progress.tracked("ab", "cases"):
        for _ in progress.tracked("cd", "engines"):
            progress.report("runs", 1, 2)
    assert reported == [
        ("cases", case + share, 2) for case in (0, 1) for share in (0.25, 0.5, 0.75, 1, 1)
    ]


def test_a_killed_process_is_said_and_its_work_not_done_again():
    def halved(item):
        assert multiprocessing.parent_process(), "the parent is the next to be killed"
        if item == 5:
            os.kill(os.getpid(), signal.SIGKILL)
        return item / 2

    with pytest.raises(RunError, match="one of 3 processes was killed, most likely out of memory"):
        calculated(halved, range(9), "pieces", 3)


@pytest.mark.parametrize(
    "error", [RequestError("disks: no"), MemoryError(), ZeroDivisionError("by 0")], ids=repr
)
def test_an_error_of_a_process_is_raised_and_its_work_not_done_again(error):
    def fail(item):
        assert multiprocessing.parent_process()
        if item >= 2:
            raise error
        return item

    with pytest.raises(type(error)) as raised:
        calculated(fail, range(7), "pieces", 2)
    assert str(raised.value) == str(error)


def test_where_processes_are_not_forked_this_one_does_the_work(reported, monkeypatch):
    """As on macOS, where every other process would be started from the user's own script."""
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(multiprocessing, "get_context", None)
    assert calculated(lambda item: (item, os.getpid()), range(3), "pieces", 2) == [
        (item, os.getpid()) for item in range(3)
    ]
    assert reported == [("pieces", done, 3) for done in (1, 2, 3)]


@pytest.mark.parametrize("engine", [EXACT, STEPS], ids=lambda engine: engine.name)
def test_a_run_is_reported_by_simulated_time_and_stays_the_same(engine, monkeypatch):
    before = engine.simulate(SCENE, [3, 4], {"tracer"}).tracer.position
    monkeypatch.setattr(exact_run, "EVENTS_PER_CALL", 60)
    monkeypatch.setattr(timestep, "DISK_STEPS_PER_CALL", 31 * 39)
    found = []
    monkeypatch.setattr(progress, "listeners", [lambda *stage: found.append(stage)])
    assert engine.simulate(SCENE, [3, 4], {"tracer"}).tracer.position.tobytes() == before.tobytes()
    assert {(unit, total) for unit, _, total in found} == {("runs", 2)}
    done = np.array([done for _, done, _ in found])
    inside = done % 1
    assert np.all(np.diff(done) >= 0)
    assert {1.0, 2.0} <= set(done)
    assert done[0] < 0.2
    assert (
        np.count_nonzero((inside > 0) & (inside < 0.5)) > 2 < np.count_nonzero(inside > 0.5)
    )  # half equilibrates


@pytest.mark.slow
def test_analysis_reports_files_and_then_cases(reported, tmp_path):
    write_trajectories(
        tmp_path / "runs.h5", SCENE, EXACT, EXACT.simulate(SCENE, range(12), {"tracer"})
    )
    dataset = analysis.aggregate([tmp_path / "runs.h5"])
    assert reported[-3:] == [("files verified", 1, 1), ("cases", 1.0, 1), ("cases", 1, 1)]
    reported.clear()
    render(dataset, tmp_path, ["health", "msd"])
    assert reported == [("figures", 1, 2), ("figures", 2, 2)]


# -- the screen of one command ---------------------------------------------------------------------


@pytest.fixture
def clock(monkeypatch):
    """The time of the display, in its attribute `now` [s]."""
    clock = SimpleNamespace(now=1000.0)
    monkeypatch.setattr("time.monotonic", lambda: clock.now)
    return clock


def test_a_log_has_a_line_every_half_a_minute(clock, capsys):
    with progress.shown("aggregate"):
        for runs in range(71):
            progress.report("runs", runs, 1000)
            clock.now += 1.0
    out, err = capsys.readouterr()
    assert out == ""
    said = "aggregate: {} of 1,000 runs ({} %), {} s, about 16 min to go"
    assert err.splitlines() == [said.format(30, 3, 30), said.format(60, 6, 60)]


def test_a_line_is_cut_to_the_width_of_a_terminal(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    ours, theirs = os.openpty()
    termios.tcsetwinsize(theirs, (24, 40))
    with open(theirs, "w") as terminal, monkeypatch.context() as patch:
        patch.setattr("sys.stderr", terminal)
        patch.setattr(progress, "DELAY", 0.0)
        progress.Display().update("aggregate: 3 of 1,000 runs, more than fits", 3, 1000)
    assert os.read(ours, 80) == b"\raggregate: 3 of 1,000 runs, more than f"


@pytest.mark.parametrize(
    ("reports", "total", "left"),
    [
        # 5 were done before, as the runs of a checkpoint: they took no time
        ((5, 6, 8), 20, 12 / 2),
        ((0, 0, 0, 1, 2), 10, 8.0),  # kernels were compiled, or another job had the processor
        ((0, 0, 0, 1), 10, None),
        ((0.5, 5, 6, 0.2, 1.2, 2.2), 10, 7.8),  # begun again
        ((1, 10), 10, None),
    ],
)
def test_the_time_left_follows_from_the_pace_since_the_first_progress_of_the_stage(
    clock, capsys, reports, total, left
):
    display = progress.Display()
    for done in reports:
        display.due = clock.now = clock.now + 1.0
        display.update("x", done, total)
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == f"x, {len(reports)} s" + (f", about {left:.0f} s to go" if left else "")


# -- the screen of a study: messages as Snakemake sends them ---------------------------------------


def display(monkeypatch, terminal=False, term="xterm", **changed):
    """A display and its screen. It looks at running jobs only when it is told to."""
    screen = io.StringIO()
    screen.isatty = lambda: terminal
    monkeypatch.setenv("TERM", term)
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setattr("threading.Thread", lambda **_: SimpleNamespace(start=lambda: None))
    usual = {"dryrun": False, "verbose": False, "debug_dag": False}
    return LogHandler(SimpleNamespace(**usual | changed), None), screen


def send(handler, event=None, message="", level=logging.INFO, **more):
    record = logging.LogRecord("snakemake", level, "", 0, message, None, None)
    record.__dict__.update(more, **({"event": event} if event else {}))
    handler.handle(record)


def begin(handler, number, rule="simulate", log="log"):
    files = {"log": [str(log)] if log else [], "output": [f"file {number}"]}
    send(handler, LogEvent.JOB_INFO, jobid=number, rule_name=rule, **files)


def fail(handler, number, log="log", command="brownpipe simulate x.yaml", **more):
    told = {"rule_name": "simulate", "shellcmd": command, "log": [str(log)], "jobid": number}
    send(handler, LogEvent.JOB_ERROR, "Error in rule simulate", logging.ERROR, **told | more)


def start(handler, runs=400, seconds=None):
    """Announce the runs of a study, 100 in each job, and the times expected of the jobs, as the
    Snakefile does.
    """
    seconds = seconds or {f"file {number}": 100.0 for number in range(1, 1 + runs // 100)}
    send(handler, message="brownpipe: the study", runs=dict.fromkeys(seconds, 100), seconds=seconds)


def last_line(screen):
    return screen.getvalue().rpartition("\r")[2].rstrip()


def test_the_time_left_follows_from_expected_times_and_remarks_are_shown_once(
    monkeypatch, clock, tmp_path
):
    """Of 100 s in all, 10 s were of the first job; by the number of runs, 4.5 s would be left."""
    handler, screen = display(monkeypatch, terminal=True)
    start(handler, seconds={"file 1": 10.0, "file 2": 90.0})
    remark = "brownpipe: compiling the kernels for this kind of scene, once per machine: about 8 s"
    for number in (1, 2):
        begin(handler, number, log=tmp_path / f"{number}.log")
        (tmp_path / f"{number}.log").write_text(f"something else\n{remark}\n")
        handler.look()
    assert screen.getvalue().count(f"{remark}\n") == 1
    clock.now += 1.0
    (tmp_path / "2.log").write_text("simulate: 10 of 100 runs, 1 s\n")
    send(handler, LogEvent.JOB_FINISHED, job_id=1)
    clock.now += 4.0
    handler.look()
    assert last_line(screen) == "simulate: 110 of 200 runs, 5 s, about 32 s to go"  # 4 s / 10 x 81


def test_what_an_earlier_attempt_left_in_the_log_of_a_job_is_not_shown(monkeypatch, tmp_path):
    """A study that goes on said `brownpipe: interrupted` until its first job had begun its log."""
    handler, screen = display(monkeypatch)
    log = tmp_path / "1.log"
    log.write_text("simulate: 90 of 100 runs, 9 s\nbrownpipe: interrupted\n")
    start(handler, runs=100)
    begin(handler, 1, log=log)
    handler.look()
    assert handler.shares == {} and "interrupted" not in screen.getvalue()
    log.write_text("brownpipe: a caution\nsimulate: 10 of 100 runs, 1 s\n")
    handler.look()
    assert handler.shares == {"file 1": 0.1} and "brownpipe: a caution\n" in screen.getvalue()


def test_only_jobs_that_failed_in_every_attempt_are_explained_and_none_after_an_interruption(
    monkeypatch,
):
    handler, screen = display(monkeypatch)
    for number in (7, 8, 9, 7, 9):
        begin(handler, number)
        fail(handler, number, rule_msg="SLURM sbatch failed. 'invalid partition\x1b[2J: long'.")
    begin(handler, 9)
    send(handler, LogEvent.JOB_FINISHED, job_id=9)
    handler.close()
    explained = (
        "brownpipe: the rule simulate failed: brownpipe simulate x.yaml\n    SLURM sbatch failed. "
    )
    explained += "'invalid partition\\x1b[2J: long'.\n"
    assert screen.getvalue() == 2 * explained
    handler, screen = display(monkeypatch)
    send(handler, message="Terminating processes on user request, this might take some time.")
    fail(handler, 1)
    handler.close()
    assert screen.getvalue().splitlines()[1:] == [
        "brownpipe: interrupted; the same command goes on from here"
    ]


WARNING = logging.WARNING
ERROR = logging.ERROR


@pytest.mark.parametrize(
    ("message", "more", "shown"),
    [
        ("Building DAG of jobs...", {}, False),
        ("brownpipe: the study: 0 runs in 0", {}, False),
        ("Job 8 has been submitted with SLURM jobid 2 (log: /a/2.log).", {}, False),
        ("Guessed SLURM account: physics", {"level": WARNING}, True),
        ("The DAG went wrong", {"event": LogEvent.ERROR, "level": ERROR}, True),
    ],
)
def test_chatter_is_left_out_and_no_warning_and_no_error(monkeypatch, message, more, shown):
    handler, screen = display(monkeypatch)
    send(handler, message=message, **more)
    assert screen.getvalue() == (f"{message}\n" if shown else "")
    handler, screen = display(monkeypatch, dryrun=True)
    send(handler, message=message, **more)
    assert screen.getvalue() == f"{message}\n"


RUNNING = "brownpipe: compiling\nsimulate: 10 of 100 runs (10 %), 30 s\n"
EXIT = "CalledProcessError in file {}:\nCommand 'bash -c x' {}"
NO_LETTER = "UnicodeEncodeError in file {}:\n'ascii' codec can't encode character '\\u03b7'"


@pytest.mark.parametrize(
    ("log", "exception", "reason"),
    [
        (RUNNING + "brownpipe: no\n", EXIT.format("a", "returned non-zero exit status 1."), "no"),
        ("", EXIT.format("a", "returned non-zero exit status 137."), "killed, most likely out of "),
        (RUNNING, EXIT.format("a", "died with <Signals.SIGKILL: 9>."), "killed, most likely"),
        (RUNNING, "", "ended without a message; Snakemake's own are in its log"),
        ("", NO_LETTER.format("b"), NO_LETTER.format("b")),
        ("", EXIT.format("c", "returned non-zero exit status 2."), EXIT.format("c", "returned")),
    ],
)
def test_a_failed_job_is_explained_at_the_end(monkeypatch, tmp_path, log, exception, reason):
    """That it was killed only if it was; what Snakemake knows if the job itself left nothing."""
    handler, screen = display(monkeypatch)
    (tmp_path / "log").write_text(log)
    begin(handler, 1, log=tmp_path / "log")
    if exception:
        send(handler, LogEvent.ERROR, f"RuleException:\n{exception}", ERROR)
    fail(handler, 1, log=tmp_path / "log")
    handler.close()
    command, *explained = screen.getvalue().splitlines()
    assert command == "brownpipe: the rule simulate failed: brownpipe simulate x.yaml"
    lines = "\n".join(line.strip() for line in explained)
    assert lines.removeprefix("brownpipe: ").startswith(reason)


RELAYED = """
import sys
from brownpipe.progress import give_reason
print(1, file=sys.stderr)
give_reason("first")
give_reason("last")
sys.exit(3)
"""


def test_what_a_command_says_is_passed_on_with_its_last_reason(capsys):
    assert progress.relayed([sys.executable, "-c", RELAYED]) == (3, "last")
    assert progress.relayed([sys.executable, "-c", ""]) == (0, "")
    assert capsys.readouterr().err == "1\n"


def test_a_workflow_gives_the_reason_of_a_failed_job(monkeypatch, tmp_path):
    """`bp.run` raises an error with it."""
    monkeypatch.setenv(progress.REASON, str(tmp_path / "reason"))
    handler, _ = display(monkeypatch)
    (tmp_path / "log").write_text("brownpipe: 0-5.h5: is damaged\n")
    begin(handler, 1, log=tmp_path / "log")
    fail(handler, 1, log=tmp_path / "log")
    handler.close()
    assert (tmp_path / "reason").read_text() == "0-5.h5: is damaged"
