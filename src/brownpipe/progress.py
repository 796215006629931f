"""What `simulate` shows on the screen while it runs: what is compiled and, on a terminal, how many runs are done."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from brownpipe.engines import batch, kernels
from brownpipe.formatting import in_time

INTERVAL = 0.2  # s between two updates of the counter


@contextmanager
def shown(say: Callable[[str], object]) -> Iterator[None]:
    """Pass messages about compilation to `say`; on a terminal, show the number of finished runs in its last line."""
    listeners: list[tuple[list, Callable]] = [(kernels.on_compile, say)]
    if sys.stderr.isatty():
        listeners.append((batch.on_entry, _counter()))
    for events, listener in listeners:
        events.append(listener)
    try:
        yield
    finally:
        for events, listener in listeners:
            events.remove(listener)
        if sys.stderr.isatty():
            _rewrite("")


def _counter() -> Callable[[int, int], None]:
    """Return a listener for `batch.on_entry` that shows the number of finished runs and the time left.

    The clock starts at its first call, so that compiling and preparing do not count.
    """
    first = shown_at = began = None

    def update(done: int, runs: int) -> None:
        nonlocal first, shown_at, began
        now = time.monotonic()
        if first is None:
            first, began, shown_at = done, now, now - 2 * INTERVAL
        if now - shown_at > INTERVAL:
            left = f", about {in_time((now - began) / (done - first) * (runs - done))} to go" if done > first else ""
            _rewrite(f"{done:,} of {runs:,} runs done{left}")
            shown_at = now

    return update


def _rewrite(text: str) -> None:
    """Replace the last line of the terminal."""
    sys.stderr.write(f"\r\033[K{text}")
    sys.stderr.flush()
