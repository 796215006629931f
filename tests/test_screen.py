"""What a study shows on the screen while it runs, from messages as Snakemake sends them."""

import io
import json
import logging
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from snakemake_interface_common.exceptions import WorkflowError
from snakemake_interface_logger_plugins.common import LogEvent

from brownpipe.progress import NOTES
from snakemake_logger_plugin_brownpipe import LogHandler, configfiles


class Screen(io.StringIO):
    """A terminal, or not."""

    def __init__(self, terminal):
        super().__init__()
        self.terminal = terminal

    def isatty(self):
        return self.terminal


@pytest.fixture(autouse=True)
def notes(monkeypatch, tmp_path):
    """The folder in which jobs note their progress."""
    folder = tmp_path / "notes"
    folder.mkdir()
    monkeypatch.setenv(NOTES, str(folder))
    return folder


@pytest.fixture
def clock(monkeypatch):
    """The time of the display, in its attribute `now` [s]."""
    time_now = SimpleNamespace(now=time.monotonic())
    monkeypatch.setattr("time.monotonic", lambda: time_now.now)
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


def begin(handler, number, rule="simulate", log=(), first=0):
    seeds = {"first": str(first), "last": str(first + 99)} if rule == "simulate" else {}
    files = {"log": [str(log)] if log else [], "output": [f"file {number}"]}
    send(handler, LogEvent.JOB_INFO, jobid=number, rule_name=rule, wildcards=seeds, **files)


STATS = {"simulate": 4, "aggregate": 1, "all": 1, "total": 6}


def start(handler, runs=400, seconds=None):
    """Announce the jobs of a study, of 100 runs each, and then their runs and expected times as the Snakefile does."""
    send(handler, LogEvent.RUN_INFO, "Job stats: ...", stats=STATS)
    seconds = seconds or {f"file {number}": 100.0 for number in range(1, 1 + runs // 100)}
    send(handler, message="brownpipe: the study", forecast=True, runs=runs, seconds=seconds)


def note(notes, job, done, left=None, title="simulate", unit="runs", total=100):
    """Note the progress of a job as `progress.shown` does in it."""
    (notes / str(job)).write_text(json.dumps([title, f"file {job}", left, unit, done, total]))


def last_line(screen):
    return screen.getvalue().rpartition("\r\033[K")[2]


def test_runs_are_counted_while_the_first_job_is_running(monkeypatch, clock, notes):
    handler, screen = display(monkeypatch, terminal=True)
    start(handler, runs=7_200)
    begin(handler, 1)
    begin(handler, 2)
    assert last_line(screen) == "simulate: 0 of 7,200 runs, 1 s"
    clock.now += 6.0
    note(notes, 1, 50.7)
    note(notes, 2, 10)
    note(notes, 3, 5, unit="runs that measure the friction")
    handler.show()
    assert last_line(screen) == "simulate: 60 of 7,200 runs, 6 s, about 12 min to go"  # 6 s / 60 x 7,140
    (notes / "1").unlink()
    handler.show()
    assert last_line(screen).startswith("simulate: 60 of "), "a job that has ended, which Snakemake has not said yet"
    send(handler, LogEvent.JOB_FINISHED, job_id=1)
    assert last_line(screen).startswith("simulate: 110 of 7,200 runs, ")


def test_the_time_left_follows_from_the_times_expected_of_the_jobs(monkeypatch, clock, notes):
    """Of 100 s in all, 10 s were of the first job; by the number of runs, 4.5 s would be left."""
    handler, screen = display(monkeypatch, terminal=True)
    start(handler, runs=200, seconds={"file 1": 10.0, "file 2": 90.0})
    begin(handler, 1)
    begin(handler, 2)
    clock.now += 5.0
    note(notes, 2, 10)
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


def test_the_time_for_compiling_is_no_time_per_run(monkeypatch, clock, notes, tmp_path):
    handler, screen = display(monkeypatch, terminal=True)
    start(handler)
    log = tmp_path / "1.log"
    line = "brownpipe: compiling the kernels for this kind of scene, once per machine: about 8 s"
    log.write_text(f"something else\n{line}\n")
    begin(handler, 1, log=log)
    begin(handler, 2, log=log)
    handler.listen()
    handler.listen()
    assert screen.getvalue().count(line) == 1
    assert "something else" not in screen.getvalue()
    for seconds, done in ((50.0, 0), (10.0, 20), (10.0, 60)):
        clock.now += seconds
        note(notes, 1, done)
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
    assert screen.getvalue().endswith("\nsimulate: 300 of 400 runs, 31 s\n")
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
    send(handler, event, "Building DAG went wrong", level)
    assert screen.getvalue() == "Building DAG went wrong\n"


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
    told = {"rule_name": "simulate", "shellcmd": "brownpipe simulate x.yaml", "log": [str(log)]}
    send(handler, LogEvent.JOB_ERROR, "Error in rule simulate", logging.ERROR, **told)
    send(handler, message="Complete log(s): y")
    handler.close()
    explained = f"brownpipe: the rule simulate failed: brownpipe simulate x.yaml\n{log}:\n    brownpipe: no\n"
    assert screen.getvalue().endswith(f"Complete log(s): y\n{explained}")


def test_after_an_interruption_no_job_is_blamed(monkeypatch):
    handler, screen = display(monkeypatch)
    send(handler, message="Terminating processes on user request, this might take some time.")
    told = {"rule_name": "simulate", "shellcmd": "brownpipe simulate x.yaml", "log": []}
    send(handler, LogEvent.JOB_ERROR, "Error in rule simulate", logging.ERROR, **told)
    handler.close()
    assert screen.getvalue().splitlines()[1:] == ["brownpipe: interrupted; the same command goes on from here"]


def test_several_rules_at_once(monkeypatch, clock, notes):
    handler, screen = display(monkeypatch, terminal=True)
    start(handler)
    begin(handler, 1, "tradeoff")
    clock.now += 2.0
    begin(handler, 2, "aggregate")
    clock.now += 3.4
    note(notes, 2, 7_200, 5.2, "aggregate", "runs", 19_200)
    (notes / "3").write_text('["aggregate", 5.')  # is being written
    handler.show()
    assert last_line(screen) == "aggregate: 7,200 of 19,200 runs, 3 s, about 5 s to go; tradeoff: 5 s"


def test_the_folder_of_notes_is_there_before_a_study_is_running_and_until_its_end(monkeypatch):
    """Messages come in a thread of their own, in which the environment must not change."""
    monkeypatch.delenv(NOTES)
    handler, _ = display(monkeypatch)
    folder = Path(os.environ[NOTES])
    assert folder.is_dir()
    start(handler)
    assert os.environ[NOTES] == str(folder)
    handler.close()
    assert not folder.exists() and NOTES not in os.environ


KILLED = """
import os, signal, sys
from types import SimpleNamespace
from snakemake_logger_plugin_brownpipe import LogHandler

handler = LogHandler(SimpleNamespace(dryrun=False, verbose=False, debug_dag=False, stdout=False), None)
print(os.environ["BROWNPIPE_PROGRESS"], flush=True)
sys.stdin.readline()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_folders_of_notes_of_killed_studies_are_removed_by_the_next_study(monkeypatch, tmp_path):
    """Not those of others, of running studies, nor what only has such a name."""
    monkeypatch.delenv(NOTES)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    study = subprocess.Popen([sys.executable, "-c", KILLED], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    folder = Path(study.stdout.readline().strip())
    (folder / "123").write_text("[]")
    (tmp_path / "brownpipe-progress-file").touch()
    (tmp_path / "theirs").mkdir()
    (tmp_path / "brownpipe-progress-link").symlink_to("theirs")
    other = tmp_path / "brownpipe-progress-of-my-thesis"
    other.mkdir()
    (other / "chapter").touch()
    os.utime(other, (0, 0))
    names = ("brownpipe-progress-file", "brownpipe-progress-link", other.name, "notes", "theirs")
    monkeypatch.setattr("brownpipe.progress.TIME_TO_LOCK", -1.0)  # they are new
    assert folder.parent == tmp_path
    display(monkeypatch)[0].close()
    assert (folder / "123").exists(), "its study is running"
    study.communicate("\n")
    monkeypatch.setattr("brownpipe.progress.TIME_TO_LOCK", 60.0)
    display(monkeypatch)[0].close()
    assert folder.exists(), "it is new and may belong to a study that has not locked it yet"
    os.utime(folder, (0, 0))
    display(monkeypatch)[0].close()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


# -- files and keys that Snakemake refuses before the Snakefile is read ---------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read: No such file or directory"),
        (b"", "empty; must be a mapping of keys to values"),
        (b"\x89HDF\r\n\x1a\n", "not text: byte 0 is not UTF-8; it is an HDF5 file"),
        ("café: 1\n".encode("latin-1"), "not text: byte 3 is not UTF-8; save it in UTF-8"),
        (b"seeds: [1\n", "line 2: not valid YAML: "),
        (b"seeds: 1\n\tbatch: 1\n", "line 2: not valid YAML: "),
        (b"[1, 2]\n", "must be a mapping with the keys scenes, seeds,"),
    ],
)
def test_a_file_that_snakemake_cannot_read_as_a_study(content, message, monkeypatch, tmp_path):
    from snakemake.common.configfile import load_configfile

    path = tmp_path / "study.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises((OSError, ValueError, WorkflowError), match=r"Config file|No such file|utf-8"):
        load_configfile(path)
    for arguments in (["--configfile", str(path)], [f"--configfile={path}"], ["-j2", "--configfiles", str(path), "-n"]):
        monkeypatch.setattr("sys.argv", ["snakemake", *arguments])
        with pytest.raises(SystemExit) as ended:  # before Snakemake reads it
            display(monkeypatch, dryrun=True)
        assert ended.value.code.startswith(f"brownpipe: {path}: {message}")
        assert "\n" not in ended.value.code


def test_a_target_after_a_config_file_is_no_file(monkeypatch, tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("seeds: 1\n")
    monkeypatch.setattr("sys.argv", ["snakemake", f"--configfile={path}", "tradeoff_figures"])
    display(monkeypatch)  # refuses nothing


def test_config_files_are_those_that_snakemake_takes():
    """Of an option given twice, the last."""
    from snakemake.cli import get_argument_parser

    parser = get_argument_parser()
    for words in ("", "--configfile a b", "--configfile a --configfile b", "--configfiles a -n --configfile=b all"):
        taken = parser.parse_args(["--cores", "1", *words.split()]).configfile
        assert configfiles(words.split()) == [str(path) for path in taken]


@pytest.mark.parametrize("option", ["--configf", "--configfi", "--configfil"])
def test_an_abbreviated_option_for_config_files_is_understood(option):
    """Snakemake refuses it as ambiguous where Python is old; a newer Python knows that both options are the same."""
    assert configfiles([option, "a", "b", "-n"]) == ["a", "b"]
    assert configfiles(["--configfile", "a", f"{option}=b", "--config", "seeds=1"]) == ["b"]


def test_a_config_file_that_a_later_one_replaces_is_not_read(monkeypatch, tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("seeds: 1\n")
    monkeypatch.setattr("sys.argv", ["snakemake", "--configfile", "absent.yaml", "--configfile", str(path)])
    display(monkeypatch)  # refuses nothing


@pytest.mark.parametrize("entry", ["box.x=3", "seeds", "9=1"])
def test_a_key_that_snakemake_refuses(entry, monkeypatch):
    from snakemake.cli import parse_config
    from snakemake.exceptions import format_exception_to_string

    with pytest.raises(ValueError, match="Invalid config definition") as refused:
        parse_config([entry])
    handler, screen = display(monkeypatch)
    send(handler, LogEvent.ERROR, format_exception_to_string(refused.value), logging.ERROR)
    assert screen.getvalue() == "brownpipe: --config: must be KEY=VALUE, with a key of the study, like seeds=100\n"


def test_other_errors_are_shown_as_they_are(monkeypatch, tmp_path):
    (tmp_path / "study.yaml").write_text("seeds: 1\n")
    monkeypatch.setattr("sys.argv", ["snakemake", "--configfile", str(tmp_path / "study.yaml")])
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
    assert "brownpipe: seeds 0-99 of : failed, is run again\n" in screen.getvalue()
    assert "the rule simulate failed" not in screen.getvalue()


def test_a_job_that_failed_in_every_attempt_is_explained_once_with_what_the_queue_said(monkeypatch):
    handler, screen = display(monkeypatch)
    said = "SLURM sbatch failed. 'invalid partition\x1b[2J: long'.\n    sbatch call:\n        sbatch -p long"
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
    send(handler, LogEvent.JOB_ERROR, rule_name="simulate", shellcmd="brownpipe simulate", log=[])
    send(handler, LogEvent.ERROR, "LockException: ...", logging.ERROR)
    send(handler, None, "a warning", logging.WARNING)
    handler.close()
    text = screen.getvalue()
    assert "a warning" in text and "the rule simulate failed" in text
    assert ("\r\033[K" in text) == terminal
    assert "\033" not in text.replace("\r\033[K", "")


@pytest.mark.promise(
    "a name, a log or a variable of the environment with terminal codes in it",
    "The display of a running study shows what others have written as text, without control characters.",
)
@pytest.mark.parametrize("verbose", [False, True])
def test_no_control_character_of_others_reaches_the_terminal(monkeypatch, clock, notes, tmp_path, verbose):
    codes = "\x1b]0;title\x07\x9b2J\u202e\b\r\udcff"
    (tmp_path / "log").write_bytes(b"brownpipe: compiling \x1b[2J\xff\r\x9b\nbrownpipe: second\x07\n")
    monkeypatch.setenv("UNLOCK_COMMAND", f"unlock {codes}\ncurl")
    handler, screen = display(monkeypatch, terminal=True, verbose=verbose)
    start(handler)
    begin(handler, 1, log=tmp_path / "log")
    note(notes, 1, 50, unit=f"runs{codes}")
    handler.listen()
    handler.show()
    send(handler, message=f"a warning {codes}", level=logging.WARNING)
    send(handler, message=f"LockException {codes}", level=logging.ERROR)
    command = f"brownpipe simulate 'a\ncurl{codes}'"
    send(handler, LogEvent.JOB_ERROR, rule_name="simulate", shellcmd=command, log=[str(tmp_path / "log")])
    handler.close()
    shown = screen.getvalue().replace("\r\033[K", "")
    assert "warning" in shown and (verbose or "second" in shown)
    assert [char for char in shown if char != "\n" and not char.isprintable()] == []
    assert [line for line in shown.splitlines() if line.startswith("curl")] == []
