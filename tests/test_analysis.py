"""Measures, their errors, and the dataset of a study.

Tolerances are in standard errors: 4.5 is a false alarm in 1 of 150,000 comparisons.
"""

import itertools
from typing import NamedTuple

import numpy as np
import pytest

from brownpipe import theory
from brownpipe.analysis import aggregate, displacement, distribution
from brownpipe.engines import DEFINITIONS, Engine, engine_of_request
from brownpipe.engines.ensemble import Track
from brownpipe.engines.timestep import TIMESTEP
from brownpipe.errors import AnalysisError
from brownpipe.observables.displacement import squared
from brownpipe.observables.trajectory import displacement as moved
from brownpipe.scene import parse_scene
from ensembles import DIFFUSION, make_runs, make_scene, study, write

SIGMAS = 4.5
TIMES = np.arange(101) * 0.01
RINGS = {"dr": 0.04, "rings": 24}
WINDOWS = ((0.1, 1.0), (0.5, 1.0))


# --- displacement


def test_squared_displacement_is_from_the_start_and_unwrapped():
    """Images two thousand million boxes away cost no digits."""
    position = np.array([[[1.0, 2.0], [0.0, 0.0]], [[4.0, 6.0], [0.0, -1.0]]])
    unit_box = (1.0, 1.0)
    assert squared(moved(position, None, unit_box)).T.tolist() == [[0.0, 25.0], [0.0, 1.0]]
    position = np.array([[[0.9, 0.1]], [[0.1, 0.9]]])
    image = np.array([[[7, 0]], [[8, -1]]], np.int32)
    r2 = squared(moved(position, image, unit_box))
    assert r2[1, 0] == pytest.approx(0.2**2 + 0.2**2)
    position = np.array([[[0.25, 0.0]], [[0.5, 0.0]]])
    image = np.full((2, 1, 2), 2_000_000_000, np.int32)
    assert squared(moved(position, image, (1.1, 1.1)))[1, 0] == 0.0625


def test_line_is_polyfit():
    y = np.sin(TIMES) + 3.0
    for window in WINDOWS:
        first, last = window
        inside = (first - 1e-12 <= TIMES) & (last + 1e-12 >= TIMES)
        line = displacement.line_weights(TIMES, window) @ y
        expected = np.polyfit(TIMES[inside], y[inside], 1)
        assert line == pytest.approx(expected, rel=1e-12)


def test_window_includes_both_ends_despite_round_off_and_else_is_nan():
    weights = displacement.line_weights(np.arange(11) * 0.1, (0.3, 0.7))[0]
    assert weights == pytest.approx([0, 0, 0, -2, -1, 0, 1, 2, 0, 0, 0])
    for window in ((0.5, 1.5), (0.101, 0.115), (2.0, 3.0)):
        assert np.isnan(displacement.line_weights(TIMES, window)).all()


def test_rings_are_half_open_and_count_everybody():
    edges = 0.5 * np.arange(4)
    distances = np.array([0.0, 0.49, 0.5, 1.4, 1.5, 9.0])
    assert distribution.ring_of(distances, edges).tolist() == [0, 0, 1, 2, 3, 3]


def one_disk():
    disks = [{"position": [0.0, 0.0], "velocity": [3.0, 4.0], "radius": 0.1, "mass": 1.0}]
    box = {"x": [-9.0, 9.0], "y": [-8.0, 8.0], "boundary": "reflecting"}
    return parse_scene(
        {"box": box, "disks": disks, "duration": 1.0, "sample_interval": 0.05}, "one.yaml"
    )


# --- the dataset


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return study(tmp_path_factory.mktemp("study"), failed=(7, 33))


@pytest.fixture(scope="module")
def dataset(files):
    return aggregate(files, **RINGS)


def test_dataset_agrees_with_theory(dataset):
    """The mean of 58 exponentials has a gamma law, whose tails beyond these bounds have 1e-6
    together.

    The slope, a quadratic form of normal numbers like r^2, is judged by the same bounds in its true
    standard errors.
    """
    from scipy.stats import gamma

    bounds = np.array(gamma.ppf([5e-7, 1 - 5e-7], 58))
    low, high = (bounds - 58) / np.sqrt(58)  # in standard errors
    truth = theory.diffusive_msd(dataset.time, DIFFUSION)
    error = truth / np.sqrt(58)
    off = (dataset.msd - truth)[..., 1:] / error[1:]
    assert ((low < off) & (off < high)).all()
    times = dataset.time.values
    for k, window in enumerate(WINDOWS):
        weights, _ = displacement.line_weights(times, window)
        # of r^2(s) and r^2(t)
        covariance = 16 * DIFFUSION**2 * np.minimum.outer(times, times) ** 2
        error = np.sqrt(weights @ covariance @ weights / 58)
        off = (dataset.slope[..., k] - 4 * DIFFUSION) / error
        assert ((low < off) & (off < high)).all()
    assert np.allclose(dataset.diffusion_coefficient * 4, dataset.slope, rtol=1e-14)
    assert np.allclose(dataset.run_msd.mean("seed"), dataset.msd[..., -1])
    assert np.allclose(
        dataset.run_diffusion_coefficient.mean("seed"), dataset.diffusion_coefficient
    )


def test_failed_runs_are_not_averaged_in(dataset, files, tmp_path):
    """Failed runs end 1e6 away: one of them would show everywhere. They stay visible in the run
    health.
    """
    assert (dataset.runs == 58).all()
    assert (dataset.failed_runs == 2).all()
    assert dataset.sizes["seed"] == 60
    assert float(dataset.msd.max()) < 10
    failed = (dataset.run_status == 1).any(("scene", "particles", "engine"))
    assert dataset.seed[failed].values.tolist() == [7, 33]
    assert np.isfinite(dataset.energy_drift).all()
    assert np.isnan(dataset.run_msd.sel(seed=[7, 33])).all()
    kept = [seed for seed in range(60) if seed not in (7, 33)]
    alone = aggregate([write(tmp_path, make_runs(make_scene("hot", 10), kept))], **RINGS)
    mine = dataset.sel(scene="hot", particles=10, engine="exact")
    for name in ("msd", "msd_high", "slope", "displacement_counts", "pair_collisions"):
        assert np.array_equal(mine[name].squeeze(), alone[name].squeeze())


def test_scenes_and_particle_counts_keep_the_order_in_which_they_are_given(tmp_path):
    """Neither as text (M1, M10, M3) nor ascending: it is the order of the study."""
    scenes = []
    for name, count in itertools.product(("M1", "M3", "M10"), (20, 10)):
        scenes.append(make_scene(name, count))
    dataset = aggregate([write(tmp_path, make_runs(scene, range(3))) for scene in scenes])
    assert dataset.scene.values.tolist() == ["M1", "M3", "M10"]
    assert dataset.particles.values.tolist() == [20, 10]
    assert (dataset.runs == 3).all()


def test_other_durations_and_seeds_leave_nan(tmp_path):
    short = write(tmp_path, make_runs(make_scene("short", duration=0.5), range(5, 30)))
    long = write(tmp_path, make_runs(make_scene("long", duration=1.0), range(20)))
    dataset = aggregate([long, short], WINDOWS).squeeze(("particles", "engine"))
    assert dataset.msd.count("time").values.tolist() == [21, 11]
    assert np.isnan(dataset.slope.sel(scene="short")).all()
    assert np.isfinite(dataset.slope.sel(scene="long")).all()
    assert dataset.displacement_time.values.tolist() == [0.5, 1.0]
    tested = np.isfinite(dataset.chi_square.sel(model="msd"))
    assert tested.sel(scene="short").values.tolist() == [True, False]
    assert tested.sel(scene="long").values.tolist() == [False, True]
    assert dataset.energy_drift.sel(scene="long").count() == 20
    absent = dataset.run_status.sel(scene="short") == 2
    assert dataset.seed[absent].values.tolist() == [0, 1, 2, 3, 4]


def test_one_run_of_one_disk(tmp_path):
    trajectories = make_runs(one_disk(), [3])
    straight = trajectories.scene.times[:, None, None] * np.array([3.0, 4.0])
    ensemble = trajectories.ensemble._replace(tracer=Track(straight, None, None))
    dataset = aggregate([write(tmp_path, trajectories._replace(ensemble=ensemble))]).squeeze()
    assert np.allclose(dataset.msd, 25 * dataset.time**2)
    assert dataset.initial_square_speed == 25 and dataset.box_width == 18
    assert np.isnan(dataset.msd_standard_error).all()


def test_no_tracer_no_msd(tmp_path):
    trajectories = make_runs(make_scene(), range(12))
    bare = trajectories._replace(ensemble=trajectories.ensemble._replace(tracer=None))
    dataset = aggregate([write(tmp_path, bare)]).squeeze()
    assert np.isnan(dataset.msd).all() and dataset.runs == 12
    for asked in (
        {"windows": ((0.1, 1.0),)},
        {"dr": 0.1, "rings": 5},
        {"displacement_times": [1.0]},
    ):
        with pytest.raises(AnalysisError, match="must go with runs that have displacements"):
            aggregate([bare], **asked)
    assert dataset.pair_collisions == pytest.approx(80, abs=SIGMAS * np.sqrt(80 / 12))
    alone = {
        "failed": np.zeros(12, np.uint8),
        "friction_rate": np.ones(12),
    }  # as of the langevin engine
    assert aggregate([bare._replace(ensemble=bare.ensemble._replace(observables=alone))]).runs == 12


def test_times_that_differ_by_round_off_are_one(tmp_path):
    """3 x 0.05 is not 0.15, the fifteenth multiple of 0.01 is; and 0.57 is a duration and a
    multiple of 0.01.
    """
    scenes = []
    for k, (end, dt) in enumerate([(1.0, 0.01), (1.0, 0.05), (0.57, 0.01)]):
        scenes.append(make_scene(f"s{k}", duration=end, sample_interval=dt))
    dataset = aggregate([write(tmp_path, make_runs(scene, range(12))) for scene in scenes])
    assert dataset.sizes["time"] == 101
    for t, present in ((0.15, 3), (0.57, 2), (1.0, 2)):
        assert dataset.msd.sel(time=t, method="nearest").count() == present
    alone = aggregate([write(tmp_path, make_runs(scenes[1], range(12)))]).squeeze()
    mine = dataset.sel(scene="s1").squeeze().dropna("time", subset=["msd"])
    assert np.array_equal(mine.msd, alone.msd)


SHORT, HOT = {"particles": 20, "duration": 2.0}, {"velocities": {"temperature": 1.0}}


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ([], "no trajectory files"),
        (
            [(make_scene(), range(20)), (make_scene(), range(15, 30))],
            r"15-29.*seed 15 is already in .*0-19\.h5",
        ),
        (
            [(make_scene(), range(9)), (make_scene(**HOT), [9])],
            r"9-9\.h5: has another scene 'plain' than .*0-8\.h5",
        ),
        (
            [(make_scene(particles=10), [1]), (make_scene(**SHORT), [1])],
            "two different scenes are called 'plain'",
        ),
        ([(one_disk(), [seed]) for seed in (3, 4)], "all its runs are the same; give one seed"),
    ],
)
def test_runs_that_do_not_belong_together_are_refused(made, message, tmp_path):
    paths = [write(tmp_path, make_runs(*one)) for one in made]
    with pytest.raises(AnalysisError, match=message):
        aggregate(paths)


def test_runs_of_another_source_or_average_are_not_averaged():
    first = make_runs(make_scene(), range(20))
    other = make_runs(make_scene(), range(20, 30))
    averaged = other._replace(ensemble=other.ensemble._replace(average="origins"))
    for second, what in ((other._replace(source="another"), "source code"), (averaged, "average")):
        with pytest.raises(AnalysisError, match=rf"^runs\[1\]: has another {what} than runs\[0\]"):
            aggregate([first, second])


class Settings(NamedTuple):
    """Settings of a time-stepping engine with two further numbers, both with defaults."""

    time_step: float
    collisions: str = "at_contact"
    skin: float = 1.0
    margin: float = 1.0


VALUES = itertools.product((0.01, 2.0), ("at_contact", "late"), (1.0, 2.0, 0.5), (1.0, 2.0, 0.5))
ENGINES = [
    Engine("timestep", tuple(zip(Settings._fields, values, strict=True))) for values in VALUES
]


def test_engines_that_differ_in_a_setting_are_never_one(monkeypatch):
    """A value alone, such as 2.0, does not say of which setting it is."""
    monkeypatch.setitem(DEFINITIONS, "timestep", TIMESTEP._replace(settings=Settings))
    labels = [engine.label for engine in ENGINES]
    assert len(set(labels)) == len(ENGINES) == 36
    assert {"timestep-0.01", "timestep-2.0", "timestep-0.01-collisions=late-skin=2.0"} <= {*labels}
    runs = make_runs(make_scene(), range(20))
    parts = [
        runs._replace(engine=engine)
        for engine in ENGINES
        if engine.label in ("timestep-0.01-skin=2.0", "timestep-0.01-margin=2.0")
    ]
    found = aggregate(parts)
    assert found.engine.values.tolist() == ["timestep-0.01-margin=2.0", "timestep-0.01-skin=2.0"]
    assert found.runs.values.ravel().tolist() == [20, 20]


def test_runs_of_engines_with_other_settings_are_not_averaged_whatever_their_label(monkeypatch):
    monkeypatch.setattr(Engine, "label", "timestep")
    runs = make_runs(make_scene(), range(20))
    parts = [
        runs._replace(engine=engine_of_request("timestep", {"time_step": step}))
        for step in (0.01, 0.02)
    ]
    with pytest.raises(AnalysisError, match=r"^runs\[1\]: has another setting of the engine than"):
        aggregate(parts)


def test_windows_that_say_nothing(tmp_path):
    file = write(tmp_path, make_runs(make_scene(), range(12)))
    differ = r"\[0.1, 1\]: must differ"
    for second, message in (
        ((0.1000001, 1.0), differ),
        ((2.0, 3.0), r"fit window \[2, 3\]: must end by 1"),
    ):
        with pytest.raises(AnalysisError, match=message):
            aggregate([file], ((0.1, 1.0), second))
