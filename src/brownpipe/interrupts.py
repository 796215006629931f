"""Ctrl-C and SIGTERM end what is under way by an exception, but not while machine code is made."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Terminated(SystemExit):
    """SIGTERM has arrived."""


def _terminate(*_: object) -> NoReturn:
    raise Terminated(128 + signal.SIGTERM)


@contextmanager
def terminated_by_exception() -> Iterator[None]:
    """Within this context SIGTERM raises Terminated, as Ctrl-C raises KeyboardInterrupt."""
    with _handled({signal.SIGTERM: _terminate}):
        yield


@contextmanager
def held() -> Iterator[None]:
    """Let signals that arrive in this context wait for its end; handlers are those of the main thread alone."""
    arrived: list[int] = []
    try:
        with _handled(dict.fromkeys(SIGNALS, lambda number, _: arrived.append(number))):
            yield
    finally:
        for number in arrived[:1]:
            signal.raise_signal(number)


@contextmanager
def _handled(handlers: dict) -> Iterator[None]:
    """Handle signals by these handlers in this context; in another thread than the main one nothing changes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def leave() -> None:
    """Let the process end with the status of its work, which is done, whatever signal arrives meanwhile."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
