"""Ctrl-C and SIGTERM end what is under way: their exceptions are not lost and do not wait for a compiler.

Python executes the handler of a signal between two steps of the main thread; the handler raises KeyboardInterrupt or
SystemExit there. This fails in four ways, each with its remedy:

- In a finalizer or in a callback of a weak reference (the import of a module has some) the exception cannot go on:
  Python reports it to `sys.unraisablehook` and continues. `heeded` sends the signal again.
- In llvmlite it would leave objects half made, which are freed twice later, or be lost in a callback of LLVM: `heeded`
  sends the signal again until the main thread is outside.
- A function catches whatever is raised, and continues or raises an error of its own. In a process of the command line,
  `ending_process` sends the signal again after PATIENCE / 2; where the error arrives, `arrived` tells of the signal.
- The main thread is inside a long call of C, such as LLVM's. `ending_process` ends the process after PATIENCE.

As long as an exception is on its way to the end of the process, further signals are ignored: they would interrupt the
removal of unfinished files.
"""

import os
import select
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

SIGNALS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
PATIENCE = 1.5  # s from a signal to the end of a process of the command line, which then takes a moment, too
RETRY = 0.02  # s until the signal of a lost exception is sent again
BINDING = "llvmlite.binding"  # the package that calls LLVM


class Terminated(SystemExit):
    """SIGTERM has arrived."""


class _Heeding:
    """What is known of the signals within `heeded`."""

    def __init__(self) -> None:
        handlers = {number: signal.getsignal(number) or signal.SIG_DFL for number in SIGNALS}
        self.usual: dict[int, Any] = {n: handler for n, handler in handlers.items() if handler != signal.SIG_IGN}
        self.report = sys.unraisablehook
        self.thread = threading.get_ident()
        self.raised: int | None = None  # the signal whose exception is on its way
        self.waiting: dict[int, threading.Timer] = {}  # signals that are going to be sent again
        self.ends_process = False

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Call the usual handler, unless its exception would be lost or do harm."""
        if _is_in_binding(frame):
            self.send_later(number)
        elif not (self.ends_process and self.raised):
            self.raised = number
            if callable(self.usual[number]):
                self.usual[number](number, frame)
            else:
                signal.signal(number, self.usual[number])
                signal.raise_signal(number)

    def unraisable(self, lost: Any) -> None:
        """Be told of a lost exception: send its signal again, or report it as usual."""
        if self.raised is not None and issubclass(lost.exc_type, KeyboardInterrupt | SystemExit):
            self.send_later(self.raised)
        elif not (self.ends_process and self.raised):  # else it is about something half made
            self.report(lost)

    def send_later(self, number: int) -> None:
        """Send a signal again, outside the function that is being executed."""
        self.waiting[number] = timer = threading.Timer(RETRY, self.send, (number,))
        timer.daemon = True
        timer.start()

    def send(self, number: int) -> None:
        """Send a signal again to the main thread."""
        self.waiting.pop(number, None)
        self.raised = None
        with suppress(ProcessLookupError):
            signal.pthread_kill(self.thread, number)


_heeding: list[_Heeding] = []  # one at most
unfinished: set[str] = set()  # files being written, removed when the process ends without having done so


@contextmanager
def heeded() -> Iterator[None]:
    """Within this context no exception is lost that the handlers of SIGINT and SIGTERM raise.

    Within another such context, or in another thread than the main one, nothing changes.
    """
    if _heeding or threading.current_thread() is not threading.main_thread():
        yield
        return
    this = _Heeding()
    _heeding.append(this)
    try:
        for number in this.usual:
            signal.signal(number, this.handle)
        sys.unraisablehook = this.unraisable
        yield
    finally:
        sys.unraisablehook = this.report
        for number, handler in this.usual.items():
            if signal.getsignal(number) == this.handle:
                signal.signal(number, handler)
        _heeding.clear()
        for number, timer in list(this.waiting.items()):
            timer.cancel()
            if not this.ends_process:  # else everything is done
                signal.raise_signal(number)


@contextmanager
def ending_process() -> Iterator[None]:
    """Within this context SIGINT and SIGTERM end the process, with status 130 or 143, at the latest after PATIENCE.

    They raise KeyboardInterrupt and Terminated first. Only the first of several signals counts.
    """
    if _heeding or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, _terminate)
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    ended = threading.Event()
    try:
        with heeded():
            _heeding[0].ends_process = True
            waker = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
            with suppress(RuntimeError):  # there is no memory for a thread, and soon a message about that
                threading.Thread(target=_watch, args=(_heeding[0], reading, ended), daemon=True).start()
            yield
    finally:
        ended.set()
        _remove_unfinished()  # if there are any, two exceptions have followed each other
        signal.set_wakeup_fd(waker)
        os.close(writing)
        signal.signal(signal.SIGTERM, before)


@contextmanager
def passed_on() -> Iterator[None]:
    """Within this context the process waits for another one, which gets the signals, too; it ends after that one."""
    for heeding in _heeding:
        heeding.ends_process = False
    yield


def arrived() -> int | None:
    """Return the signal whose exception was raised within `heeded`, if there was one."""
    return _heeding[0].raised if _heeding else None


def leave(status: int) -> None:
    """Prepare for the end of the process, when an exception would do no more than print a traceback.

    A further signal ends the process at once, or is ignored if it ends because of a first one.
    """
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL if status < 128 else signal.SIG_IGN)


def _terminate(*_: object) -> NoReturn:
    raise Terminated(128 + signal.SIGTERM)


def _watch(heeding: _Heeding, reading: int, ended: threading.Event) -> None:
    """Wait for a signal, of which the C part of Python writes the number to a pipe at once; then see to it."""
    while read := os.read(reading, 1):
        number = read[0]
        if number in heeding.usual and heeding.ends_process:
            if not ended.wait(PATIENCE / 2):
                heeding.send(number)
            if not ended.wait(PATIENCE / 2):
                _remove_unfinished()
                if select.select([], [2], [], 0)[1]:  # else nobody reads stderr, and writing would block
                    os.write(2, f"brownpipe: {SIGNALS[signal.Signals(number)]}\n".encode())
                os._exit(128 + number)
    os.close(reading)


def _remove_unfinished() -> None:
    for file in unfinished.copy():
        with suppress(OSError):
            os.unlink(file)


def _is_in_binding(frame: FrameType | None) -> bool:
    """Whether a frame is of the package that calls LLVM, or was called from there, as Numba's callbacks are."""
    while frame is not None:
        if str(frame.f_globals.get("__name__", "")).startswith(BINDING):
            return True
        frame = frame.f_back
    return False
