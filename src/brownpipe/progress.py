"""The progress of a calculation on the screen: a bar with the time left, or a line every half a minute in a log.

    with progress.shown("simulate"):
        ...

Everything goes to standard error. A bar is drawn on a terminal and in a notebook, by tqdm, and removed at the end.
"""

import fcntl
import json
import os
import shutil
import sys
import tempfile
import threading
import time
import warnings
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from brownpipe import stages
from brownpipe.formatting import in_time
from brownpipe.opening import opened_unlinked
from brownpipe.quoting import printable
from brownpipe.stages import Stage

DELAY = 2.0  # s of work before a bar is drawn
INTERVAL = 0.2  # s between two updates of the bar
LINE_INTERVAL = 30.0  # s between two lines in a log, and before the first
PACE_TIME = 2.0  # s of reports before the time left is estimated
PERCENT_BELOW = 100  # pieces; with fewer, the percentage says more than their number
NOTES = "BROWNPIPE_PROGRESS"  # environment variable: folder in which the jobs of a study note their progress
FOLDER = "brownpipe-progress-"  # the name of this folder begins with this
TIME_TO_LOCK = 60.0  # s, in which a new folder is locked by its process


@contextmanager
def shown(title: str, silent: bool = False, output: str | None = None) -> Iterator[None]:
    """Show the progress of what is calculated in this context; `title` is its name, such as the verb.

    A study is told it with the file `output` that is made, so that it knows which of its jobs this is. Remarks on the
    compiling of kernels are printed, too. If `silent`, within another such context, or without standard error, nothing
    changes.
    """
    if silent or stages.listeners or sys.stderr is None:
        yield
        return
    display = Display(title, output)
    stages.listeners.append(display.update)
    stages.remark_listeners.append(display.remark)
    ticker = threading.Thread(target=display.tick, daemon=True)
    ticker.start()
    try:
        yield
    finally:
        stages.listeners.remove(display.update)
        stages.remark_listeners.remove(display.remark)
        display.closed.set()
        ticker.join(timeout=2.0)  # longer only if the terminal takes no more text
        if not ticker.is_alive():
            display.close()


@contextmanager
def folder_of_notes() -> Iterator[None]:
    """Have a temporary folder in this context, named in the environment, in which jobs note their progress.

    It is locked until this process ends, however that is. Folders that a killed process has left are removed first.
    """
    _remove_abandoned(Path(tempfile.gettempdir()))
    with tempfile.TemporaryDirectory(prefix=FOLDER) as folder:
        handle = _locked(folder)
        os.environ[NOTES] = folder
        try:
            yield
        finally:
            os.environ.pop(NOTES, None)
            if handle is not None:
                os.close(handle)


def _remove_abandoned(place: Path) -> None:
    """Remove the folders of this user with notes alone, named by processes, that no process has locked."""
    for folder in place.glob(f"{FOLDER}*"):
        with suppress(OSError):
            is_new = time.time() - folder.lstat().st_mtime < TIME_TO_LOCK
            handle = None if is_new else _locked(folder)
            if handle is not None:
                if all(name.isdecimal() for name in os.listdir(folder)):
                    shutil.rmtree(folder, ignore_errors=True)
                os.close(handle)


def _locked(folder: str | Path) -> int | None:
    """Lock a folder of this user until the handle that is returned is closed, or the process ends.

    Return None if another process has locked it, or if it cannot be locked. A link is not followed.
    """
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    with suppress(OSError):
        if os.fstat(handle).st_uid == os.getuid():
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return handle
    os.close(handle)
    return None


class Display:
    """The progress of one calculation.

    The calculation itself reports, and a thread draws, so that the times go on where reports are rare, and Ctrl-C,
    which interrupts the calculation, never interrupts a drawing (tqdm would keep its lock, and then wait for it).
    Only in a notebook, whose outputs belong to the main thread, the calculation draws.
    """

    def __init__(self, title: str, output: str | None = None) -> None:
        self.title, self.output = title, output
        self.in_notebook = _in_notebook()
        self.draws_bar = self.in_notebook or (_is_terminal() and os.environ.get("TERM") != "dumb")
        self.bar: Any = None  # of tqdm, once it is drawn
        self.stage: Stage | None = None  # the last that was reported
        self.pace = Pace()  # of this stage
        self.paces: dict[tuple[str, float], Pace] = {}  # by unit and total, as stages may alternate
        self.remarks: deque[str] = deque()  # to be printed
        self.began = time.monotonic()
        self.due = self.began + (DELAY if self.draws_bar else LINE_INTERVAL)
        folder = os.environ.get(NOTES)
        self.note = Path(folder) / str(os.getpid()) if folder else None
        self.closed = threading.Event()

    def update(self, stage: Stage) -> None:
        """Take a report on a stage."""
        self.pace = self.paces.setdefault((stage.unit, stage.total), Pace())
        self.pace.update(time.monotonic(), stage.done)
        self.stage = stage
        if self.in_notebook:
            self.show()

    def remark(self, text: str) -> None:
        """Take a remark, to be printed above the bar."""
        self.remarks.append(text)
        if self.in_notebook:
            self.show()

    def tick(self) -> None:
        """Until the display is closed, show what is due and note the progress for the study."""
        while not self.closed.wait(INTERVAL):
            if not self.in_notebook:
                self.show()
            if self.note is not None and self.stage is not None:
                left = self.pace.left(time.monotonic(), self.stage.total)
                with suppress(OSError), open(self.note, "w", opener=opened_unlinked) as note:
                    note.write(json.dumps([self.title, self.output, left, *self.stage]))

    def show(self) -> None:
        """Print the remarks; draw the bar or print a line if it is due. No error of the screen ends a calculation."""
        now = time.monotonic()
        with suppress(OSError, ValueError):
            while self.remarks:
                if self.bar is not None:
                    self.bar.clear()
                print("brownpipe:", printable(self.remarks.popleft()), file=sys.stderr, flush=True)
            if now >= self.due:
                self.due = now + (INTERVAL if self.draws_bar else LINE_INTERVAL)
                left = None if self.stage is None else self.pace.left(now, self.stage.total)
                text = line(self.title, self.stage, now - self.began, left)
                if self.draws_bar:
                    self.draw(text)
                else:
                    print(text, file=sys.stderr, flush=True)

    def draw(self, text: str) -> None:
        """Draw the bar with a text on its left."""
        done = 0.0 if self.stage is None else _fraction(self.stage)
        if self.bar is None:
            self.bar = _new_bar(text, done)
        self.bar.n = done
        self.bar.set_description_str(text)

    def close(self) -> None:
        """Print what remarks are left; remove the bar and the note."""
        self.due = float("inf")
        self.show()
        with suppress(OSError, ValueError):
            if self.bar is not None:
                self.bar.close()
        if self.note is not None:
            self.note.unlink(missing_ok=True)


class Pace:
    """The speed of a stage, from its first report to the last in which more was done."""

    def __init__(self) -> None:
        self.first = self.last = (0.0, float("inf"))  # time [s], pieces done

    def update(self, now: float, done: float) -> None:
        """Take a report at the time `now` [s]; if less is done than at the first one, the stage begins again."""
        if done < self.first[1]:
            self.first = self.last = (now, done)
        elif done != self.last[1]:
            self.last = (now, done)

    def left(self, now: float, total: float) -> float | None:
        """Return the time left [s]; None before PACE_TIME has passed between two reports, and at the end."""
        (began, before), (ended, done) = self.first, self.last
        if ended - began < PACE_TIME or done >= total:
            return None
        return max(0.0, (ended - began) / (done - before) * (total - done) - (now - ended))


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


def _new_bar(text: str, done: float) -> Any:
    """Return a bar of tqdm, of which a fraction is `done`, for a notebook or a terminal."""
    with warnings.catch_warnings():  # a notebook without ipywidgets: the bar is drawn as on a terminal
        warnings.simplefilter("ignore")
        from tqdm.auto import tqdm
    style: dict[str, Any] = {"bar_format": "{desc} |{bar}|", "leave": False, "dynamic_ncols": True, "file": sys.stderr}
    return tqdm(desc=text, total=1.0, initial=done, **style)


def _is_terminal() -> bool:
    """Whether standard error is a terminal; an object in its place need not know."""
    with suppress(AttributeError, ValueError):
        return sys.stderr.isatty()
    return False


def _in_notebook() -> bool:
    """Whether this process is the kernel of a notebook, as tqdm finds out."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and "IPKernelApp" in shell.config
