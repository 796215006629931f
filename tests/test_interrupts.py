"""Ctrl-C and SIGTERM end a command in order: exit status, one line, no half-written file."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest

from brownpipe.processes import held
from brownpipe.storage.files import read_sealed

LONGEST = 60.0  # s for a busy machine to compile the kernels and to end a process
MODULE = (sys.executable, "-m", "brownpipe")
ENDS = [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]


def test_ctrl_c_waits_for_the_compiler():
    done = []

    def compiled():
        with held():
            signal.raise_signal(signal.SIGINT)
            done.append("compiled")
        done.append("run")

    with pytest.raises(KeyboardInterrupt):
        compiled()
    assert done == ["compiled"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_in_another_thread_signals_are_left_to_the_main_one():
    done = []

    def compiled():
        with held():
            done.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=compiled)
    thread.start()
    thread.join()
    assert done == [signal.default_int_handler]


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


@pytest.mark.slow
def test_a_signal_at_a_random_moment_ends_a_simulation(tmp_path, faults):
    """While it compiles or loads machine code, runs and writes."""
    for attempt in faults.tries(2):
        number, status, word = ENDS[attempt % 2]
        apart = {} if faults.random.random() < 0.5 else {"NUMBA_CACHE_DIR": str(tmp_path / "cache" / str(attempt))}
        with tempfile.TemporaryDirectory(dir=tmp_path) as folder:
            (Path(folder) / "scene.yaml").write_text(json.dumps(crowd(1000, 200.0)))
            command, pipe = [*MODULE, "simulate", "scene.yaml", "--record", "all"], subprocess.PIPE
            process = subprocess.Popen(command, cwd=folder, env=os.environ | apart, stderr=pipe, text=True)
            time.sleep(faults.random.uniform(1.0, 9.0 if apart else 3.0))
            process.send_signal(number)
            _, err = process.communicate(timeout=LONGEST)
            assert process.returncode in (0, status) and "Traceback" not in err, err
            assert process.returncode == 0 or re.search(rf"^brownpipe: {word}\n\Z", err, re.MULTILINE)
            left = {path.name for path in Path(folder).rglob("*.*") if path.suffix in (".h5", ".part", ".checkpoint")}
            assert left == {"scene.h5"} if process.returncode == 0 else left <= {"scene.h5"}, (left, process.returncode)
            for file in left:
                read_sealed(f"{folder}/{file}")
