"""Compile the kernels of a scene before its first run, or load their machine code; each once on a machine.

A process takes a lock only to compile: `FILE.lock` beside the file of machine code that it is going to write. It waits
for another process no longer than `LONGEST_WAIT`, and where the file system has no locks it compiles without one. Two
processes that compile the same kernel write the same file, one after the other.
"""

import errno
import fcntl
import mmap
import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from numba.core import event

from brownpipe import interrupts
from brownpipe.engines.compiled import KernelCall, disk_cache, file_of, is_compiled
from brownpipe.engines.kernel_cache import remarks, remarks_at_compiling, tell, tell_all

LEAST_MEMORY = 100_000_000  # bytes of address space; to compile the kernels takes 57 MB, to load them 18 MB
SILENT_WAIT = 2.0  # seconds of waiting for another process before the listeners are told
LONGEST_WAIT = 60.0  # seconds of waiting; some 8 times what it takes to compile on a quiet machine
POLL = 0.1  # seconds between two attempts to take a lock
HELD = (errno.EWOULDBLOCK, errno.EACCES)  # errors of a lock that another process holds


def compile_all(calls: Iterable[KernelCall]) -> None:
    """Compile the kernels, or load their machine code.

    Ctrl-C and SIGTERM interrupt this, at the latest after a call of LLVM (up to a second on a quiet machine).
    Raises OSError (ENOMEM) if there is too little memory for LLVM, which would end the process without a word.
    """
    mmap.mmap(-1, LEAST_MEMORY).close()  # nothing of it is used
    tell_all(remarks)
    with interrupts.heeded(), event.install_listener("numba:compile", _FirstKernel()):
        for call in calls:
            cache = disk_cache(call)
            if cache is not None:
                cache.touch()
            if cache is None or is_compiled(call):
                call.function(*call.arguments)
            else:
                with one_compiler(file_of(call), call.function.__name__):
                    call.function(*call.arguments)


@contextmanager
def one_compiler(file: Path, name: str) -> Iterator[None]:
    """Let only one process at a time compile a kernel; `file` is that of its machine code.

    Those that wait are told the `name` of the kernel.
    """
    try:
        file.parent.mkdir(mode=0o700, exist_ok=True)  # it may have been removed meanwhile
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
        lock = os.open(f"{file}.lock", flags, 0o600)  # that another user cannot open, let alone hold
    except OSError:
        yield
        return
    try:
        if _take(lock, name):
            with suppress(OSError):
                os.ftruncate(lock, 0)
                os.pwrite(lock, f"process {os.getpid()} on {os.uname().nodename}".encode(), 0)
        yield
    finally:
        os.close(lock)


def _take(lock: int, name: str) -> bool:
    """Lock a file, or wait until its lock is free; return False if it is still held after LONGEST_WAIT or has no locks.

    The listeners are told if this takes more than SILENT_WAIT.
    """
    began, is_told = time.monotonic(), False
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except OSError as error:
            if error.errno not in HELD:  # ENOLCK, ENOSYS, EOPNOTSUPP
                return False
        waited = time.monotonic() - began
        if waited > LONGEST_WAIT:
            tell(f"{_holder(lock)} has compiled the kernel {name} for {waited:.0f} s: it is compiled here, too")
            return False
        if waited > SILENT_WAIT and not is_told:
            tell(f"waiting for {_holder(lock)}, which compiles the kernel {name}; for {LONGEST_WAIT:.0f} s at most")
            is_told = True
        time.sleep(POLL)


def _holder(lock: int) -> str:
    """Return which process holds a lock, by what it has written into the file."""
    with suppress(OSError, UnicodeDecodeError):
        if (text := os.pread(lock, 200, 0).decode("ascii")) and text.isprintable():
            return text
    return "another process"


class _FirstKernel(event.Listener):
    """Tell the listeners at the first kernel that is compiled because the cache does not have it."""

    told = False

    def on_start(self, _: event.Event) -> None:
        if not self.told:
            tell("compiling the kernels for this kind of scene, once per machine: about 8 s")
            tell_all(remarks_at_compiling)
        self.told = True

    def on_end(self, _: event.Event) -> None:
        pass
