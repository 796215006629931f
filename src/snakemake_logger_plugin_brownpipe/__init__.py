"""What a study shows on the screen while Snakemake runs it: progress in runs, time left, and
errors.

Snakemake finds this package by its name; profiles/default selects it. Snakemake's own messages,
with every command, go to its log file below .snakemake/log; warnings and errors are shown here,
too. With -n or --verbose all messages are shown as Snakemake formats them. The progress of a
running job is read from its log, in which `brownpipe.progress` writes lines.
"""

import logging
import re
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from brownpipe.progress import Display, give_reason

# in Snakemake's log alone: its steps, what is explained here, submitted jobs, that all is done
UNSAID = re.compile(
    r"Assuming unrestricted|Building DAG|DAG of jobs|Updating checkpoint|Using shell|Select "
    r"jobs|Execute |Elapsed"
    r"|RuleException|brownpipe: .*: 0 runs|SLURM run ID|Job \S+ has been submitted|Cleaning up "
    r"SLURM"
    r"|Job rate limit reached|Exiting because a job|WorkflowError:\nAt least one job did not "
    r"complete"
)
RUNS_DONE = re.compile(r"^simulate: ([\d,]+) of ([\d,]+) runs", re.MULTILINE)  # in the log of a job
REMARK = re.compile(r"^brownpipe: .*", re.MULTILINE)
PASSING = re.compile(
    r"\w+: [\d,]+ of |brownpipe: compiling"
)  # lines of a log that give no reason for a failure
INTERRUPTED = "brownpipe: interrupted; the same command goes on from here"
LOCKED = (
    "brownpipe: another run writes in this folder; wait for it, or if there is none: brownpipe "
    "run STUDY --unlock"
)
KILLED = (
    "brownpipe: killed, most likely out of memory, or the disk is full; try -j 1, a smaller "
    "`batch:` or more room"
)
# in Snakemake's message on a command that ended by signal 9, as bash or Python report it
KILL = re.compile(r"exit status 137\b|SIGKILL")
UNKNOWN = "brownpipe: ended without a message; Snakemake's own are in its log below .snakemake/log"
MOST_FAILURES = 3  # that are explained at the end
LONGEST_REASON = 8  # lines of a log, its last ones
LOOK_INTERVAL = 0.5  # seconds between two looks at the logs of running jobs


class LogHandler(LogHandlerBase):
    """Handler of Snakemake's log messages that writes to the screen."""

    writes_to_stream = True
    writes_to_file = has_filter = has_formatter = needs_rulegraph = False

    def __post_init__(self) -> None:
        settings = self.common_settings
        self.verbatim = settings.dryrun or settings.verbose or settings.debug_dag
        self.display = Display()
        self.runs: dict[str, int] = {}  # to be simulated, by file
        self.seconds: dict[str, float] = {}  # CPU time that they are expected to take
        self.shares: dict[str, float] = {}  # how much of them is done
        # Snakemake's messages on running jobs, by its number of the job
        self.running: dict[int, Any] = {}
        self.earlier_logs: dict[int, str] = {}  # by its number: what an earlier attempt has left
        self.remarks: set[str] = set()  # that were shown
        # an explanation of each failed job, by its number, shown at the end
        self.failures: dict[int, str] = {}
        self.exceptions: dict[int, str] = {}  # Snakemake's latest one, by its thread
        self.closed = threading.Event()
        threading.Thread(target=self.watch, daemon=True).start()

    def emit(self, record: Any) -> None:
        """Evaluate a message of Snakemake, which adds attributes to the record; show it if it
        concerns the user.
        """
        event = getattr(record, "event", None)
        if self.verbatim:
            self.display.say(self.format(record))
        elif event == LogEvent.JOB_INFO:
            self.running[record.jobid] = record
            self.earlier_logs[record.jobid] = log_of(record)
        elif event == LogEvent.JOB_FINISHED:
            self.look()
            self.failures.pop(record.job_id, None)  # of an earlier attempt
            self.shares |= dict.fromkeys(self.running.pop(record.job_id).output, 1.0)
        elif event == LogEvent.JOB_ERROR:
            self.running.pop(record.jobid, None)
            exception = self.exceptions.pop(record.thread, "")
            if record.log:  # otherwise it said on the screen what is wrong
                self.failures[record.jobid] = explanation(record, exception)
        elif record.levelno > logging.INFO or event is None:
            if hasattr(record, "seconds"):  # said by the Snakefile
                self.runs = record.runs
                self.seconds = record.seconds
            text = self.format(record)
            if text.startswith("RuleException"):  # told just before the job is said to have failed
                self.exceptions[record.thread] = text
            self.tell(text)

    def tell(self, text: str) -> None:
        """Show a message that concerns the user."""
        if text.startswith("Terminating processes on user request"):
            self.failures[-1] = INTERRUPTED
        if not UNSAID.match(text) and (self.failures or not text.startswith("Complete log")):
            if text.startswith("LockException"):
                text = LOCKED
                give_reason(LOCKED.removeprefix("brownpipe: "))
            self.display.say(text)

    def watch(self) -> None:
        """Look at the running jobs every LOOK_INTERVAL."""
        while not self.closed.wait(LOOK_INTERVAL):
            self.acquire()
            try:
                self.look()
            finally:
                self.release()

    def look(self) -> None:
        """Show new remarks of running jobs, identical ones once, and the progress of all.

        As runs of different cases take different times, the time left follows from the times
        expected of the jobs.
        """
        for number, job in self.running.items():
            log = log_of(job)
            if log == self.earlier_logs[number]:  # not begun anew yet, or empty
                continue
            for remark in REMARK.findall(log):
                if remark not in self.remarks:
                    self.remarks.add(remark)
                    self.display.say(remark)
            for counts in RUNS_DONE.findall(log)[-1:]:
                done, total = (int(count.replace(",", "")) for count in counts)
                self.shares[job.output[0]] = done / total
        rules = sorted({job.rule_name for job in self.running.values()})
        if not all(job.log for job in self.running.values()):  # it prints results
            self.display.erase()
        elif rules:
            text = ", ".join(rules)
            if self.runs:
                runs = sum(self.runs.values())
                text += f": {self.done_of(self.runs):,.0f} of {runs:,} runs"
            seconds = sum(self.seconds.values())
            self.display.update(text, self.done_of(self.seconds), seconds)

    def done_of(self, totals: Mapping[str, float]) -> float:
        """Return how much is done of totals by file."""
        return sum(total * self.shares.get(file, 0.0) for file, total in totals.items())

    def close(self) -> None:
        """Stop, and explain at the end, below Snakemake's own messages, why jobs failed."""
        self.closed.set()
        self.display.erase()
        failures = [*self.failures.values()]
        if INTERRUPTED in failures:
            failures = [INTERRUPTED]
        if len(failures) > MOST_FAILURES:
            self.display.say(f"brownpipe: {len(failures)} jobs failed, among them:")
        for text in failures[:MOST_FAILURES]:
            self.display.say(text)
            *_, last_line = text.splitlines()
            give_reason(last_line.strip().removeprefix("brownpipe: "))
        self.failures = {}
        super().close()


def log_of(job: Any) -> str:
    """Return what is in the log file of a job."""
    log = Path(*job.log or ())
    return log.read_text(errors="replace") if log.is_file() else ""


def explanation(job: Any, exception: str) -> str:
    """Return the command of a failed job and why it failed: what the queue and its log say, or else
    Snakemake's exception.
    """
    said = f"{getattr(job, 'rule_msg', None) or ''}\n{log_of(job)}".splitlines()
    reason = [line for line in said if line and not PASSING.match(line)][-LONGEST_REASON:]
    command = " ".join(str(job.shellcmd).split())
    return "\n    ".join(
        [
            f"brownpipe: the rule {job.rule_name} failed: {command}",
            *(reason or reason_of(exception)),
        ]
    )


def reason_of(exception: str) -> list[str]:
    """Return the lines that say why a job failed that left nothing in its log."""
    _, *lines = exception.splitlines() or [""]
    if KILL.search(exception):
        return [KILLED]
    return lines[:LONGEST_REASON] or [UNKNOWN]
