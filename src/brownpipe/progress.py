"""What a long calculation is doing and how much of it is done, and what a screen shows of it.

    with progress.shown("simulate"):
        ...

A stage is a number of pieces of work that take about the same time each, such as the runs of a
batch or the frames of a movie. It is reported as (unit, done, total): a plural noun, the number of
finished pieces, including the fraction of an unfinished one if it is known, and that of all pieces.
The screen shows one line that is overwritten, or in a log a line every half a minute, on standard
error. The display of a whole study is the same: snakemake_logger_plugin_brownpipe.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from brownpipe.text import in_lines, in_time

DELAY = 2.0  # s of work before the line is shown on a terminal or in a notebook
INTERVAL = 0.2  # s between two updates of it
LINE_INTERVAL = 30.0  # s between two lines in a log, and before the first
REASON = "BROWNPIPE_REASON"  # environment variable: the file of `give_reason`
Item = TypeVar("Item")

# called with unit, done and total of a stage
listeners: list[Callable[[str, float, int], object]] = []
remark_listeners: list[Callable[[str], object]] = []  # called with every remark, a line
_tracked: list[tuple[str, int, int]] = []  # stages that `tracked` has begun, outermost first
_piece: list[tuple[str, int, int]] = []  # the stage whose next piece has begun


def report(unit: str, done: float, total: int) -> None:
    """Tell the listeners how much is done of the outermost stage; each inner stage is a piece of
    the one around it.
    """
    for outer_unit, outer_done, outer_total in reversed(_tracked):
        unit = outer_unit
        done = outer_done + done / total
        total = outer_total
    for listener in listeners:
        listener(unit, done, total)


def begin_piece(unit: str, done: int, total: int) -> None:
    """Begin the next piece of a stage, after `done` others; `within` reports how much of it is
    done.
    """
    _piece[:] = [(unit, done, total)]


def within(fraction: float) -> None:
    """Report the fraction that is done, from 0 to 1, of the piece begun last."""
    for unit, done, total in _piece:
        report(unit, done + fraction, total)


def tracked(items: Collection[Item], unit: str) -> Iterator[Item]:
    """Yield the items, and report after each how many are done; what is reported within an item are
    fractions of it.
    """
    for done, item in enumerate(items):
        _tracked.append((unit, done, len(items)))
        try:
            yield item
        finally:
            _tracked.pop()
        report(unit, done + 1, len(items))


def remark(text: str) -> None:
    """Tell the listeners a sentence for the user, such as that kernels are compiled."""
    for listener in remark_listeners:
        listener(f"brownpipe: {text}")


@contextmanager
def unreported() -> Iterator[None]:
    """Report no stage in this context, so that CPU times measured in it are of the calculation
    alone.
    """
    suspended = [*listeners]
    listeners.clear()
    try:
        yield
    finally:
        listeners[:] = suspended


# -- the screen ------------------------------------------------------------------------------------


@contextmanager
def shown(title: str, silent: bool = False) -> Iterator[None]:
    """Show the stages and remarks of what is calculated in this context; `title` is its name, such
    as the verb.

    If `silent`, or within another such context, nothing changes.
    """
    if silent or listeners:
        yield
        return
    display = Display()

    def update(unit: str, done: float, total: int) -> None:
        percentage = f"{100 * done / total:.0f} %"
        text = f"{title}: {int(done):,} of {total:,} {unit} ({percentage})"
        display.update(text, done, total)

    listeners.append(update)
    remark_listeners.append(display.say)
    try:
        yield
    finally:
        listeners.remove(update)
        remark_listeners.remove(display.say)
        display.erase()


def relayed(command: Sequence[str]) -> tuple[int, str]:
    """Run a command of brownpipe, and show what it says on standard error, in a notebook, too.

    Return its exit status, and the reason for it if the command gave one to `give_reason`. Ctrl-C
    ends both.
    """
    with TemporaryDirectory() as folder:
        reason = Path(folder, "reason")
        environment = {**os.environ, REASON: str(reason)}
        with subprocess.Popen(
            command, env=environment, stderr=subprocess.PIPE, text=True, errors="replace"
        ) as process:
            try:
                for line in process.stderr or ():
                    print(line, end="", file=sys.stderr, flush=True)
                status = process.wait()
            finally:
                process.terminate()
        return status, reason.read_text() if reason.exists() else ""


def give_reason(text: str) -> None:
    """Give the reason for the exit status of this process, or of a job of its workflow, to a
    `relayed` that runs it. The last reason counts.
    """
    path = os.environ.get(REASON)
    if path:
        with suppress(OSError):  # on another machine of a cluster there is no such file
            Path(path).write_text(text)


class Display:
    """A line of progress and the messages above it. No error of the screen ends a calculation."""

    def __init__(self) -> None:
        is_terminal = getattr(sys.stderr, "isatty", lambda: False)()
        is_dumb = os.environ.get("TERM") == "dumb"
        self.overwrites = (is_terminal and not is_dumb) or "ipykernel" in sys.modules
        self.began = self.first_at = time.monotonic()
        self.due = self.began + (DELAY if self.overwrites else LINE_INTERVAL)
        # of the stage: done at its first report, at its first progress and at its last report; all
        self.start = self.first = self.done = self.total = 0.0
        self.length = 0  # of the line on the screen

    def update(self, text: str, done: float, total: float) -> None:
        """If an update is due, show a text with the elapsed time and the time left, from the pace
        of the stage since its first progress: before, kernels may have been compiled.
        """
        now = time.monotonic()
        if total != self.total or done < self.done:  # another stage, or it begins again
            self.start = self.first = done
            self.total = total
        elif self.first == self.start < done:
            self.first = done
            self.first_at = now
        self.done = done
        if now < self.due:
            return
        self.due = now + (INTERVAL if self.overwrites else LINE_INTERVAL)
        text += f", {_whole_seconds(now - self.began)}"
        if self.start < self.first < done < total:
            pace = (now - self.first_at) / (done - self.first)
            text += f", about {_whole_seconds(pace * (total - done))} to go"
        if self.overwrites:
            self._overwrite(text[: _columns() - 1])
        else:
            self.say(text)

    def say(self, text: str) -> None:
        """Print lines in place of the line of progress; control characters in them are escaped."""
        self.erase()
        with suppress(OSError):
            print(in_lines(text.split("\n")), file=sys.stderr, flush=True)

    def erase(self) -> None:
        """Erase the line of progress."""
        if self.length:
            self._overwrite("")
            self._overwrite("")

    def _overwrite(self, text: str) -> None:
        padded = f"{text:{self.length}}"
        self.length = len(text)  # before it is printed: Ctrl-C may come meanwhile
        with suppress(OSError):
            print(f"\r{padded}", end="", file=sys.stderr, flush=True)


def _columns() -> int:
    """Return the width of the terminal; 80 where it is not known, as in a notebook."""
    with suppress(OSError, ValueError):
        return os.get_terminal_size(sys.stderr.fileno()).columns or 80
    return 80


def _whole_seconds(seconds: float) -> str:
    return in_time(max(round(seconds), 1))
