"""What a study shows on the screen while Snakemake runs it: progress in runs, time left, and errors.

Snakemake finds this package by its name; profiles/default selects it. Snakemake's own messages, with every command, go
to its log file below .snakemake/log; warnings and errors are shown here, too. With -n or --verbose all messages are
shown as Snakemake formats them.

Jobs note their progress in a folder (`brownpipe.progress`), so that it is known before the first of them has ended.
"""

import argparse
import json
import logging
import os
import re
import shutil
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from brownpipe.errors import FAILED, NO_MEMORY, limits
from brownpipe.progress import LINE_INTERVAL, NOTES, Pace, folder_of_notes, line
from brownpipe.quoting import in_lines, printable
from brownpipe.stages import Stage

CHATTER = ("Assuming unrestricted", "Building DAG", "Using shell", "Select jobs", "Execute ", "Complete log", "Elapsed")
OF_CLUSTER = re.compile(  # messages of the executor for Slurm, which are in Snakemake's log
    r"SLURM run ID|Job \S+ has been submitted|Cleaning up SLURM|Job rate limit reached"
    r"|No SLURM account given|No account was given|Unable to guess SLURM account"
)
RESTART = re.compile(r"Trying to restart job (\S+)\.$")
ANSWER_RULES = ("all", "tradeoff_figures")  # rules that print results: no progress is shown while one runs
INTERRUPTED = "brownpipe: interrupted; the same command goes on from here"
LOCKED = (
    "brownpipe: LockException: another run writes the same results in this folder; wait for its end. If it was killed"
    " or the machine went down, first remove its lock: {}"
)
RUNS_PYTHON = "__use_yte__"  # the key of a configuration with Python code that Snakemake runs
WRONG_CONFIG = "brownpipe: --config: must be KEY=VALUE, with a key of the study, like seeds=100"
SAID_BY_FAILURES = ("Exiting because a job execution failed", "WorkflowError:\nAt least one job did not complete")
END = re.compile(  # of a command that failed
    r"^CalledProcessError.*?^Command '(?P<command>.*)' "
    r"(?:returned non-zero exit status (?P<status>\d+)|died with <Signals\.\w+: (?P<signal>\d+)>)",
    re.DOTALL | re.MULTILINE,
)
LESS_MEMORY = "must be fewer jobs at once (-j 1), a smaller batch: in the study, or more memory"
NO_NUMBER = -1  # of a job whose message has none
BY_CLUSTER = re.compile(r"For further error details see the cluster|\n *sbatch call:")  # ends what the queue said
GOES_ON = "the same command goes on from here"
MOST_FAILURES = 10  # that are explained at the end, with the whole log of each
LOOK_INTERVAL = 0.5  # seconds between two looks at the logs of running jobs


class RunningJob(NamedTuple):
    """A job of Snakemake that is running."""

    rule: str
    runs: int  # simulated by it
    output: str  # its first file
    logs: tuple[str, ...]  # its log files
    started: float  # time.monotonic() [s]
    title: str  # what it makes, in words


class Note(NamedTuple):
    """What a running job has noted of its progress."""

    rule: str
    output: str | None  # the file that it makes
    stage: Stage
    left: float | None  # time [s]


class Message(logging.LogRecord):
    """A message of Snakemake, which adds attributes to the record: each event has some of these."""

    stats: dict[str, int]  # RUN_INFO: planned jobs by rule
    runs: int  # to be simulated, from the Snakefile, like the next
    seconds: dict[str, float]  # CPU time that each job of simulate is expected to take, by its file
    jobid: int  # JOB_INFO
    job_id: int  # JOB_FINISHED
    rule_name: str  # JOB_INFO, JOB_ERROR, like the next
    log: list[str] | None
    output: list[str] | None  # JOB_INFO, like the next
    wildcards: dict[str, str] | None
    shellcmd: str | None  # JOB_ERROR, like the next
    rule_msg: str | None  # what the queue of a cluster said


class LogHandler(LogHandlerBase):
    """Handler of Snakemake's log messages that writes to the screen."""

    writes_to_stream = True
    writes_to_file = has_filter = has_formatter = needs_rulegraph = False

    def __post_init__(self) -> None:
        if mistake := mistake_in_configfiles(sys.argv[1:]):
            sys.exit(f"brownpipe: {mistake}")
        settings = self.common_settings
        self.verbatim = settings.dryrun or settings.verbose or settings.debug_dag
        self.stream = sys.stdout if settings.stdout else sys.stderr
        self.terminal = self.stream.isatty() and os.environ.get("TERM") != "dumb"
        self.simulates = False  # whether jobs that simulate are planned
        self.runs = 0  # to be simulated
        self.runs_of_finished = 0  # simulated by finished jobs
        self.runs_done = 0  # also those that running jobs have noted
        self.seconds: dict[str, float] = {}  # CPU time that each job that simulates is expected to take, by its file
        self.seconds_of_finished = 0.0  # expected of finished jobs
        self.seconds_done = 0.0  # also of the part of running jobs that they have noted
        self.pace: Pace | None = None  # of these seconds; None while kernels are compiled
        self.running: dict[int, RunningJob] = {}  # by Snakemake's number of the job
        self.started = self.last_line = time.monotonic()
        self.notes = ExitStack()  # the folder of notes, if there is one
        if not self.verbatim and NOTES not in os.environ:
            # Here and not in `start`: that is called in a thread of its own, while Snakemake may be starting a program
            # (its scheduler's solver), which fails with "Bad address" if the environment changes at that moment.
            self.notes.enter_context(folder_of_notes())
        self.remarks: set[str] = set()  # shown before
        self.shown_rules: set[str] = set()  # rules that had a line of progress, if the output is no terminal
        self.ends: dict[str, int] = {}  # exit statuses of commands that failed, as a shell gives them
        self.failures: list[tuple[int, str]] = []  # Snakemake's number of a job and an explanation, shown at the end
        self.titles: dict[str, str] = {}  # of all jobs that were started, by their number
        self.closed = threading.Event()
        self.interrupted = False

    def emit(self, record: Message) -> None:  # type: ignore[override]  # Snakemake's records only
        """Evaluate a message of Snakemake; show it if it concerns the user."""
        event = getattr(record, "event", None)
        if event == LogEvent.ERROR and "Invalid config definition" in record.getMessage():
            self.write(WRONG_CONFIG)
        elif not self.verbatim and event == LogEvent.ERROR and (end := END.search(record.getMessage())):
            self.ends[end["command"]] = int(end["status"] or 128 + int(end["signal"]))
        elif self.verbatim:
            self.write(self.format(record))
        elif event == LogEvent.RUN_INFO:
            self.start(record.stats)
        elif event == LogEvent.JOB_INFO:
            self.running[record.jobid] = job_of(record)
            self.titles[str(record.jobid)] = self.running[record.jobid].title
            self.show()
        elif event == LogEvent.JOB_FINISHED:
            self.finish(record.job_id)
        elif event == LogEvent.JOB_ERROR:
            self.fail(record)
        elif record.levelno > logging.INFO or event in (None, LogEvent.GROUP_ERROR, LogEvent.ERROR):
            self.runs = getattr(record, "runs", self.runs)
            self.seconds = getattr(record, "seconds", self.seconds)
            if getattr(record, "forecast", False) and not self.simulates:
                return
            text = self.format(record)
            self.interrupted |= text.startswith("Terminating processes on user request")
            if text.startswith("LockException"):
                text = LOCKED.format(printable(os.environ.get("UNLOCK_COMMAND", "the same command with --unlock")))
            if again := RESTART.match(text):
                text = f"brownpipe: {self.titles.get(again[1], 'a job')}: failed, is run again"
            if OF_CLUSTER.match(text):
                return
            chatter = text.startswith(CHATTER) and not (self.failures and text.startswith("Complete log"))
            if (record.levelno > logging.INFO or not chatter) and not text.startswith(SAID_BY_FAILURES):
                self.write(text)

    def start(self, stats: dict[str, int]) -> None:
        """Start to count jobs and to watch the logs of running ones; `stats` has the planned jobs of each rule."""
        self.simulates = "simulate" in stats
        self.started = self.last_line = time.monotonic()
        self.pace = Pace()
        threading.Thread(target=self.watch, daemon=True).start()

    def watch(self) -> None:
        """Every LOOK_INTERVAL, show new remarks of running jobs and the progress of all."""
        while not self.closed.wait(LOOK_INTERVAL):
            with self.lock:
                self.listen()
                self.show()

    def listen(self) -> None:
        """Show the remarks in the logs of running jobs, identical ones once."""
        for remark in (remark for job in self.running.values() for remark in remarks_of(job)):
            if remark not in self.remarks:
                self.remarks.add(remark)
                self.write(remark)
                if "compiling" in remark:
                    self.pace = None

    def finish(self, number: int) -> None:
        """Count a finished job, and forget that it failed before it was run again."""
        self.listen()
        job = self.running.pop(number, None)
        self.forget_failure(number)
        if job is not None:
            self.runs_of_finished += job.runs
            self.seconds_of_finished += self.seconds.get(job.output, 0.0)
        self.show()

    def fail(self, record: Message) -> None:
        """Keep the explanation of a failed job for the end; say at once that a job was killed, as its log cannot."""
        number = getattr(record, "jobid", NO_NUMBER)
        job = self.running.pop(number, None)
        status = next((status for command, status in self.ends.items() if str(record.shellcmd) in command), FAILED)
        if record.rule_name in ANSWER_RULES:
            return  # it prints the reason itself
        text = failure(record)
        if cure := cure_for(status, text):
            cure = f"brownpipe: {job.title if job else record.rule_name}: {cure}"
            self.write(cure)
            text += f"\n    {cure}"
        self.forget_failure(number)  # of an earlier attempt
        self.failures.append((number, text))

    def forget_failure(self, number: int) -> None:
        """Forget the explanation of a job that failed, by its number; those without a number stay."""
        self.failures = [failure for failure in self.failures if failure[0] != number or number == NO_NUMBER]

    def show(self) -> None:
        """Show the progress: on a terminal in one line that is overwritten, else every LINE_INTERVAL in a new line."""
        rules = {job.rule for job in self.running.values()}
        if not rules or rules & set(ANSWER_RULES):
            self.erase()
            return
        text = self.progress()
        if self.terminal:
            self.stream.write(f"\r\033[K{text[: shutil.get_terminal_size().columns - 1]}")
            self.stream.flush()
        elif not rules <= self.shown_rules or time.monotonic() - self.last_line > LINE_INTERVAL:
            self.write(text)
            self.shown_rules |= rules
            self.last_line = time.monotonic()

    def progress(self) -> str:
        """Return a line on the running rules: how much is done, the time taken and, if known, the time left."""
        now, notes = time.monotonic(), notes_of_jobs()
        started = {job.rule: job.started for job in self.running.values()}
        parts = []
        if started.pop("simulate", None) is not None:
            runs, left = self.count(now, notes)
            parts.append(line("simulate", runs, now - self.started, left))
        for rule, then in sorted(started.items()):
            stage, left = next(((note.stage, note.left) for note in notes if note.rule == rule), (None, None))
            parts.append(line(rule, stage, now - then, left))
        return "; ".join(parts)

    def count(self, now: float, notes: Iterable[Note]) -> tuple[Stage, float | None]:
        """Return how many runs are done and the time left for the others [s], None if it is unknown.

        As runs of different cases take different times, that is estimated from the times that are expected of the jobs.
        Nothing falls, although a job removes its note shortly before Snakemake says that the job is finished.
        """
        simulating = [note for note in notes if (note.rule, note.stage.unit) == ("simulate", "runs")]
        done = max(self.runs_done, self.runs_of_finished + sum(int(note.stage.done) for note in simulating))
        parts = (self.seconds.get(str(note.output), 0.0) * note.stage.done / note.stage.total for note in simulating)
        self.seconds_done = max(self.seconds_done, self.seconds_of_finished + sum(parts))
        if self.pace is None and done > self.runs_done:
            self.pace = Pace()
        self.runs_done = done
        stage = Stage("runs", done, max(self.runs, done))
        if self.pace is None:
            return stage, None
        self.pace.update(now, self.seconds_done)
        return stage, self.pace.left(now, sum(self.seconds.values()))

    def write(self, text: str) -> None:
        """Write a message in place of the line of progress; of control characters it keeps line feeds alone."""
        if text and text != "None":
            self.erase()
            self.stream.write(f"{in_lines(text.split(chr(10)))}\n")
            self.stream.flush()

    def erase(self) -> None:
        """Erase the line of progress on a terminal."""
        if self.terminal:
            self.stream.write("\r\033[K")
            self.stream.flush()

    def close(self) -> None:
        """Stop, and explain at the end, below Snakemake's own messages, why jobs failed."""
        self.closed.set()
        with self.lock:
            self.erase()
            for text in [INTERRUPTED] if self.interrupted else briefly([text for _, text in self.failures]):
                self.write(text)
            self.failures, self.interrupted = [], False
        self.notes.close()
        super().close()


def mistake_in_configfiles(arguments: Sequence[str]) -> str | None:
    """Return why a file of --configfile is no YAML mapping that Snakemake may read; None if all of them are.

    Called before Snakemake reads them. It would run Python code in them (`__use_yte__`), follow aliases that multiply
    without end, and show a traceback for other mistakes.
    """
    from brownpipe.errors import RequestError
    from brownpipe.scene import reading
    from brownpipe.scene.yaml_file import read_yaml
    from brownpipe.study import read_study
    from brownpipe.study.study_file import MOST_STUDY_BYTES

    for path in configfiles(arguments):
        try:
            mapping = read_yaml(path, MOST_STUDY_BYTES)
            if not isinstance(mapping, dict):
                read_study(path)  # raises
            elif RUNS_PYTHON in mapping:
                whole = reading.whole(mapping, path)
                at = whole.part(RUNS_PYTHON, mapping[RUNS_PYTHON])
                reading.refuse(whole, f"unknown key '{RUNS_PYTHON}'; a study must not have Python code in it", at)
        except RequestError as mistake:
            return str(mistake)
    return None


def configfiles(arguments: Sequence[str]) -> list[str]:
    """Return the files of --configfile, which Snakemake has accepted: those of the last one if it was given twice.

    It may be abbreviated to --configf. (This parser does not know --config, and would take it for an abbreviation.)
    """
    names = ("--configf", "--configfi", "--configfil", "--configfile", "--configfiles")
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(*names, nargs="+", default=[], dest="files")
    return parser.parse_known_args(arguments)[0].files


def job_of(record: Message) -> RunningJob:
    """Return the job that a message of Snakemake announces."""
    seeds = record.wildcards or {}
    runs = int(seeds["last"]) - int(seeds["first"]) + 1 if "last" in seeds else 0
    case = [seeds[key] for key in ("scene", "particles", "engine") if key in seeds]
    title = f"seeds {seeds['first']}-{seeds['last']} of {' '.join(case)}" if runs else record.rule_name
    output = str(record.output[0]) if record.output else ""
    return RunningJob(record.rule_name, runs, output, tuple(map(str, record.log or ())), time.monotonic(), title)


def remarks_of(job: RunningJob) -> Iterator[str]:
    """Yield the lines of a job's log that brownpipe wrote for the user."""
    for log in job.logs:
        with suppress(OSError):
            text = Path(log).read_text(errors="replace")
            yield from (line for line in text.splitlines() if line.startswith("brownpipe: "))


def notes_of_jobs() -> list[Note]:
    """Return what running jobs have noted; a note that is being written is left out."""
    notes = []
    for path in Path(os.environ.get(NOTES, os.devnull)).glob("*"):
        with suppress(OSError, ValueError):
            rule, output, left, *stage = json.loads(path.read_text())
            notes.append(Note(rule, output, Stage(*stage), left))
    return notes


def cure_for(status: int, text: str) -> str | None:
    """Return why a job ended and what helps, if it was killed or came to a limit; `text` is what its log says.

    `status` is its exit status as a shell gives it: above 128 the number of a signal.
    """
    number = status - 128
    if "out of memory" in text or any(word in text for word in NO_MEMORY):
        return f"out of memory{limits()}; {LESS_MEMORY}; {GOES_ON}"
    if number == signal.SIGKILL:
        return f"killed, most likely as memory ran out{limits()}; {LESS_MEMORY}; {GOES_ON}"
    if number == signal.SIGXCPU:
        return f"its CPU time ran out{limits()}; must be a higher limit or a smaller batch: in the study; {GOES_ON}"
    if number in set(signal.Signals) - {signal.SIGINT, signal.SIGTERM}:
        return f"ended by {signal.Signals(number).name}{limits()}; {GOES_ON}"
    return None


def briefly(failures: Sequence[str]) -> list[str]:
    """Return the explanations of the first failed jobs, and of the others the line with the rule and its command."""
    return [*failures[:MOST_FAILURES], *(text.partition("\n")[0] for text in failures[MOST_FAILURES:])]


def failure(record: Message) -> str:
    """Return an explanation of a failed job: the rule, its command, what a queue said of it, and its log."""
    lines = [printable(f"brownpipe: the rule {record.rule_name} failed: {record.shellcmd}")]
    said_by_queue = BY_CLUSTER.split(getattr(record, "rule_msg", None) or "")[0]
    lines += [f"    {line}" for line in said_by_queue.splitlines()]
    for log in map(str, record.log or ()):
        with suppress(OSError):
            lines += [f"{log}:", *(f"    {line}" for line in Path(log).read_text(errors="replace").splitlines())]
    return in_lines(lines)
