"""Where runs begin: a box and the state of all disks, the same for every program; and states to
begin from.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.engines.start.initial_state import draw_state
from brownpipe.engines.units import State
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.reading import YamlValue


class Start(NamedTuple):
    """Disks between four hard walls."""

    x: tuple[float, float]  # sides of the box [length]
    y: tuple[float, float]
    state: State

    def scene(self, duration: float, **more: YamlValue) -> Scene:
        """Return the scene that begins here; `more` are further keys of a scene."""
        keys = ("position", "velocity", "radius", "mass")
        rows = zip(*(column.tolist() for column in self.state), strict=True)
        disks = [dict(zip(keys, row, strict=True)) for row in rows]
        mapping: dict[str, YamlValue] = {
            "box": {"x": self.x, "y": self.y},
            "disks": disks,
            "duration": duration,
            **more,
        }
        return parse_scene(mapping, "stability.yaml")

    def scaled(self, length: int, time: int) -> "Start":
        """Return the same disks in units of length and time smaller by these powers of two: every
        bit is kept.
        """
        old = self.state
        position, radius = np.ldexp(old.position, length), np.ldexp(old.radius, length)
        state = State(position, np.ldexp(old.velocity, length - time), radius, old.mass)
        x, y = (tuple(np.ldexp(side, length).tolist()) for side in (self.x, self.y))
        return Start(x, y, state)

    def moved(self, shift: float) -> "Start":
        """Return the same disks and box, moved in x and y."""
        x, y = ((low + shift, high + shift) for low, high in (self.x, self.y))
        return Start(x, y, self.state._replace(position=self.state.position + shift))


def listed(half: float, rows: list[tuple[float, ...]]) -> Start:
    """Return disks in [-half, half]^2 from rows (x, y, vx, vy, radius, mass)."""
    table = np.array(rows, dtype=float)
    return Start(
        (-half, half), (-half, half), State(table[:, :2], table[:, 2:4], table[:, 4], table[:, 5])
    )


def gas(half: float, species: list[tuple[int, float, float]], seed: int = 1) -> Start:
    """Return disks at random places in [-half, half]^2 at kT = 1; species: (number, radius,
    mass).
    """
    named: list[dict[str, YamlValue]] = [
        {"name": f"s{k}", "count": n, "radius": r, "mass": m} for k, (n, r, m) in enumerate(species)
    ]
    box = {"x": [-half, half], "y": [-half, half]}
    mapping: dict[str, YamlValue] = {
        "box": box,
        "disks": {"species": named},
        "velocities": {"temperature": 1.0},
        "duration": 1.0,
    }
    return Start((-half, half), (-half, half), draw_state(parse_scene(mapping, "gas.yaml"), seed))


def notes_scene(seed: int) -> Start:
    """Return the initial state of the note's scene with 150 disks (docs/theory.md)."""
    bath: dict[str, YamlValue] = {"name": "bath", "count": 149, "radius": 0.1, "mass": 0.4}
    tracer: dict[str, YamlValue] = {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]}
    box = {"x": [-3.0, 3.0], "y": [-3.0, 3.0]}
    mapping: dict[str, YamlValue] = {
        "box": box,
        "disks": {"tracer": tracer, "species": [bath]},
        "velocities": {"standard_deviation": 2.0},
        "duration": 1.0,
    }
    return Start((-3.0, 3.0), (-3.0, 3.0), draw_state(parse_scene(mapping, "note.yaml"), seed))


def packing(gap: float, columns: int = 5, rows: int = 6) -> Start:
    """Return a triangular lattice of disks of diameter 1 between walls, spread so that all gaps are
    about `gap`.

    At gap 0 every disk touches its neighbours and the walls beside it: none can leave its place.
    """
    row, column = np.divmod(np.arange(columns * rows), columns)
    a = 1.0 + gap
    position = np.stack([(column + 0.5 * (row % 2)) * a, row * a * np.sqrt(0.75)], axis=1) + 0.5 * a
    velocity = np.random.default_rng(1).standard_normal(position.shape)
    state = State(position, velocity, np.full(len(position), 0.5), np.ones(len(position)))
    return Start(
        (0.0, (columns + 0.5) * a), (0.0, float(a * (1 + (rows - 1) * np.sqrt(0.75)))), state
    )
