"""What a study shows on the screen while Snakemake runs it: progress, time left, and errors.

Snakemake finds this package by its name; profiles/default selects it. Snakemake's own messages, with every command, go
to its log file below .snakemake/log; warnings and errors are shown here, too. With -n or --verbose all messages are
shown as Snakemake formats them.
"""

import logging
import os
import shutil
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

CHATTER = ("Assuming unrestricted", "Building DAG", "Using shell", "Select jobs", "Execute ", "Complete log", "Elapsed")
ANSWER_RULES = ("all", "tradeoff_figures")  # rules that print results: no progress is shown while one runs
INTERRUPTED = "brownpipe: interrupted; the same command goes on from here"
LOCKED = (
    "brownpipe: LockException: another run writes the same results in this folder; wait for its end. If it was killed"
    " or the machine went down, first remove its lock: {}"
)
LOOK_INTERVAL = 0.5  # seconds between two looks at the logs of running jobs
LINE_INTERVAL = 10.0  # seconds between two lines of progress if the output is no terminal


class RunningJob(NamedTuple):
    """A job of Snakemake that is running."""

    rule: str
    runs: int  # simulated by it
    logs: tuple[str, ...]  # its log files
    started: float  # time.monotonic() [s]


class Message(logging.LogRecord):
    """A message of Snakemake, which adds attributes to the record: each event has some of these."""

    stats: dict[str, int]  # RUN_INFO: planned jobs by rule
    jobid: int  # JOB_INFO
    job_id: int  # JOB_FINISHED
    rule_name: str  # JOB_INFO, JOB_ERROR, like the next
    log: list[str] | None
    wildcards: dict[str, str] | None  # JOB_INFO
    shellcmd: str | None  # JOB_ERROR


class LogHandler(LogHandlerBase):
    """Handler of Snakemake's log messages that writes to the screen."""

    writes_to_stream = True
    writes_to_file = has_filter = has_formatter = needs_rulegraph = False

    def __post_init__(self) -> None:
        settings = self.common_settings
        self.verbatim = settings.dryrun or settings.verbose or settings.debug_dag
        self.stream = sys.stdout if settings.stdout else sys.stderr
        self.terminal = self.stream.isatty()
        self.planned: Counter[str] = Counter()  # jobs by rule
        self.done: Counter[str] = Counter()
        self.runs = 0  # simulated by finished jobs
        self.running: dict[int, RunningJob] = {}  # by Snakemake's number of the job
        self.durations: list[float] = []  # of simulate jobs that did not wait for the compiler [s]
        self.started = self.last_line = time.monotonic()
        self.last_compilation = 0.0  # when a job last announced one: jobs started before it take longer than others
        self.remarks: set[str] = set()  # shown before
        self.shown_rules: set[str] = set()  # rules that had a line of progress, if the output is no terminal
        self.failures: list[str] = []  # explanations, shown at the end
        self.closed = threading.Event()
        self.interrupted = False

    def emit(self, record: Message) -> None:  # type: ignore[override]  # Snakemake's records only
        """Evaluate a message of Snakemake; show it if it concerns the user."""
        event = getattr(record, "event", None)
        if event == LogEvent.ERROR and (mistake := mistake_in(sys.argv[1:], record.getMessage())):
            self.write(f"brownpipe: {mistake}")
        elif self.verbatim:
            self.write(self.format(record))
        elif event == LogEvent.RUN_INFO:
            self.start(record.stats)
        elif event == LogEvent.JOB_INFO:
            self.running[record.jobid] = job_of(record)
            self.show()
        elif event == LogEvent.JOB_FINISHED:
            self.finish(record.job_id)
        elif event == LogEvent.JOB_ERROR:
            self.failures.append(failure(record))
        elif record.levelno > logging.INFO or event in (None, LogEvent.GROUP_ERROR, LogEvent.ERROR):
            if getattr(record, "forecast", False) and not self.planned["simulate"]:
                return
            text = self.format(record)
            self.interrupted |= text.startswith("Terminating processes on user request")
            if text.startswith("LockException"):
                text = LOCKED.format(os.environ.get("UNLOCK_COMMAND", "the same command with --unlock"))
            if self.failures or record.levelno > logging.INFO or not text.startswith(CHATTER):
                self.write(text)

    def start(self, stats: dict[str, int]) -> None:
        """Start to count jobs and to watch the logs of running ones; `stats` has the planned jobs of each rule."""
        self.planned = Counter({rule: count for rule, count in stats.items() if rule != "total"})
        self.started = self.last_line = time.monotonic()
        threading.Thread(target=self.watch, daemon=True).start()

    def watch(self) -> None:
        """Every LOOK_INTERVAL, show new remarks of running jobs and the progress of all."""
        while not self.closed.wait(LOOK_INTERVAL):
            with self.lock:
                self.listen()
                self.show()

    def listen(self) -> None:
        """Show the remarks in the logs of running jobs, identical ones once."""
        for line in (line for job in self.running.values() for line in remarks_of(job)):
            if line not in self.remarks:
                self.remarks.add(line)
                self.write(line)
                if "compiling" in line:
                    self.last_compilation = time.monotonic()

    def finish(self, number: int) -> None:
        """Count a finished job."""
        self.listen()
        job = self.running.pop(number, None)
        if job is not None:
            self.done[job.rule] += 1
            self.runs += job.runs
            if job.rule == "simulate" and job.started > self.last_compilation:
                self.durations.append(time.monotonic() - job.started)
        self.show()

    def show(self) -> None:
        """Show the progress: on a terminal in one line that is overwritten, else every LINE_INTERVAL in a new line."""
        rules = {job.rule for job in self.running.values()}
        if not rules or rules & set(ANSWER_RULES):
            self.erase()
            return
        seconds = time.monotonic() - self.started
        text = progress(self.planned, self.done, self.runs, rules, seconds, self.left())
        if self.terminal:
            self.stream.write(f"\r\033[K{text[: shutil.get_terminal_size().columns - 1]}")
            self.stream.flush()
        elif not rules <= self.shown_rules or time.monotonic() - self.last_line > LINE_INTERVAL:
            self.write(text)
            self.shown_rules |= rules
            self.last_line = time.monotonic()

    def left(self) -> float | None:
        """Return the time left for the simulations [s], from the mean duration of finished jobs; None if unknown."""
        running = sum(job.rule == "simulate" for job in self.running.values())
        if not self.durations or not running:
            return None
        jobs = self.planned["simulate"] - self.done["simulate"] - running / 2  # running ones are half done on average
        return jobs / running * sum(self.durations) / len(self.durations)

    def write(self, text: str) -> None:
        """Write a line in place of the line of progress."""
        if text and text != "None":
            self.erase()
            self.stream.write(f"{text}\n")
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
            for text in [INTERRUPTED] if self.interrupted else self.failures:
                self.write(text)
            self.failures, self.interrupted = [], False
        super().close()


def mistake_in(arguments: Sequence[str], message: str) -> str | None:
    """Return the mistake in --config or --configfile that Snakemake's message is about; None if it is none of these.

    Snakemake shows a traceback for most of them. A study file is read again by brownpipe, which says what is wrong.
    """
    if "Invalid config definition" in message:
        return "--config: must be KEY=VALUE, with a key of the study, like seeds=100"
    if "load_configfile" in message or "Config file" in message:
        from brownpipe.errors import RequestError
        from brownpipe.study import read_study

        for path in configfiles(arguments):
            try:
                read_study(path)
            except RequestError as mistake:
                return str(mistake)
    return None


def configfiles(arguments: Sequence[str]) -> Iterator[str]:
    """Yield the values of --configfile."""
    is_value = False
    for word in arguments:
        if word.startswith("-"):
            option, _, value = word.partition("=")
            is_value = option in ("--configfile", "--configfiles")
            yield from [value] if is_value and value else []
        elif is_value:
            yield word


def job_of(record: Message) -> RunningJob:
    """Return the job that a message of Snakemake announces."""
    seeds = record.wildcards or {}
    runs = int(seeds["last"]) - int(seeds["first"]) + 1 if "last" in seeds else 0
    return RunningJob(record.rule_name, runs, tuple(map(str, record.log or ())), time.monotonic())


def remarks_of(job: RunningJob) -> Iterator[str]:
    """Yield the lines of a job's log that brownpipe wrote for the user."""
    for log in job.logs:
        with suppress(OSError):
            text = Path(log).read_text(errors="replace")
            yield from (line for line in text.splitlines() if line.startswith("brownpipe: "))


def progress(
    planned: Counter[str], done: Counter[str], runs: int, rules: set[str], seconds: float, left: float | None
) -> str:
    """Return a line on the running rules: jobs and runs that are done, time since the start and time left [s]."""
    parts = []
    if "simulate" in rules:
        jobs = f"{done['simulate']} of {planned['simulate']} jobs ({runs:,} runs)"
        to_go = "" if left is None else f", about {left:.0f} s to go"
        parts.append(f"simulate: {jobs} done in {seconds:.0f} s{to_go}")
    return "; ".join([*parts, *(f"{rule}: {seconds:.0f} s after the start" for rule in sorted(rules - {"simulate"}))])


def failure(record: Message) -> str:
    """Return an explanation of a failed job: the rule, its command, and its log."""
    lines = [f"brownpipe: the rule {record.rule_name} failed: {record.shellcmd}"]
    for log in map(str, record.log or ()):
        with suppress(OSError):
            lines += [f"{log}:", *(f"    {line}" for line in Path(log).read_text(errors="replace").splitlines())]
    return "\n".join(lines)
