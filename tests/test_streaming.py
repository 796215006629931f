"""Runs come in blocks of seeds: the same to the bit whatever the files, in bounded memory."""

import numpy as np
import pytest

from brownpipe.analysis import aggregate
from brownpipe.engines import Engine
from brownpipe.engines.ensemble import Ensemble, Track, select
from brownpipe.errors import AnalysisError
from brownpipe.storage.trajectories import write_trajectories
from ensembles import make_scene, walk

SEEDS = np.r_[900:1300, 5000:5010]  # three blocks of 1,024, the last of them with a gap before
SCENE = make_scene(sample_interval=0.25)


@pytest.fixture(scope="module")
def everything():
    """All runs of a study, as one record."""
    rng = np.random.default_rng(1)
    n = len(SEEDS)
    counts = {
        name: rng.poisson(30, n)
        for name in ("pair_collisions", "wall_collisions", "tracer_collisions")
    }
    health = {
        name: rng.normal(0, 1e-15, n)
        for name in ("energy_drift", "worst_overlap", "momentum_residual")
    }
    observables = counts | health | {"failed": (rng.random(n) < 0.01).astype(np.uint8)}
    return Ensemble(
        SEEDS,
        SCENE.times,
        Track(walk(rng, SCENE.times, n), None, None),
        observables,
        {},
        {},
        {},
        {},
    )


def written(folder, ensemble, batches):
    """Files of the runs in the given rows."""
    folder.mkdir()
    paths = [folder / f"{k}.h5" for k in range(len(batches))]
    for path, rows in zip(paths, batches, strict=True):
        write_trajectories(path, SCENE, Engine("exact"), select(ensemble, rows))
    return paths


BATCHES = np.split(np.arange(len(SEEDS)), [60, 120, 124, 300, 405])


@pytest.mark.slow
def test_the_layout_of_files_does_not_matter_and_other_observables_are_refused(
    everything, tmp_path
):
    shuffled = np.split(np.random.default_rng(2).permutation(len(SEEDS)), [100, 110])
    one, *others = (
        aggregate(written(tmp_path / str(k), everything, batches))
        for k, batches in enumerate(([np.arange(len(SEEDS))], BATCHES[::-1], shuffled))
    )
    assert all(one.identical(other) for other in others)
    paths = written(tmp_path / "batches", everything, BATCHES)
    more = select(everything, np.arange(405, 410))
    more = more._replace(observables=more.observables | {"virial": more.seeds * 1.0})
    write_trajectories(paths[-1], SCENE, Engine("exact"), more)
    with pytest.raises(
        AnalysisError, match=r"5\.h5: has other observables than .*0\.h5 \(virial\)"
    ):
        aggregate(paths)
