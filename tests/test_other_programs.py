"""The same numbers from programs of others: docs/other_programs.md, smaller.

The tests import these programs themselves: every process that runs tests imports this file to list
them.
"""

import numpy as np
import pytest

import brownpipe as bp
from brownpipe.engines.start.initial_state import draw_state
from validation.by_pymunk import by_brownpipe, by_pymunk, distance, first_delays, note_scene

pytestmark = pytest.mark.slow


def test_pymunk_comes_nearer_with_its_time_step():
    """40 disks of different masses between walls, 5 runs. Distances were 0.0126 and 0.0023, with
    equal masses 0.20.
    """
    scene = note_scene(40, 0.4)
    masses = np.random.default_rng(1).uniform(0.2, 2.0, (5, 40))
    states = [draw_state(scene, seed)._replace(mass=mass) for seed, mass in enumerate(masses)]
    exact = [by_brownpipe(scene, state) for state in states]
    coarse, fine = ([by_pymunk(scene, state, step) for state in states] for step in (1e-3, 1e-4))
    delays = np.array(
        [delay for pair in zip(exact, fine, strict=True) for delay in first_delays(*pair)]
    )
    assert len(delays) > 50
    assert np.all(
        (delays > 0) & (delays < 1e-4)
    )  # a collision is found at the end of the step that it falls in
    far, near = (
        np.median([distance(*pair)[-1] for pair in zip(exact, runs, strict=True)])
        for runs in (coarse, fine)
    )
    assert near < 4e-3 and 3 < far / near < 30  # first order: 10


def test_freud_finds_the_means_over_runs_of_the_dataset():
    """Mean squared displacement with its standard error, and g(r), of 6 runs. freud has single
    precision.
    """
    import freud

    scene = bp.Scene(
        box={"x": [0.0, 20.0], "y": [0.0, 12.0], "boundary": "periodic"},
        disks={"species": [{"name": "disk", "count": 60, "radius": 0.5, "mass": 0.7}]},
        velocities={"temperature": 1.5, "zero_momentum": True},
        equilibrate={"time": 1.0, "tracer": "free"},
        duration=2.0,
        sample_interval=0.25,
    )
    names = ("square_displacement", "pair_distribution")
    runs = bp.simulate(scene, 6, record="all", observables=names, average="disks", quiet=True)
    result = bp.analyse(runs).squeeze()
    box = freud.box.Box(20.0, 12.0)
    shift = np.array([10.0, 6.0])
    found = []
    count = len(result.distance)
    pairs = freud.density.RDF(count, count * float(result.distance[1] - result.distance[0]))
    for seed in range(6):
        disks = runs["disks"].to_dataset().isel(seed=seed)
        position = np.pad(disks.position.values - shift, ((0, 0), (0, 0), (0, 1)))
        image = np.pad(disks.image.values, ((0, 0), (0, 0), (0, 1)))
        found.append(freud.msd.MSD(box, "direct").compute(position, images=image).msd)
        for points in position:
            pairs.compute((box, points), reset=False)
    np.testing.assert_allclose(result.msd[1:], np.mean(found, axis=0)[1:], rtol=1e-5)
    error = np.std(found, axis=0, ddof=1) / np.sqrt(6)
    np.testing.assert_allclose(result.msd_standard_error[1:], error[1:], rtol=1e-3)
    g = pairs.rdf * 60 / 59  # freud divides by N/A, not by (N - 1)/A
    same = np.isclose(result.pair_distribution, g, rtol=1e-4)
    assert np.count_nonzero(same) > 0.95 * count  # pairs at the edge of a bin change it by rounding
    np.testing.assert_allclose(result.pair_distribution, g, rtol=0.04)
