"""What a study shows on the screen while Snakemake runs it: progress in runs, time left, and errors.

Snakemake finds this package by its name; profiles/default selects it. Snakemake's own messages, with every command, go
to its log file below .snakemake/log; warnings and errors are shown here, too. With -n or --verbose all messages are
shown as Snakemake formats them. How far a running job is says its log, in which `brownpipe.progress` writes lines.
"""

import logging
import os
import re
import shutil
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from brownpipe.progress import LINE_INTERVAL, Pace, line
from brownpipe.quoting import in_lines
from brownpipe.stages import Stage

UNSAID = re.compile(  # in Snakemake's log alone: its steps, what the explanations of failures say, submitted jobs
    r"Assuming unrestricted|Building DAG|Using shell|Select jobs|Execute |Elapsed"
    r"|SLURM run ID|Job \S+ has been submitted|Cleaning up SLURM|Job rate limit reached"
    r"|No (?:SLURM )?account (?:was )?given|Unable to guess SLURM account"
    r"|Exiting because a job execution failed|WorkflowError:\nAt least one job did not complete"
)
RUNS_DONE = re.compile(r"^simulate: ([\d,]+) of [\d,]+ runs", re.MULTILINE)  # in the log of a job
END = re.compile(  # of a command that failed
    r"^Command '(.*)' (?:returned non-zero exit status (\d+)|died with <Signals\.\w+: (\d+)>)", re.DOTALL + re.MULTILINE
)
ANSWER_RULES = {"all", "tradeoff_figures"}  # rules that print results: no progress is shown while one runs
INTERRUPTED = "brownpipe: interrupted; the same command goes on from here"
LOCKED = (
    "brownpipe: LockException: another run writes the same results in this folder; wait for its end. If it was killed"
    " or the machine went down, first remove its lock: snakemake --unlock (or brownpipe run STUDY -- --unlock)"
)
NO_MEMORY = "most likely out of memory; must be fewer jobs at once (-j 1) or a smaller batch: in the study"
MOST_FAILURES = 10  # that are explained at the end, with the whole log of each
LOOK_INTERVAL = 0.5  # seconds between two looks at the logs of running jobs


class LogHandler(LogHandlerBase):
    """Handler of Snakemake's log messages that writes to the screen."""

    writes_to_stream = True
    writes_to_file = has_filter = has_formatter = needs_rulegraph = False

    def __post_init__(self) -> None:
        settings = self.common_settings
        self.verbatim = settings.dryrun or settings.verbose or settings.debug_dag
        self.stream = sys.stdout if settings.stdout else sys.stderr
        self.terminal = self.stream.isatty() and os.environ.get("TERM") != "dumb"
        self.interrupted = False
        self.runs = self.runs_of_finished = 0  # to be simulated; simulated by finished jobs
        self.seconds: dict[str, float] = {}  # CPU time that each job that simulates is expected to take, by its file
        self.seconds_of_finished = 0.0  # expected of finished jobs
        self.pace: Pace | None = Pace()  # of these seconds; None while kernels are compiled
        self.running: dict[int, Any] = {}  # Snakemake's messages on running jobs, by its number of the job
        self.started = self.last_line = time.time()
        self.shown: set[str] = set()  # remarks, and rules that had a line of progress
        self.ends: dict[str, int] = {}  # exit statuses of commands that failed, as a shell gives them
        self.failures: dict[int, str] = {}  # an explanation of each failed job, by its number, shown at the end
        self.closed = threading.Event()

    def emit(self, record: Any) -> None:
        """Evaluate a message of Snakemake, which adds attributes to the record; show it if it concerns the user."""
        event = getattr(record, "event", None)
        if self.verbatim:
            self.write(self.format(record))
        elif event == LogEvent.ERROR and (end := END.search(record.getMessage())):
            self.ends[end[1]] = int(end[2] or 128 + int(end[3]))
        elif event == LogEvent.RUN_INFO:
            self.started = self.last_line = time.time()
            threading.Thread(target=self.watch, daemon=True).start()
        elif event == LogEvent.JOB_INFO:
            self.running[record.jobid] = record
            self.show()
        elif event == LogEvent.JOB_FINISHED:
            self.finish(record.job_id)
        elif event == LogEvent.JOB_ERROR:
            self.fail(record)
        elif hasattr(record, "forecast"):  # by the Snakefile
            self.runs, self.seconds = record.runs, record.seconds
            self.write(self.format(record) if self.runs else "")
        elif record.levelno > logging.INFO or event in (None, LogEvent.GROUP_ERROR, LogEvent.ERROR):
            self.tell(self.format(record))

    def tell(self, text: str) -> None:
        """Show a message that concerns the user."""
        self.interrupted |= text.startswith("Terminating processes on user request")
        is_of_success = text.startswith("Complete log") and not self.failures
        if not UNSAID.match(text) and not is_of_success:
            self.write(LOCKED if text.startswith("LockException") else text)

    def watch(self) -> None:
        """Every LOOK_INTERVAL, show new remarks of running jobs and the progress of all."""
        while not self.closed.wait(LOOK_INTERVAL):
            with self.lock:
                self.listen()
                self.show()

    def listen(self) -> None:
        """Show the remarks in the logs of running jobs, identical ones once."""
        for remark in "\n".join(map(log_of, self.running.values())).splitlines():
            if remark.startswith("brownpipe: ") and remark not in self.shown:
                self.shown.add(remark)
                self.write(remark)
                self.pace = None if "compiling" in remark else self.pace

    def finish(self, number: int) -> None:
        """Count a finished job, and forget that it failed before it was run again."""
        self.listen()
        self.failures.pop(number, None)
        if job := self.running.pop(number, None):
            self.runs_of_finished += runs_of(job)
            self.seconds_of_finished += self.seconds.get(file_of(job), 0.0)
        self.show()

    def fail(self, record: Any) -> None:
        """Keep the explanation of a failed job for the end; say at once that a job was killed, as its log cannot."""
        self.running.pop(record.jobid, None)
        if record.rule_name in ANSWER_RULES:
            return  # it prints the reason itself
        said = [*(getattr(record, "rule_msg", None) or "").splitlines(), *log_of(record).splitlines()]
        status = next((status for command, status in self.ends.items() if str(record.shellcmd) in command), 1)
        command = f"the rule {record.rule_name} failed: {record.shellcmd}"
        if cure := cure_for(status, said):
            self.write(in_lines([f"brownpipe: {cure}: {command}"]))
            said.append(f"brownpipe: {cure}; the same command goes on from here")
        self.failures.pop(record.jobid, None)  # of an earlier attempt
        self.failures[record.jobid] = in_lines([f"brownpipe: {command}", *(f"    {line}" for line in said)])

    def show(self) -> None:
        """Show the progress: on a terminal in one line that is overwritten, else every LINE_INTERVAL in a new line."""
        rules = {job.rule_name for job in self.running.values()}
        self.erase()
        if not rules or rules & ANSWER_RULES:
            return
        text = self.progress()
        if self.terminal:
            self.stream.write(text[: shutil.get_terminal_size().columns - 1])
            self.stream.flush()
        elif not rules <= self.shown or time.time() - self.last_line > LINE_INTERVAL:
            self.write(text)
            self.shown |= rules
            self.last_line = time.time()

    def progress(self) -> str:
        """Return a line on the running rules: how many runs are done, the time taken and, if known, the time left.

        As runs of different cases take different times, that is estimated from the times that are expected of the jobs.
        """
        started = {job.rule_name: job.created for job in self.running.values()}
        parts = [line(rule, None, time.time() - then) for rule, then in sorted(started.items()) if rule != "simulate"]
        if "simulate" not in started:
            return "; ".join(parts)
        runs, seconds = self.runs_of_finished, self.seconds_of_finished
        for job in self.running.values():
            if runs_of(job) and (found := RUNS_DONE.findall(log_of(job))):
                done = int(found[-1].replace(",", ""))
                runs += done
                seconds += self.seconds.get(file_of(job), 0.0) * done / runs_of(job)
        if self.pace is None and seconds:
            self.pace = Pace()
        left = None if self.pace is None else self.pace.left(time.time(), seconds, sum(self.seconds.values()))
        simulated = Stage("runs", runs, max(self.runs, runs))
        return "; ".join([line("simulate", simulated, time.time() - self.started, left), *parts])

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

    def close(self) -> None:
        """Stop, and explain at the end, below Snakemake's own messages, why jobs failed."""
        self.closed.set()
        with self.lock:
            self.erase()
            failures = list(self.failures.values())
            brief = [text.partition("\n")[0] for text in failures[MOST_FAILURES:]]
            for text in [INTERRUPTED] if self.interrupted else failures[:MOST_FAILURES] + brief:
                self.write(text)
            self.failures, self.interrupted = {}, False
        super().close()


def runs_of(job: Any) -> int:
    """Return how many runs a job of the rule `simulate` makes; 0 for other rules."""
    seeds = job.wildcards or {}
    return int(seeds["last"]) - int(seeds["first"]) + 1 if job.rule_name == "simulate" else 0


def file_of(job: Any) -> str:
    """Return the first file that a job makes."""
    return str(job.output[0]) if job.output else ""


def log_of(job: Any) -> str:
    """Return what is in the log files of a job."""
    text = ""
    for log in job.log or ():
        with suppress(OSError):
            text += Path(log).read_text(errors="replace")
    return text


def cure_for(status: int, said: list[str]) -> str:
    """Return why a job ended and what helps, if it was killed or ran out of memory, otherwise ""; `said`: its log.

    `status` is its exit status as a shell gives it: above 128 the number of a signal.
    """
    if status == 128 + signal.SIGKILL or "out of memory" in "".join(said):
        return f"killed or ended, {NO_MEMORY}"
    is_ended = status - 128 in set(signal.Signals) - {signal.SIGINT, signal.SIGTERM}
    return f"ended by {signal.Signals(status - 128).name}" if is_ended else ""
