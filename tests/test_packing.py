"""Overlaps against all pairs of disks."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brownpipe.scene.packing import overlap


@pytest.mark.slow
@given(
    st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(1e-3, 0.24)), min_size=0, max_size=12), st.booleans()
)
@settings(max_examples=300, deadline=None)
def test_finds_an_overlap_where_all_pairs_do(disks, periodic):
    position, radius = np.array([d[:2] for d in disks]).reshape(-1, 2), np.array([d[2] for d in disks])

    def gap(a, b):
        apart = position[a] - position[b]
        if periodic:
            apart -= np.rint(apart)
        return np.hypot(*apart) - radius[a] - radius[b]

    gaps = {pair: gap(*pair) for pair in combinations(range(len(disks)), 2)}
    found = overlap(position, radius, ((0, 1), (0, 1)) if periodic else None)
    if found is None:
        assert all(value > -1e-12 for value in gaps.values())
    else:
        a, b, value = found
        assert value < 0
        assert value == pytest.approx(gaps[a, b], abs=1e-12)


def test_passes_a_hexagonal_packing_in_contact():
    i, j = np.divmod(np.arange(60 * 52), 60)
    position = np.stack([0.2 * (j + i % 2 / 2), 0.1 * math.sqrt(3) * i], axis=1)
    box = ((0, 60 * 0.2), (0, 52 * 0.1 * math.sqrt(3)))
    radius = np.full(len(i), 0.1)
    assert overlap(position, radius, box) is None
    radius[77] += 1e-9
    assert 77 in overlap(position, radius, box)[:2]
