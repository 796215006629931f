"""Scenes that several files of tests use, and functions of tests in plain Python."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np

import brownpipe
from brownpipe.engines.start.initial_state import draw_state
from brownpipe.engines.units import State
from brownpipe.scene import parse_scene

WALLS = "reflecting"  # the boundary of a box
PERIODIC = "periodic"
CHANNEL_X = {"x": PERIODIC, "y": WALLS}
CHANNEL_Y = {"x": WALLS, "y": PERIODIC}


def box(width, height, boundary, origin=(0.0, 0.0)):
    x, y = origin
    return {
        "x": [x - width / 2, x + width / 2],
        "y": [y - height / 2, y + height / 2],
        "boundary": boundary,
    }


def species(*kinds):
    """Species from (count, radius, mass) each."""
    return [
        {"name": f"s{j}", "count": n, "radius": r, "mass": m} for j, (n, r, m) in enumerate(kinds)
    ]


def mixture(where, kinds, duration, tracer=None, velocities=None, **more):
    disks = {"species": species(*kinds)}
    if tracer is not None:
        disks["tracer"] = tracer
    mapping = {"box": where, "disks": disks, "duration": duration}
    velocities = {"zero_momentum": False} | (velocities or {"standard_deviation": 1.0})
    return parse_scene(mapping | {"velocities": velocities} | more, "made.yaml")


def scene_of_state(where, state, duration, **more):
    """The scene that begins with this state."""
    keys = ("position", "velocity", "radius", "mass")
    rows = zip(*(column.tolist() for column in state), strict=True)
    disks = [dict(zip(keys, row, strict=True)) for row in rows]
    return parse_scene({"box": where, "disks": disks, "duration": duration} | more, "explicit.yaml")


def crystal(side, gap, duration, **more):
    """A triangular lattice of side x side disks of diameter 1 in a periodic box, gaps in units of
    the diameter.
    """
    a = 1.0 + gap
    width = side * a
    height = side * a * np.sqrt(0.75)
    row, column = np.divmod(np.arange(side * side), side)
    position = np.stack(
        [(column + 0.5 * (row % 2) + 0.25) * a, (row + 0.5) * height / side], axis=1
    )
    velocity = np.random.default_rng(1).standard_normal(position.shape)
    state = State(
        position, velocity - velocity.mean(axis=0), np.full(side**2, 0.5), np.ones(side**2)
    )
    return scene_of_state(
        box(width, float(height), "periodic", (width / 2, float(height) / 2)),
        state,
        duration,
        **more,
    )


def swarm(duration):
    """Twenty disks, and 200 much smaller ones of which a cell holds more than anybody would
    expect.
    """
    rng = np.random.default_rng(5)
    large = np.stack(np.divmod(np.arange(20), 5), axis=1) * [1.2, 1.0] + [-2.0, -2.0]
    small = np.stack(np.divmod(np.arange(200), 20), axis=1) * 0.012 + [-1.5, -1.5]
    radius = np.repeat([0.3, 0.004], [20, 200])
    mass = np.repeat([1.0, 0.5], [20, 200])
    state = State(np.concatenate([large, small]), rng.standard_normal((220, 2)), radius, mass)
    return scene_of_state(box(6, 6, "reflecting"), state, duration)


def from_lattice(where, kinds, duration):
    """Disks that begin on a lattice; between walls not in contact with these, which would be many
    events at t = 0.
    """
    inner = {}
    for axis in "xy":
        boundary = (
            where["boundary"] if isinstance(where["boundary"], str) else where["boundary"][axis]
        )
        shrink = 0.99 if boundary == WALLS else 1.0
        inner[axis] = [shrink * end for end in where[axis]]
    disks = {"species": species(*kinds), "placement": "lattice"}
    mapping = {"box": inner | {"boundary": where["boundary"]}, "disks": disks, "duration": duration}
    scene = parse_scene(mapping | {"velocities": {"standard_deviation": 1.0}}, "crowded.yaml")
    return scene_of_state(where, draw_state(scene, 1), duration)


TRACER = {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]}


def note_scene(duration, particles=150, **more):
    """The published initial condition."""
    bath = [(particles - 1, 0.1, 0.4)]
    return mixture(
        box(6, 6, "reflecting"), bath, duration, TRACER, {"standard_deviation": 2.0}, **more
    )


def in_plain_python(function, module):
    """What a function of a module of tests returns in a process that compiles nothing."""
    code = f"import pickle, {module}; print(pickle.dumps({module}.{function}()).hex())"
    folders = Path(__file__).parent, Path(brownpipe.__file__).parents[1]
    plain = os.environ | {
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": os.pathsep.join(map(str, folders)),
    }
    done = subprocess.run(
        [sys.executable, "-c", code], env=plain, capture_output=True, text=True, check=True
    )
    return pickle.loads(bytes.fromhex(done.stdout))


def simultaneous_collisions(side, duration):
    """A square of disks in a periodic box, each running into one of its neighbours, all at the same
    time.
    """
    row, column = np.divmod(np.arange(side * side), side)
    position = np.stack([column + 0.5, row + 0.5], axis=1) - side / 2
    velocity = np.stack([(-1.0) ** (row + column), np.zeros(side**2)], axis=1)
    state = State(position, velocity, np.full(side**2, 0.2), np.ones(side**2))
    return scene_of_state(box(side, side, PERIODIC), state, duration)


SMALL_SCENES = {
    "walls": mixture(box(2, 1.2, WALLS), [(4, 0.15, 1)], 2.0),
    "periodic": mixture(box(1.3, 1.3, PERIODIC), [(4, 0.17, 1)], 3.0),
    "mixture": mixture(box(2, 2, WALLS), [(4, 0.1, 1), (4, 0.14, 0.3)], 2.0),
    "big": mixture(box(3, 3, PERIODIC), [(1, 0.5, 2), (20, 0.1, 1)], 0.6),
    "crowded": from_lattice(box(1.5, 1.4, PERIODIC), [(12, 0.19, 1)], 0.7),
    "clash": simultaneous_collisions(20, 0.7),
}
