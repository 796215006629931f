"""Numerical stability, by small versions of the experiments of docs/stability.md; and the page of
their tables.
"""

from pathlib import Path

import numpy as np
import pytest

from validation.stability import packings
from validation.stability.catalogue import EXPERIMENTS
from validation.stability.outcome import brownpipe
from validation.stability.programs import OTHERS
from validation.stability.start import gas, listed

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_a_small_version_keeps_what_is_promised(name):
    experiment = EXPERIMENTS[name]
    found = experiment.module.measure(**experiment.small)
    rows = experiment.module.rows(found)
    assert [row for row in rows if not row.is_kept] == []
    assert all(len(row.cells) == 4 for row in rows)
    assert experiment.module.draw(found).axes


@pytest.mark.parametrize("name", OTHERS)
def test_the_other_programs_are_right(name):
    """Simple fractions: three collisions of two disks and a wall; a gas until its paths have parted
    by 1e-10.
    """
    end = OTHERS[name](listed(3.0, [(-1, 0, 1, 0, 0.25, 1.0), (1, 0, 0, 0, 0.25, 3.0)]), 3.5)
    assert (end.pair_collisions, end.wall_collisions) == (1, 0)
    np.testing.assert_allclose(end.state.velocity, [[-0.5, 0], [0.5, 0]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(end.state.position, [[-0.5, 0], [2.0, 0]], rtol=0, atol=1e-15)
    start = gas(1.0, [(8, 0.1, 1.0), (8, 0.14, 0.3)])
    ours, theirs = brownpipe(start, 0.5), OTHERS[name](start, 0.5)
    assert (ours.pair_collisions, ours.wall_collisions) == (
        theirs.pair_collisions,
        theirs.wall_collisions,
    )
    assert ours.events > 20
    np.testing.assert_allclose(theirs.state.position, ours.state.position, rtol=0, atol=1e-10)
    assert max(abs(theirs.energy_drift), theirs.momentum_residual) < 1e-13


def test_a_program_that_drops_collisions_breaks_a_promise(monkeypatch):
    monkeypatch.setattr(packings, "EVENT_DRIVEN", {"brownpipe": OTHERS["note's loop"]})
    (row,) = packings.rows(packings.measure(gaps=(1e-12,), crossings=1000.0, steps=10))
    assert not row.is_kept
