"""What every program returns of a run, and brownpipe as one of these programs."""

import math
from typing import NamedTuple

import numpy as np

from brownpipe.engines.exact.simulation import simulate, state_at_end
from brownpipe.engines.recording import conservation
from brownpipe.engines.units import State
from validation.stability.start import Start


class Outcome(NamedTuple):
    """The end of a run. Energy and momentum are compared with those of the start, by the same
    formulas for all.
    """

    state: State  # at the end
    pair_collisions: int
    wall_collisions: int
    worst_overlap: float  # of any pair that the program looked at [contact distances]
    energy_drift: float  # relative
    momentum_residual: (
        float  # balance of momentum with the impulses of the walls, relative; NaN: not known
    )
    failed: bool = False  # brownpipe: its health check; others: no program of theirs has one

    @property
    def events(self) -> int:
        return self.pair_collisions + self.wall_collisions


def measured(
    start: Start,
    position: np.ndarray,
    velocity: np.ndarray,
    counts: np.ndarray,
    impulse: np.ndarray,
    depth: float,
) -> Outcome:
    """Return the outcome of another program.

    counts: (2,) pair and wall collisions. impulse: (4,) total impulses >= 0 given by the walls
    left, right, bottom and top. depth: deepest overlap.
    """
    state = start.state._replace(position=position, velocity=velocity)
    first, last = (np.hstack([each.position, each.velocity]) for each in (start.state, state))
    kept = conservation(start.state.mass, first, last, impulse)
    return Outcome(
        state, int(counts[0]), int(counts[1]), depth, kept.energy_drift, kept.momentum_residual
    )


def brownpipe(start: Start, duration: float) -> Outcome:
    """Run by the exact engine of brownpipe."""
    run = simulate(start.scene(duration), [0], {"all"})
    seen = {name: values[0] for name, values in run.observables.items()}
    if run.stopped:
        return Outcome(start.state, 0, 0, math.nan, math.nan, math.nan, failed=True)
    return Outcome(
        state_at_end(start.state, run.whole[0]),
        int(seen["pair_collisions"]),
        int(seen["wall_collisions"]),
        float(seen["worst_overlap"]),
        float(seen["energy_drift"]),
        float(seen["momentum_residual"]),
        bool(seen["failed"]),
    )
