"""Ctrl-C and SIGTERM: no exception is lost, none waits for a compiler, and nothing half-written stays."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from pathlib import Path

import pytest

from brownpipe import interrupts
from brownpipe.cli import main
from brownpipe.errors import WRONG_REQUEST
from brownpipe.storage.files import read_sealed

SLACK = 15.0  # s for a busy machine to end a process or to start one
PYTHON = (sys.executable, "-c")
MODULE = (sys.executable, "-m", "brownpipe")


class Owner:
    """Something that weak references can point to."""


def interrupt_itself(*_):
    signal.raise_signal(signal.SIGINT)


def in_weak_reference():
    owner = Owner()
    reference = weakref.ref(owner, interrupt_itself)
    del owner
    assert reference() is None


def in_finalizer():
    class Ended:
        __del__ = interrupt_itself

    Ended()


def in_llvmlite():
    """In a function of llvmlite: objects would be half made, and from a callback of LLVM no exception goes on."""
    code = compile("interrupt()", "binding.py", "exec")
    exec(code, {"__name__": f"{interrupts.BINDING}.executionengine", "interrupt": interrupt_itself})


@pytest.mark.promise(
    "Ctrl-C or SIGTERM while Python is in a callback, a finalizer or an import",
    "the exception is not lost: it is raised again as soon as it can go on",
)
@pytest.mark.parametrize("lose", [in_weak_reference, in_finalizer, in_llvmlite])
def test_an_exception_that_python_would_ignore_is_raised_again(lose):
    done, usual = [], (signal.getsignal(signal.SIGINT), sys.unraisablehook)

    def lost():
        with interrupts.heeded():
            lose()
            done.append("continued")
            time.sleep(SLACK)
            done.append("not interrupted")

    with pytest.raises(KeyboardInterrupt):
        lost()
    assert done == ["continued"]
    assert (signal.getsignal(signal.SIGINT), sys.unraisablehook) == usual


def test_without_memory_for_a_thread_the_verb_says_so(monkeypatch, capsys):
    def no_memory(_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", no_memory)
    assert main(["inspect", "absent.h5"]) == WRONG_REQUEST
    assert capsys.readouterr().err.count("\n") == 1


def test_ctrl_c_in_llvmlite_is_heeded_afterwards():
    done = []

    def compiled():
        with interrupts.heeded():
            in_llvmlite()
            done.append("called back")

    with pytest.raises(KeyboardInterrupt):
        compiled()
    assert done == ["called back"]


def test_ctrl_c_while_compiling_is_heeded_at_once():
    done = []

    def compiled():
        with interrupts.heeded():
            signal.raise_signal(signal.SIGINT)
            done.append("compiled")

    with pytest.raises(KeyboardInterrupt):
        compiled()
    assert done == []
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_other_exceptions_in_finalizers_are_reported_as_usual(monkeypatch):
    reported = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: reported.append(lost.exc_type))

    class Ended:
        def __del__(self):
            raise ZeroDivisionError

    with interrupts.heeded():
        Ended()
    assert reported == [ZeroDivisionError]


# -- a process of the command line ----------------------------------------------------------------------------------

PROCESS = """
import ctypes, hashlib, sys, time, weakref
from brownpipe import cli, interrupts
interrupts.PATIENCE = 0.6

def weak_reference():
    class Owner: pass
    owner = Owner()
    reference = weakref.ref(owner, lambda _: wait())
    del owner
    time.sleep(60)

def c_callback():
    kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    ctypes.CDLL(None).qsort((ctypes.c_int * 2)(2, 1), 2, 4, kind(lambda *_: wait() or 0))
    time.sleep(60)

def bare_except():
    try:
        wait()
    except:
        pass
    time.sleep(60)

def endless_excepts():
    while True:
        try:
            wait()
        except:
            pass

def call_of_c():
    interrupts.unfinished.add("x.part")
    open("x.part", "w").close()
    print("on", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 200_000_000)

def slow_cleanup():
    open("x.part", "w").close()
    try:
        wait()
    finally:
        print("on", flush=True)
        time.sleep(0.2)
        __import__("os").remove("x.part")

def wait():
    print("on", flush=True)
    time.sleep(60)

def verb(_):
    globals()[sys.argv[1]]()
    print("finished")

cli.build_parser = lambda _: type("", (), {"parse_args": lambda *_: type("", (), {"verb": verb})})
sys.exit(cli.main())
"""


@pytest.mark.slow
@pytest.mark.promise(
    "Ctrl-C or SIGTERM in code that ignores exceptions or calls a compiler",
    "the process ends within some two seconds with status 130 or 143 and one line, and removes unfinished files",
)
@pytest.mark.parametrize(
    "place", ["weak_reference", "c_callback", "bare_except", "endless_excepts", "call_of_c", "slow_cleanup"]
)
def test_a_signal_ends_the_process_wherever_it_arrives(tmp_path, faults, place):
    number, status, word = faults.random.choice(ENDS)
    with started([*PYTHON, PROCESS, place], tmp_path) as process:
        assert process.stdout.readline() == "on\n"
        process.send_signal(number)
        if place == "slow_cleanup":
            assert process.stdout.readline() == "on\n"
            process.send_signal(faults.random.choice(ENDS)[0])  # a second one does not disturb
        out, err = process.communicate(timeout=SLACK)
    assert (process.returncode, err) == (status, f"brownpipe: {word}\n")
    assert "finished" not in out and list(tmp_path.iterdir()) == []


ENDS = [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]


class started:  # noqa: N801  # a context manager
    """A process that is killed at the end of the context, if it has not ended."""

    def __init__(self, command, folder, **environment):
        pipe = subprocess.PIPE
        settings = os.environ | environment
        self.process = subprocess.Popen(command, cwd=folder, env=settings, stdout=pipe, stderr=pipe, text=True)

    def __enter__(self):
        return self.process

    def __exit__(self, *_):
        self.process.kill()
        self.process.communicate()


def crowd(particles, duration):
    """A scene of a bath alone."""
    side = 1.75 * particles**0.5
    return {
        "box": {"x": [0.0, side], "y": [0.0, side], "boundary": "periodic"},
        "particles": particles,
        "disks": {"species": [{"name": "bath", "count": "rest", "radius": 0.5, "mass": 1.0}], "placement": "random"},
        "velocities": {"temperature": 1.0},
        "duration": duration,
        "sample_interval": duration,
    }


NUMPY = """
import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
except BaseException as error:
    raise ImportError("a page of advice") from error
"""


def test_ctrl_c_of_which_an_import_makes_an_error_of_its_own_ends_the_process_in_one_line(tmp_path):
    """In place of NumPy a package that turns KeyboardInterrupt into ImportError, as NumPy does."""
    (tmp_path / "numpy.py").write_text(NUMPY)
    (tmp_path / "scene.yaml").write_text(json.dumps(crowd(10, 1.0)))
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    with started([*MODULE, "check", "scene.yaml"], tmp_path, PYTHONPATH=path) as process:
        assert process.communicate(timeout=SLACK) == ("", "brownpipe: interrupted\n")
    assert process.returncode == 128 + signal.SIGINT


CASES = {  # particles, duration, with machine code on disk, seconds in which the signal arrives
    "running": (1000, 100.0, True, 2.5),
    "compiling": (1000, 100.0, False, 9.0),
    "running a large scene": (3_000_000, 0.02, True, 30.0),
}


@pytest.mark.slow
@pytest.mark.promise(
    "Ctrl-C or SIGTERM at any moment of a simulation",
    "the process ends within some two seconds, also while it compiles, and leaves no half-written file",
)
def test_a_signal_at_a_random_moment_ends_a_simulation(tmp_path, faults):
    """While it imports, compiles, loads machine code, runs and writes; large scenes are for the long tests alone."""
    cases = [name for name, case in CASES.items() if case[0] < 10_000 or faults.factor > 1]
    waits = []
    for attempt in faults.tries(2):
        particles, duration, is_compiled, longest = CASES[cases[attempt % len(cases)]]
        number, status, word = faults.random.choice(ENDS)
        delay = faults.random.uniform(0.0, longest)
        with tempfile.TemporaryDirectory(dir=tmp_path) as folder:
            (Path(folder) / "scene.yaml").write_text(json.dumps(crowd(particles, duration)))
            apart = {} if is_compiled else {"NUMBA_CACHE_DIR": f"{folder}/cache"}
            with started([*MODULE, "simulate", "scene.yaml", "--record", "all"], folder, **apart) as process:
                time.sleep(delay)
                process.send_signal(number)
                began = time.monotonic()
                _, err = process.communicate(timeout=SLACK)
            wait = time.monotonic() - began
            assert wait < 2.5 * max(1.0, os.getloadavg()[0] / os.cpu_count())  # other processes delay it, too
            waits.append(round(wait, 2))
            fails_to_start = process.returncode == 1 and not re.search(r"^brownpipe: |src.brownpipe", err, re.MULTILINE)
            if not fails_to_start and process.returncode != -number:  # else Python had not yet begun with brownpipe
                assert process.returncode in (0, status), err
                assert process.returncode == 0 or re.search(rf"^brownpipe: {word}\n\Z", err, re.MULTILINE)
                assert "Traceback" not in err and "ignored" not in err
            left = {path.name for path in Path(folder).rglob("*.*") if path.suffix in (".h5", ".part", ".checkpoint")}
            assert left == {"scene.h5"} if process.returncode == 0 else left <= {"scene.h5"}, (left, process.returncode)
            for file in left:
                read_sealed(f"{folder}/{file}")
    print("seconds until the end of the processes:", *sorted(waits))
