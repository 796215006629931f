"""What a study shows on the screen while it runs, from messages as Snakemake sends them."""

import io
import logging
from types import SimpleNamespace

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

from snakemake_logger_plugin_brownpipe import LogHandler


class Screen(io.StringIO):
    """A terminal, or not."""

    def __init__(self, terminal):
        super().__init__()
        self.terminal = terminal

    def isatty(self):
        return self.terminal


@pytest.fixture
def clock(monkeypatch):
    """The time of the display, in its attribute `now` [s]."""
    time_now = SimpleNamespace(now=1000.0)
    monkeypatch.setattr("time.monotonic", lambda: time_now.now)
    return time_now


def display(monkeypatch, terminal=False, term="xterm", **changed):
    """A display and its screen. It looks at running jobs only when it is told to."""
    screen = Screen(terminal)
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
    """Announce the runs of a study, 100 in each job, and the times expected of the jobs, as the Snakefile does."""
    seconds = seconds or {f"file {number}": 100.0 for number in range(1, 1 + runs // 100)}
    send(handler, message="brownpipe: the study", runs=dict.fromkeys(seconds, 100), seconds=seconds)


def note(log, done, total=100):
    """Write in the log of a job what `progress.shown` writes there."""
    log.write_text(f"simulate: {done:,} of {total:,} runs, 1 s\n")


def last_line(screen):
    return screen.getvalue().rpartition("\r")[2].rstrip()


def test_runs_are_counted_while_the_first_job_is_running(monkeypatch, clock, tmp_path):
    handler, screen = display(monkeypatch, terminal=True)
    start(handler, runs=7_200)
    logs = [tmp_path / "1.log", tmp_path / "2.log"]
    begin(handler, 1, log=logs[0])
    begin(handler, 2, log=logs[1])
    handler.look()
    clock.now += 6.0
    note(logs[0], 50)
    note(logs[1], 10)
    handler.look()
    assert last_line(screen) == "simulate: 60 of 7,200 runs, 6 s, about 12 min to go"  # 6 s / 60 x 7,140
    send(handler, LogEvent.JOB_FINISHED, job_id=1)
    clock.now += 1.0
    handler.look()
    assert last_line(screen).startswith("simulate: 110 of 7,200 runs, ")


def test_the_time_left_follows_from_the_times_expected_of_the_jobs(monkeypatch, clock, tmp_path):
    """Of 100 s in all, 10 s were of the first job; by the number of runs, 4.5 s would be left."""
    handler, screen = display(monkeypatch, terminal=True)
    start(handler, seconds={"file 1": 10.0, "file 2": 90.0})
    begin(handler, 1)
    begin(handler, 2, log=tmp_path / "2.log")
    handler.look()
    clock.now += 1.0
    note(tmp_path / "2.log", 10)
    send(handler, LogEvent.JOB_FINISHED, job_id=1)
    clock.now += 4.0
    handler.look()
    assert last_line(screen) == "simulate: 110 of 200 runs, 5 s, about 21 s to go"  # 5 s / 19 x 81




def test_a_remark_of_jobs_is_shown_once(monkeypatch, clock, tmp_path):
    handler, screen = display(monkeypatch, terminal=True)
    line = "brownpipe: compiling the kernels for this kind of scene, once per machine: about 8 s"
    (tmp_path / "1.log").write_text(f"something else\n{line}\n")
    for number in (1, 2):
        begin(handler, number, log=tmp_path / "1.log")
        handler.look()
    assert screen.getvalue() == f"{line}\n"


@pytest.mark.parametrize(("terminal", "term"), [(False, "xterm"), (True, "dumb")])
def test_without_a_terminal_there_is_a_line_every_half_a_minute(monkeypatch, clock, terminal, term):
    handler, screen = display(monkeypatch, terminal, term)
    start(handler)
    begin(handler, 4)
    handler.look()
    for number in range(1, 4):
        begin(handler, number)
        send(handler, LogEvent.JOB_FINISHED, job_id=number)
    for _ in range(59):
        clock.now += 1.0
        handler.look()
    lines = ["brownpipe: the study", "simulate: 300 of 400 runs, 30 s, about 10 s to go"]
    assert screen.getvalue().splitlines() == lines




@pytest.mark.parametrize(
    "message", ["Building DAG of jobs...", "Complete log(s): x", "brownpipe: the study: 0 runs in 0"]
)
def test_chatter_is_left_out(monkeypatch, message):
    handler, screen = display(monkeypatch)
    send(handler, message=message)
    assert screen.getvalue() == ""


@pytest.mark.parametrize("level", [logging.WARNING, logging.ERROR])
@pytest.mark.parametrize("event", [None, LogEvent.ERROR])
def test_no_warning_and_no_error_is_left_out(monkeypatch, level, event):
    handler, screen = display(monkeypatch)
    send(handler, event, "The DAG went wrong", level)
    assert screen.getvalue() == "The DAG went wrong\n"




def test_a_dry_run_is_shown_as_snakemake_has_it(monkeypatch):
    handler, screen = display(monkeypatch, dryrun=True)
    send(handler, message="Building DAG of jobs...")
    send(handler, LogEvent.RUN_INFO, "Job stats")
    assert screen.getvalue() == "Building DAG of jobs...\nJob stats\n"


def test_a_failed_job_is_explained_at_the_end(monkeypatch, tmp_path):
    handler, screen = display(monkeypatch)
    log = tmp_path / "1.log"
    log.write_text("brownpipe: compiling\nsimulate: 10 of 100 runs (10 %), 30 s\nbrownpipe: no\n")
    begin(handler, 1, log=log)
    fail(handler, 1, log=log)
    send(handler, message="Complete log(s): y")
    handler.close()
    explained = "brownpipe: the rule simulate failed: brownpipe simulate x.yaml\n    brownpipe: no\n"
    assert screen.getvalue() == f"Complete log(s): y\n{explained}"


@pytest.mark.parametrize("said", ["", "brownpipe: compiling\nsimulate: 10 of 100 runs (10 %), 30 s\n"])
def test_of_a_job_that_ended_without_a_message_the_likely_reason_is_said(monkeypatch, tmp_path, said):
    handler, screen = display(monkeypatch)
    (tmp_path / "log").write_text(said)
    fail(handler, 1, log=tmp_path / "log")
    send(handler, LogEvent.ERROR, 'RuleException:\nCalledProcessError in file "Snakefile", line 3', logging.ERROR)
    handler.close()
    command, reason = screen.getvalue().splitlines()
    assert reason.startswith("    brownpipe: killed, most likely out of memory; ") and "failed" in command




def test_after_an_interruption_no_job_is_blamed(monkeypatch):
    handler, screen = display(monkeypatch)
    send(handler, message="Terminating processes on user request, this might take some time.")
    fail(handler, 1)
    handler.close()
    assert screen.getvalue().splitlines()[1:] == ["brownpipe: interrupted; the same command goes on from here"]






def test_a_job_that_failed_and_was_run_again_is_no_failure(monkeypatch):
    handler, screen = display(monkeypatch)
    begin(handler, 7)
    fail(handler, 7)
    send(handler, message="Trying to restart job 7.")
    begin(handler, 7)
    send(handler, LogEvent.JOB_FINISHED, job_id=7)
    handler.close()
    assert screen.getvalue() == "Trying to restart job 7.\n"


def test_a_job_that_failed_in_every_attempt_is_explained_once_with_what_the_queue_said(monkeypatch):
    handler, screen = display(monkeypatch)
    for number in (7, 8, 7):
        begin(handler, number)
        fail(handler, number, rule_msg="SLURM sbatch failed. 'invalid partition\x1b[2J: long'.")
    handler.close()
    explained = "brownpipe: the rule simulate failed: brownpipe simulate x.yaml\n    SLURM sbatch failed. "
    explained += "'invalid partition\\x1b[2J: long'.\n"
    assert screen.getvalue() == 2 * explained


def test_of_a_cluster_submitted_jobs_are_not_shown(monkeypatch):
    handler, screen = display(monkeypatch)
    send(handler, message="SLURM run ID: 4fd69280")
    send(handler, message="Job 8 has been submitted with SLURM jobid 2 (log: /a/2.log).")
    assert screen.getvalue() == ""
    send(handler, message="Guessed SLURM account: physics", level=logging.WARNING)
    assert screen.getvalue() == "Guessed SLURM account: physics\n"


@pytest.mark.parametrize("verbose", [False, True])
def test_no_control_character_of_others_reaches_the_terminal(monkeypatch, clock, tmp_path, verbose):
    codes = "\x1b]0;title\x07\x9b2J\u202e\b\r\udcff"
    (tmp_path / "log").write_bytes(b"brownpipe: compiling \x1b[2J\xff\r\x9b\nbrownpipe: second\x07\n")
    handler, screen = display(monkeypatch, terminal=True, verbose=verbose)
    start(handler)
    begin(handler, 1, log=tmp_path / "log")
    handler.look()
    send(handler, message=f"a warning {codes}", level=logging.WARNING)
    send(handler, message=f"LockException {codes}", level=logging.ERROR)
    fail(handler, 1, log=tmp_path / "log", command=f"brownpipe simulate 'a\ncurl{codes}'")
    handler.close()
    shown = screen.getvalue()
    assert "warning" in shown and (verbose or "second" in shown)
    assert [char for char in shown if char != "\n" and not char.isprintable()] == []
    assert [line for line in shown.splitlines() if line.startswith("curl")] == []
