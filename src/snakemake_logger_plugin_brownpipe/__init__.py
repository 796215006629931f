"""What a study shows on the screen while Snakemake runs it: how far it is, how long still, and whatever goes wrong.

Snakemake finds this package by its name, and profiles/default chooses it. Snakemake's own messages, every command among
them, are in the log file that it keeps under .snakemake/log; warnings and errors are shown here, too. With -n or
--verbose everything is shown as Snakemake has it.
"""

import logging
import shutil
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

CHATTER = ("Assuming unrestricted", "Building DAG", "Using shell", "Select jobs", "Execute ", "Complete log", "Elapsed")
ANSWERS = ("all", "tradeoff_figures")  # rules that print the answer: nothing else is written meanwhile
GO_ON = "brownpipe: interrupted; the same command goes on from here"
OFTEN, SELDOM = 0.5, 10.0  # seconds between two looks, and between two lines where there is no terminal


class Job(NamedTuple):
    """A job that is running."""

    rule: str
    runs: int  # that it simulates
    logs: tuple[str, ...]  # files
    began: float  # s


class LogHandler(LogHandlerBase):
    """Snakemake's handler of messages, for the screen."""

    writes_to_stream, writes_to_file, has_filter, has_formatter, needs_rulegraph = True, False, False, False, False

    def __post_init__(self):
        settings = self.common_settings
        self.everything = settings.dryrun or settings.verbose or settings.debug_dag
        self.stream = sys.stdout if settings.stdout else sys.stderr
        self.terminal = self.stream.isatty()
        self.planned, self.done, self.runs, self.running, self.took = Counter(), Counter(), 0, {}, []
        self.began = self.last = time.monotonic()
        self.compiled = 0.0  # when a job last said so: it and those that wait for it take longer than others
        self.heard, self.shown, self.failures, self.over = set(), set(), [], threading.Event()
        self.interrupted = False

    def emit(self, record):
        """Take note of a message of Snakemake, and show it if it is for the user."""
        event = getattr(record, "event", None)
        if self.everything:
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
            if self.failures or record.levelno > logging.INFO or not text.startswith(CHATTER):
                self.write(text)

    def start(self, stats):
        """Begin to count and to look at the logs of running jobs."""
        self.planned = Counter({rule: count for rule, count in stats.items() if rule != "total"})
        self.began = self.last = time.monotonic()
        threading.Thread(target=self.watch, daemon=True).start()

    def watch(self):
        """Look again and again at what running jobs say, and show how far all is."""
        while not self.over.wait(OFTEN):
            with self.lock:
                self.listen()
                self.show()

    def listen(self):
        """Show what running jobs say, each line once, whichever of them says it."""
        for line in (line for job in self.running.values() for line in spoken(job)):
            if line not in self.heard:
                self.heard.add(line)
                self.write(line)
                if "compiling" in line:
                    self.compiled = time.monotonic()

    def finish(self, number):
        self.listen()
        job = self.running.pop(number, None)
        if job is not None:
            self.done[job.rule] += 1
            self.runs += job.runs
            if job.rule == "simulate" and job.began > self.compiled:
                self.took.append(time.monotonic() - job.began)
        self.show()

    def show(self):
        """Show how far the jobs are: in a line that is written over on a terminal, else now and then in a new line."""
        rules = {job.rule for job in self.running.values()}
        if not rules or rules & set(ANSWERS):
            self.erase()
            return
        seconds = time.monotonic() - self.began
        text = progress(self.planned, self.done, self.runs, rules, seconds, self.left())
        if self.terminal:
            self.stream.write(f"\r\033[K{text[: shutil.get_terminal_size().columns - 1]}")
            self.stream.flush()
        elif not rules <= self.shown or time.monotonic() - self.last > SELDOM:
            self.write(text)
            self.shown |= rules
            self.last = time.monotonic()

    def left(self):
        """Return how long the simulations will still take [s] if jobs take as long as until now, None if unknown."""
        running = sum(job.rule == "simulate" for job in self.running.values())
        if not self.took or not running:
            return None
        rest = self.planned["simulate"] - self.done["simulate"] - running / 2
        return rest / running * sum(self.took) / len(self.took)

    def write(self, text):
        if text and text != "None":
            self.erase()
            self.stream.write(f"{text}\n")
            self.stream.flush()

    def erase(self):
        if self.terminal:
            self.stream.write("\r\033[K")
            self.stream.flush()

    def close(self):
        """End with why jobs failed, below all that Snakemake says of it."""
        self.over.set()
        with self.lock:
            self.erase()
            for text in [GO_ON] if self.interrupted else self.failures:
                self.write(text)
            self.failures, self.interrupted = [], False
        super().close()


def job_of(record):
    """Return the job that a message of Snakemake announces."""
    seeds = record.wildcards or {}
    runs = int(seeds["last"]) - int(seeds["first"]) + 1 if "last" in seeds else 0
    return Job(record.rule_name, runs, tuple(map(str, record.log or ())), time.monotonic())


def spoken(job):
    """Return the lines in a job's log that are for the user: brownpipe's own remarks."""
    for log in job.logs:
        with suppress(OSError):
            text = Path(log).read_text(errors="replace")
            yield from (line for line in text.splitlines() if line.startswith("brownpipe: "))


def progress(planned, done, runs, running, seconds, left):
    """Return in words which rules are running, how far and, where it is known, for how long still."""
    parts = []
    if "simulate" in running:
        jobs = f"{done['simulate']} of {planned['simulate']} jobs ({runs:,} runs)"
        still = "" if left is None else f", about {left:.0f} s to go"
        parts.append(f"simulate: {jobs} done in {seconds:.0f} s{still}")
    return "; ".join([*parts, *(f"{rule}: {seconds:.0f} s after the start" for rule in sorted(running - {"simulate"}))])


def failure(record):
    """Return what is to be said of a job that failed: which, its command, and last what it had to say."""
    lines = [f"brownpipe: the rule {record.rule_name} failed: {record.shellcmd}"]
    for log in map(str, record.log or ()):
        with suppress(OSError):
            lines += [f"{log}:", *(f"    {line}" for line in Path(log).read_text(errors="replace").splitlines())]
    return "\n".join(lines)
