"""No kernel that places or moves disks reads or writes outside its arrays, however elongated the
box.

Compiled kernels do not check indices. Here they run as plain Python (NUMBA_DISABLE_JIT) on arrays
that refuse every index outside 0 <= i < n, negative ones too, which NumPy would take as counted
from the end.
"""

import os
import subprocess
import sys
from itertools import cycle, product
from pathlib import Path

import numpy as np
import pytest

from brownpipe.engines.exact import run as exact_run
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.start import initial_state
from brownpipe.engines.timestep import largest_step
from brownpipe.engines.timestep import simulation as timestep
from brownpipe.scene import parse_scene
from scenes import CHANNEL_X, CHANNEL_Y, PERIODIC, WALLS

ASPECTS = (1, 7, 5000)
COUNTS = (1, 2, 3, 7, 20, 36)
SIDE = 1.0  # of the box, the shorter one
EVENTS = 60  # collisions of a disk that flies alone, at most, in a run
INTEGER = (int, np.integer)


class Checked(np.ndarray):
    """An array that refuses indices outside it."""

    def __getitem__(self, index):
        _refuse_outside(self, index)
        return super().__getitem__(index)

    def __setitem__(self, index, value):
        _refuse_outside(self, index)
        super().__setitem__(index, value)


def _refuse_outside(array, index):
    if isinstance(index, INTEGER) and 0 <= index < len(array):  # nearly all of them
        return
    each = index if isinstance(index, tuple) else (index,)
    if Ellipsis in [one for one in each if not isinstance(one, np.ndarray)]:
        at = next(k for k, one in enumerate(each) if one is Ellipsis)
        each = (*each[:at], *(slice(None),) * (array.ndim - len(each) + 1), *each[at + 1 :])
    for axis, (given, size) in enumerate(zip(each, array.shape, strict=False)):
        if isinstance(given, INTEGER):
            inside = 0 <= given < size
        elif isinstance(given, slice):
            inside = (given.start or 0) >= 0 and (given.stop is None or given.stop <= size)
        elif isinstance(given, np.ndarray) and given.dtype.kind in "iu":
            inside = np.all((given >= 0) & (given < size))
        else:  # a mask, None or ...
            continue
        if not inside:
            raise IndexError(f"index {given} of axis {axis} with size {size}")


def checked(record):
    """A workspace or a recorder whose arrays, at any depth, are checked."""
    if isinstance(record, np.ndarray):
        return record.view(Checked)
    if isinstance(record, tuple) and hasattr(record, "_fields"):
        return type(record)(*map(checked, record))
    return record


BOUNDARIES = [WALLS, PERIODIC, CHANNEL_X, CHANNEL_Y]


def scenes():
    """Boxes of every shape and boundary with few disks or many, equal, of two sizes, with a big
    one, and crowded.
    """
    for aspect, boundary, n in product(ASPECTS, BOUNDARIES, COUNTS):
        crowd = 0.16 if aspect * SIDE**2 > n / 6 else 0.04
        yield scene(aspect, boundary, [(n, crowd, 1.0)])
    for boundary in BOUNDARIES:
        yield scene(7, boundary, [(10, 0.1, 1.0), (10, 0.14, 0.3)])
        yield scene(50, boundary, [(1, 0.25, 5.0), (40, 0.02, 1.0)])
        yield scene(2, boundary, [(30, 0.115, 1.0)], "lattice")


def scene(aspect, boundary, kinds, placement="random"):
    """A scene of species from (count, radius, mass) each; of both axes, each is the longer one
    once.
    """
    long, n = [0.0, SIDE * aspect], sum(count for count, _, _ in kinds)
    x, y = (long, [0.0, SIDE]) if n % 2 else ([0.0, SIDE], long)
    species = [
        {"name": f"s{k}", "count": n, "radius": r, "mass": m} for k, (n, r, m) in enumerate(kinds)
    ]
    duration = max(0.3, EVENTS / 50 / n)
    return parse_scene(
        {
            "box": {"x": x, "y": y, "boundary": boundary},
            "disks": {"species": species, "placement": placement},
            "velocities": {"standard_deviation": 1.0},
            "duration": duration,
            "sample_interval": duration / 3,
        },
        f"{BOUNDARIES.index(boundary)}_{aspect}_{n}.yaml",
    )


def run_exact():
    """Run every scene by the exact engine, with all that can be recorded."""
    _check(exact_run, "new_workspace", "new_recorder")
    for one in scenes():
        assert not exact.simulate(one, [1], {"all", "events"}).observables["failed"][0], one.name


def run_timestep():
    """Run every scene in steps, some so long that the neighbour lists are made at each of them."""
    _check(timestep, "new_workspace", "new_recorder")
    for one, steps in zip(
        scenes(), cycle([12, 60, 12, 60, 12])
    ):  # five against six COUNTS: each meets both
        step = min(one.duration / steps, 0.9 * largest_step(one))
        assert not timestep.simulate(one, [1], {"all"}, time_step=step).observables["failed"][0], (
            one.name
        )


def _check(engine, *names):
    """Let the arrays that an engine makes under these names be checked, and those that disks are
    placed in.
    """
    for name in names:
        made = getattr(engine, name)
        setattr(engine, name, lambda *given, made=made: checked(made(*given)))
    insert = initial_state.insert_disks
    initial_state.insert_disks = lambda *arrays: insert(*map(checked, arrays))


@pytest.mark.slow
def test_every_index_lies_within_its_array():
    folders = Path(__file__).parent, Path(exact.__file__).parents[3]
    plain = os.environ | {
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": os.pathsep.join(map(str, folders)),
    }
    code = "import test_bounds; test_bounds.run_exact(); test_bounds.run_timestep()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=plain, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[-2000:]


def test_an_index_outside_is_seen():
    """The instrument itself: both ends of each axis."""
    array = checked(np.zeros((3, 2)))
    array[2, 1] = array[0:3, 0].sum()
    for outside in (-1, 3, (0, 2), (0, -1), slice(1, 4), slice(-1, 2), np.array([0, 3])):
        with pytest.raises(IndexError):
            array[outside]
