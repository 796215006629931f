"""The progress of a calculation on the screen: a bar with the time left, or a line every half a minute in a log.

    with progress.shown("simulate"):
        ...

Everything goes to standard error. A bar is drawn on a terminal and in a notebook, by tqdm, and removed at the end.
"""

import os
import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from brownpipe import stages
from brownpipe.formatting import in_time
from brownpipe.quoting import printable
from brownpipe.stages import Stage

DELAY = 2.0  # s of work before a bar is drawn
INTERVAL = 0.2  # s between two updates of the bar
LINE_INTERVAL = 30.0  # s between two lines in a log, and before the first
PACE_TIME = 2.0  # s of reports before the time left is estimated
PERCENT_BELOW = 100  # pieces; with fewer, the percentage says more than their number


@contextmanager
def shown(title: str, silent: bool = False) -> Iterator[None]:
    """Show the progress of what is calculated in this context; `title` is its name, such as the verb.

    Remarks on the compiling of kernels are printed, too. If `silent`, or within another such context, nothing changes.
    """
    if silent or stages.listeners:
        yield
        return
    display = Display(title)
    stages.listeners.append(display.update)
    stages.remark_listeners.append(display.remark)
    try:
        yield
    finally:
        stages.listeners.remove(display.update)
        stages.remark_listeners.remove(display.remark)
        if display.bar is not None:
            display.bar.close()


class Display:
    """The progress of one calculation, drawn when the calculation reports."""

    def __init__(self, title: str) -> None:
        self.title = title
        self.draws_bar = _in_notebook() or (_on_terminal() and os.environ.get("TERM") != "dumb")
        self.bar: Any = None  # of tqdm, once it is drawn
        self.paces: dict[tuple[str, float], Pace] = defaultdict(Pace)  # by unit and total, as stages may alternate
        self.began = time.monotonic()
        self.due = self.began + (DELAY if self.draws_bar else LINE_INTERVAL)

    def update(self, stage: Stage) -> None:
        """Draw the bar or print a line if it is due. No error of the screen ends a calculation."""
        now = time.monotonic()
        left = self.paces[stage.unit, stage.total].left(now, stage.done, stage.total)
        if now < self.due:
            return
        self.due = now + (INTERVAL if self.draws_bar else LINE_INTERVAL)
        text = line(self.title, stage, now - self.began, left)
        with suppress(OSError):
            if not self.draws_bar:
                print(text, file=sys.stderr, flush=True)
                return
            self.bar = self.bar or _new_bar()
            self.bar.n = _fraction(stage)
            self.bar.set_description_str(text)

    def remark(self, text: str) -> None:
        """Print a remark above the bar."""
        if self.bar is not None:
            self.bar.clear()
        with suppress(OSError):
            print("brownpipe:", printable(text), file=sys.stderr, flush=True)


class Pace:
    """The speed of a stage since it began, or began again."""

    def __init__(self) -> None:
        self.began, self.before = 0.0, 0.0  # time of the first report [s], and the pieces done then
        self.done = float("inf")  # pieces, at the last report

    def left(self, now: float, done: float, total: float) -> float | None:
        """Take a report at the time `now` [s]; return the time left [s], None if it cannot be said or all is done."""
        if done < self.done:
            self.began, self.before = now, done
        self.done = done
        if now - self.began < PACE_TIME or not self.before < done < total:
            return None
        return (now - self.began) / (done - self.before) * (total - done)


def line(title: str, stage: Stage | None, seconds: float, left: float | None = None) -> str:
    """Return a line: what is calculated, how much of it is done, the time taken and, if known, the time left [s]."""
    parts = [] if stage is None else [_amount(stage)]
    parts.append(_whole_seconds(seconds))
    if left is not None:
        parts.append(f"about {_whole_seconds(left)} to go")
    return printable(f"{title}: {', '.join(parts)}")


def _whole_seconds(seconds: float) -> str:
    return in_time(max(round(seconds), 1))


def _amount(stage: Stage) -> str:
    """Return how much of a stage is done: `1,200 of 2,400 runs`, `3 of 8 runs (41 %)` or `41 % of the run`."""
    percentage = f"{100 * _fraction(stage):.0f} %"
    if stage.total == 1:
        return f"{percentage} of the {stage.unit.removesuffix('s')}"
    amount = f"{int(stage.done):,} of {int(stage.total):,} {stage.unit}"
    return f"{amount} ({percentage})" if stage.total < PERCENT_BELOW else amount


def _fraction(stage: Stage) -> float:
    """Return the fraction of a stage that is done, from 0 to 1."""
    return min(stage.done / stage.total, 1.0) if stage.total else 1.0


def _new_bar() -> Any:
    """Return a bar of tqdm for a notebook or a terminal."""
    with warnings.catch_warnings():  # a notebook without ipywidgets: the bar is drawn as on a terminal
        warnings.simplefilter("ignore")
        from tqdm.auto import tqdm
    return tqdm(total=1.0, bar_format="{desc} |{bar}|", leave=False, dynamic_ncols=True, file=sys.stderr)


def _on_terminal() -> bool:
    """Whether there is a standard error, and it is a terminal: a program without a console has none."""
    return getattr(sys.stderr, "isatty", lambda: False)()


def _in_notebook() -> bool:
    """Whether this process is the kernel of a notebook, as tqdm finds out."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and "IPKernelApp" in shell.config
