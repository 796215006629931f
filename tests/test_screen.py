"""What a study shows on the screen while it runs, from messages as Snakemake sends them."""

import io
import logging
import time
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
    time_now = SimpleNamespace(now=time.time())
    monkeypatch.setattr("time.time", lambda: time_now.now)
    return time_now


def display(monkeypatch, terminal=False, term="xterm", **changed):
    """A display and its screen. It looks at running jobs only when it is told to."""
    screen = Screen(terminal)
    monkeypatch.setenv("TERM", term)
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setattr("sys.stdout", screen)
    monkeypatch.setattr("threading.Thread", lambda **_: SimpleNamespace(start=lambda: None))
    usual = {"dryrun": False, "verbose": False, "debug_dag": False, "stdout": False}
    return LogHandler(SimpleNamespace(**usual | changed), None), screen


def send(handler, event=None, message="", level=logging.INFO, **more):
    record = logging.LogRecord("snakemake", level, "", 0, message, None, None)
    record.__dict__.update(more, **({"event": event} if event else {}))
    handler.handle(record)


def begin(handler, number, rule="simulate", log=(), first=0, at=None):
    seeds = {"first": str(first), "last": str(first + 99)} if rule == "simulate" else {}
    files = {"log": [str(log)] if log else [], "output": [f"file {number}"]}
    send(handler, LogEvent.JOB_INFO, jobid=number, rule_name=rule, wildcards=seeds, created=at or time.time(), **files)


STATS = {"simulate": 4, "aggregate": 1, "all": 1, "total": 6}


def start(handler, runs=400, seconds=None):
    """Announce the jobs of a study, of 100 runs each, and then their runs and expected times as the Snakefile does."""
    send(handler, LogEvent.RUN_INFO, "Job stats: ...", stats=STATS)
    seconds = seconds or {f"file {number}": 100.0 for number in range(1, 1 + runs // 100)}
    send(handler, message="brownpipe: the study", forecast=True, runs=runs, seconds=seconds)


def note(log, done, total=100):
    """Write in the log of a job what `progress.shown` writes there."""
    log.write_text(f"simulate: {done:,} of {total:,} runs, 1 s\n")


def last_line(screen):
    return screen.getvalue().rpartition("\r\033[K")[2]


def test_runs_are_counted_while_the_first_job_is_running(monkeypatch, clock, tmp_path):
    handler, screen = display(monkeypatch, terminal=True)
    start(handler, runs=7_200)
    logs = [tmp_path / "1.log", tmp_path / "2.log"]
    begin(handler, 1, log=logs[0])
    begin(handler, 2, log=logs[1])
    assert last_line(screen) == "simulate: 0 of 7,200 runs, 1 s"
    clock.now += 6.0
    note(logs[0], 50)
    note(logs[1], 10)
    handler.show()
    assert last_line(screen) == "simulate: 60 of 7,200 runs, 6 s, about 12 min to go"  # 6 s / 60 x 7,140
    send(handler, LogEvent.JOB_FINISHED, job_id=1)
    assert last_line(screen).startswith("simulate: 110 of 7,200 runs, ")


def test_the_time_left_follows_from_the_times_expected_of_the_jobs(monkeypatch, clock, tmp_path):
    """Of 100 s in all, 10 s were of the first job; by the number of runs, 4.5 s would be left."""
    handler, screen = display(monkeypatch, terminal=True)
    start(handler, runs=200, seconds={"file 1": 10.0, "file 2": 90.0})
    begin(handler, 1)
    begin(handler, 2, log=tmp_path / "2.log")
    clock.now += 5.0
    note(tmp_path / "2.log", 10)
    send(handler, LogEvent.JOB_FINISHED, job_id=1)
    assert last_line(screen) == "simulate: 110 of 200 runs, 5 s, about 21 s to go"  # 5 s / 19 x 81


def test_runs_of_an_earlier_study_do_not_count(monkeypatch, clock):
    handler, screen = display(monkeypatch, terminal=True)
    start(handler, runs=100)
    begin(handler, 1)
    clock.now += 3.0
    send(handler, LogEvent.JOB_FINISHED, job_id=1)
    begin(handler, 2)
    assert last_line(screen) == "simulate: 100 of 100 runs, 3 s"


def test_the_time_for_compiling_is_no_time_per_run(monkeypatch, clock, tmp_path):
    handler, screen = display(monkeypatch, terminal=True)
    start(handler)
    log = tmp_path / "1.log"
    line = "brownpipe: compiling the kernels for this kind of scene, once per machine: about 8 s"
    log.write_text(f"something else\n{line}\n")
    begin(handler, 1, log=log)
    handler.listen()
    handler.listen()
    assert screen.getvalue().count(line) == 1
    assert "something else" not in screen.getvalue()
    for seconds, done in ((50.0, 0), (10.0, 20), (10.0, 60)):
        clock.now += seconds
        note(log, done)
        handler.show()
    assert last_line(screen) == "simulate: 60 of 400 runs, 70 s, about 85 s to go"  # 10 s / 40 x 340


def test_without_a_terminal_a_stage_is_said_once_and_then_seldom(monkeypatch, clock):
    handler, screen = display(monkeypatch)
    start(handler)
    for number in range(3):
        begin(handler, number)
        send(handler, LogEvent.JOB_FINISHED, job_id=number)
    begin(handler, 3)
    assert screen.getvalue() == "brownpipe: the study\nsimulate: 0 of 400 runs, 1 s\n"
    clock.now += 29.0
    handler.show()
    assert screen.getvalue().count("\n") == 2
    clock.now += 2.0
    handler.show()
    assert "\nsimulate: 300 of 400 runs, 31 s" in screen.getvalue()
    assert screen.getvalue().count("\n") == 3


def test_a_dumb_terminal_gets_lines(monkeypatch, clock):
    handler, screen = display(monkeypatch, terminal=True, term="dumb")
    start(handler)
    begin(handler, 1)
    handler.close()
    assert screen.getvalue() == "brownpipe: the study\nsimulate: 0 of 400 runs, 1 s\n"


def test_nothing_is_written_while_the_answer_is_printed(monkeypatch):
    handler, screen = display(monkeypatch, terminal=True)
    send(handler, LogEvent.RUN_INFO, stats=STATS)
    begin(handler, 1, "all")
    handler.show()
    assert screen.getvalue().replace("\r\033[K", "") == ""


@pytest.mark.parametrize("message", ["Building DAG of jobs...", "Select jobs to execute...", "Complete log(s): x"])
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


def test_messages_that_are_not_known_are_shown(monkeypatch):
    handler, screen = display(monkeypatch)
    send(handler, message="Unlocked working directory.")
    assert screen.getvalue() == "Unlocked working directory.\n"


def test_a_dry_run_is_shown_as_snakemake_has_it(monkeypatch):
    handler, screen = display(monkeypatch, dryrun=True)
    send(handler, message="Building DAG of jobs...")
    send(handler, LogEvent.RUN_INFO, "Job stats", stats=STATS)
    assert screen.getvalue() == "Building DAG of jobs...\nJob stats\n"


def test_a_failed_job_is_explained_at_the_end(monkeypatch, tmp_path):
    handler, screen = display(monkeypatch)
    log = tmp_path / "1.log"
    log.write_text("brownpipe: no\n")
    send(handler, LogEvent.RUN_INFO, stats=STATS)
    begin(handler, 1)
    told = {"rule_name": "simulate", "shellcmd": "brownpipe simulate x.yaml", "log": [str(log)], "jobid": 1}
    send(handler, LogEvent.JOB_ERROR, "Error in rule simulate", logging.ERROR, **told)
    send(handler, message="Complete log(s): y")
    handler.close()
    explained = "brownpipe: the rule simulate failed: brownpipe simulate x.yaml\n    brownpipe: no\n"
    assert screen.getvalue().endswith(f"Complete log(s): y\n{explained}")


def test_after_an_interruption_no_job_is_blamed(monkeypatch):
    handler, screen = display(monkeypatch)
    send(handler, message="Terminating processes on user request, this might take some time.")
    told = {"rule_name": "simulate", "shellcmd": "brownpipe simulate x.yaml", "log": [], "jobid": 1}
    send(handler, LogEvent.JOB_ERROR, "Error in rule simulate", logging.ERROR, **told)
    handler.close()
    assert screen.getvalue().splitlines()[1:] == ["brownpipe: interrupted; the same command goes on from here"]


def test_several_rules_at_once(monkeypatch, clock):
    handler, screen = display(monkeypatch, terminal=True)
    start(handler)
    begin(handler, 1, "tradeoff", at=clock.now)
    clock.now += 2.0
    begin(handler, 2, "aggregate", at=clock.now)
    clock.now += 3.4
    handler.show()
    assert last_line(screen) == "aggregate: 3 s; tradeoff: 5 s"


def test_other_errors_are_shown_as_they_are(monkeypatch):
    handler, screen = display(monkeypatch)
    send(handler, LogEvent.ERROR, "IncompleteFilesException: ...", logging.ERROR)
    assert screen.getvalue() == "IncompleteFilesException: ...\n"


def test_a_job_that_failed_and_was_run_again_is_no_failure(monkeypatch):
    handler, screen = display(monkeypatch)
    begin(handler, 7)
    error = {"rule_name": "simulate", "shellcmd": "brownpipe simulate", "log": [], "jobid": 7}
    send(handler, LogEvent.JOB_ERROR, "Error in rule simulate", logging.ERROR, **error)
    send(handler, message="Trying to restart job 7.")
    begin(handler, 7)
    send(handler, LogEvent.JOB_FINISHED, job_id=7)
    handler.close()
    assert "Trying to restart job 7.\n" in screen.getvalue()
    assert "the rule simulate failed" not in screen.getvalue()


def test_a_job_that_failed_in_every_attempt_is_explained_once_with_what_the_queue_said(monkeypatch):
    handler, screen = display(monkeypatch)
    said = "SLURM sbatch failed. 'invalid partition\x1b[2J: long'."
    for number in (7, 8, 7):
        begin(handler, number)
        error = {"rule_name": "simulate", "shellcmd": "brownpipe simulate", "log": [], "jobid": number}
        send(handler, LogEvent.JOB_ERROR, "Error in rule simulate", logging.ERROR, rule_msg=said, **error)
    handler.close()
    explained = "brownpipe: the rule simulate failed: brownpipe simulate\n    SLURM sbatch failed. "
    explained += "'invalid partition\\x1b[2J: long'.\n"
    assert screen.getvalue().endswith("\n" + 2 * explained) and screen.getvalue().count(explained) == 2


def test_of_a_cluster_only_what_concerns_the_user_is_shown(monkeypatch):
    handler, screen = display(monkeypatch)
    send(handler, message="SLURM run ID: 4fd69280")
    send(handler, message="Job 8 has been submitted with SLURM jobid 2 (log: /a/2.log).")
    send(handler, message="Unable to guess SLURM account. Trying to proceed without.", level=logging.WARNING)
    assert screen.getvalue() == ""
    send(handler, message="Guessed SLURM account: physics", level=logging.WARNING)
    assert screen.getvalue() == "Guessed SLURM account: physics\n"


@pytest.mark.parametrize("terminal", [False, True])
def test_nothing_is_coloured(terminal, monkeypatch):
    """On a terminal the line of progress is erased before the next one; no other control sequence is written."""
    handler, screen = display(monkeypatch, terminal=terminal)
    send(handler, LogEvent.RUN_INFO, stats=STATS)
    begin(handler, 1)
    send(handler, LogEvent.JOB_ERROR, rule_name="simulate", shellcmd="brownpipe simulate", log=[], jobid=1)
    send(handler, LogEvent.ERROR, "LockException: ...", logging.ERROR)
    send(handler, None, "a warning", logging.WARNING)
    handler.close()
    text = screen.getvalue()
    assert "a warning" in text and "the rule simulate failed" in text
    assert ("\r\033[K" in text) == terminal
    assert "\033" not in text.replace("\r\033[K", "")


@pytest.mark.parametrize("verbose", [False, True])
def test_no_control_character_of_others_reaches_the_terminal(monkeypatch, clock, tmp_path, verbose):
    codes = "\x1b]0;title\x07\x9b2J\u202e\b\r\udcff"
    (tmp_path / "log").write_bytes(b"brownpipe: compiling \x1b[2J\xff\r\x9b\nbrownpipe: second\x07\n")
    handler, screen = display(monkeypatch, terminal=True, verbose=verbose)
    start(handler)
    begin(handler, 1, log=tmp_path / "log")
    handler.listen()
    handler.show()
    send(handler, message=f"a warning {codes}", level=logging.WARNING)
    send(handler, message=f"LockException {codes}", level=logging.ERROR)
    command = f"brownpipe simulate 'a\ncurl{codes}'"
    send(handler, LogEvent.JOB_ERROR, rule_name="simulate", shellcmd=command, log=[str(tmp_path / "log")], jobid=1)
    handler.close()
    shown = screen.getvalue().replace("\r\033[K", "")
    assert "warning" in shown and (verbose or "second" in shown)
    assert [char for char in shown if char != "\n" and not char.isprintable()] == []
    assert [line for line in shown.splitlines() if line.startswith("curl")] == []
