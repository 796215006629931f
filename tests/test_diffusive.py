"""A D has a mark where the motion is not diffusive, and none where it is: walls, cages, drifts,
windows that begin too early, too few runs; and default windows before walls and after cages.

The scenes are small, the effects many standard errors large; the level of the test for a change of
the slope is measured with made-up walks.
"""

import re

import numpy as np
import pytest
import xarray as xr
from scipy.special import stdtr

import brownpipe as bp
from brownpipe import theory
from brownpipe.analysis import aggregate, diffusive, displacement
from brownpipe.analysis.resampling import Estimate
from brownpipe.engines.windows import candidate_windows, earlier_ends, longest_end
from brownpipe.figures.marks import WORDS
from brownpipe.figures.summary import summary
from brownpipe.report.answer import answer_in_words
from ensembles import make_runs, make_scene
from scenes import CHANNEL_X, CHANNEL_Y

TRACER = {"radius": 0.4, "mass": 3.0}
BATH = {"name": "bath", "count": 20, "radius": 0.2, "mass": 1.0}
OVER_DISKS = {"observables": "square_displacement", "average": "disks"}


def scene(side=6.0, boundary="periodic", **keys):
    """A dilute fluid; at its packing fraction of 0.084 the tracer forgets its velocity in 4."""
    given = {
        "box": {"x": [0, side], "y": [0, side], "boundary": boundary},
        "disks": {"tracer": TRACER, "species": [BATH]},
        "velocities": {"temperature": 1.0},
        "equilibrate": {"time": 2.0, "tracer": "free"},
        "duration": 60.0,
        "sample_interval": 0.6,
        "name": "fluid",
    }
    return bp.Scene(**(given | keys))


def analysis(scene, seeds, windows=None, **options):
    return bp.analyse(bp.simulate(scene, seeds, quiet=True, **options), fit_windows=windows)


def reasons(result, window=0):
    return diffusive.mark_in_words(result.diffusion_mark[..., window].item())


def marked_lines(result):
    """The reasons below the summary, a line each."""
    _, _, below = summary(result).partition("is not that of diffusion, or not yet:\n")
    return below.replace("\n  ", " ").splitlines()


# -- diffusion between walls -----------------------------------------------------------------------


@pytest.mark.parametrize("start", [None, 0.0, 0.35, 1.0])
def test_walkers_between_two_walls_have_the_msd_of_the_series(start):
    """40,000 walkers in [0, 2], whose steps are exact between their samples: a false alarm in
    16,000 at each of four times, 4 standard errors.
    """
    rng = np.random.default_rng(11)
    begin = rng.uniform(0, 2, 40_000) if start is None else np.full(40_000, start)
    for spread in (1e-3, 0.03, 0.3, 2.0):
        free = begin + np.sqrt(2 * spread) * rng.standard_normal(len(begin))
        folded = 2 - np.abs(free % 4 - 2)  # reflected as often as needed
        square = (folded - begin) ** 2
        error = square.std() / np.sqrt(len(square))
        assert abs(square.mean() - theory.reflecting_interval_msd(spread, 2.0, start)) < 4 * error
        step = 1e-5 * spread
        later, earlier = (
            theory.reflecting_interval_msd(at, 2.0, start) for at in (spread + step, spread - step)
        )
        growth = theory.reflecting_interval_slope(spread, 2.0, start)
        assert growth == pytest.approx((later - earlier) / (2 * step), rel=1e-5, abs=5e-3)


def test_the_msd_from_the_middle_of_a_square_is_that_of_two_intervals():
    for spread in (1e-4, 0.05, 0.4, 3.0):
        of_square = theory.reflecting_square_msd(1.0, spread, 1.3)
        of_interval = theory.reflecting_interval_msd(spread, 2.6, 1.3)
        assert 2 * of_interval == pytest.approx(of_square, rel=1e-12)


def test_walls_reduce_the_slope_by_what_the_msd_says():
    """A tenth at 39 % of the limit from the middle of a square, at 2 % for starts anywhere; all of
    it in a full box, half of it in a long one whose width is full.
    """
    walls = scene(boundary="reflecting")
    middle = scene(
        boundary="reflecting",
        disks={"tracer": TRACER | {"position": [3.0, 3.0]}, "species": [BATH]},
        equilibrate={"time": 2.0, "tracer": "pinned"},
    )
    side = 6.0 - 2 * 0.4
    assert displacement.msd_limit(walls, "runs") == pytest.approx(2 * side**2 / 6)
    assert displacement.msd_limit(middle, "runs") == pytest.approx(2 * side**2 / 12)
    assert displacement.msd_limit(middle, "origins") == pytest.approx(2 * side**2 / 6)
    assert displacement.wall_reduction(middle, "runs", 0.39 * side**2 / 6) == pytest.approx(
        0.1, abs=0.01
    )
    assert displacement.wall_reduction(walls, "runs", 0.022 * side**2 / 3) == pytest.approx(
        0.1, abs=0.01
    )
    assert displacement.wall_reduction(walls, "runs", 1.01 * side**2 / 3) == 1.0
    channel = scene(box={"x": [0, 600], "y": [0, 1.0], "boundary": "reflecting"})
    assert displacement.wall_reduction(channel, "runs", 20.0) == pytest.approx(0.5, abs=0.02)
    assert np.isnan(displacement.wall_reduction(scene(), "runs", 3.0))
    assert np.isnan(displacement.msd_limit(scene(), "runs"))


@pytest.mark.parametrize("boundary", [CHANNEL_X, CHANNEL_Y])
@pytest.mark.parametrize("start", [None, 1.0])
def test_walls_of_a_channel_reduce_the_slope_of_walkers_in_it(boundary, start):
    """40,000 walkers, free along the channel and reflected across it, from anywhere or from 1 above
    the wall; their slopes, by pairs of later and earlier ends, to 4 standard errors.
    """
    sides = (600.0, 2.8) if boundary == CHANNEL_X else (2.8, 600.0)
    tracer = dict(TRACER)
    before = {"time": 2.0, "tracer": "free"}
    if start is not None:
        from_wall = 0.4 + start
        place = [300.0, from_wall] if boundary == CHANNEL_X else [from_wall, 300.0]
        tracer["position"] = place
        before["tracer"] = "pinned"
    channel = scene(
        box={"x": [0, sides[0]], "y": [0, sides[1]], "boundary": boundary},
        disks={"tracer": tracer, "species": [BATH]},
        equilibrate=before,
    )
    assert np.isnan(displacement.msd_limit(channel, "runs"))
    assert np.isnan(displacement.accessible_half_width(channel))
    rng = np.random.default_rng(12)
    begin = rng.uniform(0, 2, 40_000) if start is None else np.full(40_000, start)
    for spread in (0.02, 0.3, 2.0):
        ends = []
        for more in (1.0, 1.2):
            root = np.sqrt(2 * spread * more)
            y = 2 - np.abs((begin + root * rng.standard_normal(40_000)) % 4 - 2)
            ends.append((root * rng.standard_normal(40_000)) ** 2 + (y - begin) ** 2)
        earlier, later = ends
        slope = (later.mean() - earlier.mean()) / (0.2 * spread)
        error = np.sqrt((later.var() + earlier.var()) / 40_000) / (0.2 * spread)
        reductions = [
            displacement.wall_reduction(
                channel, "runs", 2 * at + theory.reflecting_interval_msd(at, 2.0, start)
            )
            for at in np.linspace(1, 1.2, 21) * spread
        ]
        assert abs(slope - 4 * (1 - np.mean(reductions))) < 4 * error
    assert displacement.wall_reduction(channel, "runs", 1e3) == pytest.approx(0.5, abs=1e-9)
    assert displacement.wall_reduction(channel, "runs", 1e-9) == pytest.approx(0.0, abs=1e-3)
    assert np.isnan(displacement.wall_reduction(channel, "runs", 0.0))


def test_a_tracer_as_wide_as_its_channel_moves_along_it_alone():
    """As a hard rod, whose velocity is given."""
    rod = {"position": [1.0, 0.4], "velocity": [1.0, 0.0], "radius": 0.4, "mass": 1.0}
    box = {"x": [0, 60.0], "y": [0, 0.8], "boundary": CHANNEL_X}
    tight = scene(box=box, disks=[rod], velocities=None, equilibrate=0.0)
    assert displacement.wall_reduction(tight, "runs", 3.0) == pytest.approx(0.5, rel=1e-12)


# -- the slope -------------------------------------------------------------------------------------


def test_a_straight_line_has_no_change_of_slope_and_a_parabola_that_of_its_halves():
    for times in (np.linspace(0, 9, 91), np.geomspace(0.1, 9, 40), np.array([1.0, 2.0, 9.0])):
        change = displacement.change_weights(times, (1.0, 9.0))
        assert abs(change @ (3 + 2 * times)) < 1e-12
        assert change @ times**2 > 0
    times = np.linspace(0, 9, 91)
    # Least squares through a parabola on [a, b] has the slope a + b: 3 + 9 less 1 + 3.
    assert displacement.change_weights(times, (1.0, 9.0)) @ times**2 == pytest.approx(8.0)
    assert np.isnan(displacement.change_weights(times, (8.85, 9.0))).all()
    assert np.isnan(displacement.change_weights(np.array([0.0, 1.0, 2.0]), (0.0, 2.0))).all()


@pytest.mark.parametrize("runs", [8, 30, 200])
def test_the_slope_of_random_walks_is_found_to_change_as_often_as_the_level_says(runs):
    """4,000 studies of walks at the level of 1 %: 0.4 to 1.6 % are rejected, 4 standard errors;
    with
    8 runs fewer, as the spread of r^2 is not normal."""
    rng = np.random.default_rng(runs)
    times = np.linspace(0, 1, 51)
    weights = displacement.change_weights(times, (0.1, 1.0))
    rejected = 0
    for _ in range(80):
        steps = rng.standard_normal((50, runs, 50, 2), np.float32)
        path = np.concatenate([np.zeros_like(steps[:, :, :1]), steps.cumsum(axis=2)], axis=2)
        change = (path**2).sum(axis=-1) @ weights
        error = change.std(axis=1, ddof=1) / np.sqrt(runs)
        p = 2 * stdtr(runs - 1, -np.abs(change.mean(axis=1) / error))
        rejected += np.count_nonzero(p < 0.01)
    fewest = 16 if runs >= 30 else 0
    assert fewest < rejected < 64


# -- marks -----------------------------------------------------------------------------------------


def test_a_tracer_that_diffuses_has_no_mark():
    result = analysis(scene(), 60)
    assert reasons(result) == reasons(result, 1) == ""
    assert "D without °" in summary(result) and not marked_lines(result)
    assert bp.table(result).mark.tolist() == [""]


@pytest.mark.parametrize("width", [6.0, 14.0])
def test_a_tracer_that_has_filled_its_box_is_marked(width):
    box = {"x": [0, width], "y": [0, 5.0], "boundary": "reflecting"}
    result = analysis(scene(box=box), 40, [(12.0, 60.0)])
    assert "walls" in reasons(result) and "early" not in reasons(result)
    assert any(line.startswith("- walls reduce the slope") for line in marked_lines(result))
    limits = {"x": (width - 0.8) ** 2 / 6, "y": (5.0 - 0.8) ** 2 / 6}
    total = result.msd_limit.item()
    assert total == pytest.approx(sum(limits.values()), rel=1e-12)
    text = " ".join(summary(result).split())
    worst = re.search("of at most ([0-9.]+) for fluid, N = 21, along ([xy])", text)
    assert worst[1] == f"{limits[worst[2]]:.3g}"


def test_by_default_windows_end_before_walls_are_felt():
    runs = bp.simulate(crowd("reflecting"), 100, quiet=True)
    result = bp.analyse(runs)
    assert result.window_end[0] < 20.0 and reasons(result) == ""
    wide = bp.analyse(runs, fit_windows=[(4.0, 40.0)])
    d = "diffusion_coefficient"
    assert "walls" in reasons(wide)
    assert wide[d].item() < 0.8 * result[d][..., 0].item()


@pytest.mark.parametrize("boundary", [CHANNEL_X, CHANNEL_Y])
def test_by_default_windows_in_channels_go_on_to_the_end(boundary):
    """Along the channel D has no mark, though half of it has."""
    result = analysis(crowd(boundary), 30)
    assert result.window_end[0] == 40.0 and "walls" in reasons(result)
    along = 0 if boundary == CHANNEL_X else 1
    marks = result.component_diffusion_mark[..., 0].values.ravel()
    assert diffusive.mark_in_words(marks[along]) == ""
    assert "walls" in diffusive.mark_in_words(marks[1 - along])


def crowd(boundary):
    """A dense fluid around a tracer that starts in the middle."""
    disks = {"tracer": TRACER | {"position": [3.0, 3.0]}, "species": [BATH | {"count": 150}]}
    pinned = {"time": 2.0, "tracer": "pinned"}
    return scene(
        boundary=boundary, disks=disks, equilibrate=pinned, duration=40.0, sample_interval=0.1
    )


def test_a_crystal_is_marked_whose_disks_stay_in_their_cages():
    box = {"x": [0, 8.0], "y": [0, 4 * np.sqrt(3.0)], "boundary": "periodic"}
    disks = {
        "species": [{"name": "crystal", "count": 64, "radius": 0.47, "mass": 1.0}],
        "placement": "lattice",
    }
    crystal = scene(box=box, disks=disks, duration=10.0, sample_interval=0.1)
    result = analysis(crystal, 20, **OVER_DISKS)
    assert "plateau" in reasons(result)
    assert any("the MSD hardly grows" in line for line in marked_lines(result))


@pytest.mark.slow
def test_a_dense_fluid_is_marked_before_its_cages_open_and_not_long_after():
    """200 disks at a packing fraction of 0.69. At 3/gamma D is several times that of long runs,
    which is marked in runs of 30/gamma; runs of 400/gamma have a window after the cages.
    """
    side = np.sqrt(200 * np.pi * 0.25 / 0.69)
    disks = {"species": [{"name": "fluid", "count": 200, "radius": 0.5, "mass": 1.0}]}
    dense = scene(side, disks=disks, equilibrate={"time": 10.0, "tracer": "free"})
    short = dense.replace(duration=1.4, sample_interval=0.02)
    assert "slope changes" in reasons(analysis(short, 60, **OVER_DISKS))
    long = dense.replace(duration=20.0, sample_interval=0.2)
    assert reasons(analysis(long, 30, **OVER_DISKS)) == ""


@pytest.mark.parametrize("listed", [False, True])
def test_disks_that_drift_together_are_marked(listed):
    if listed:
        places = [(1.0, 0.2), (2.0, 3.1), (4.0, 5.0), (5.2, 1.4)]
        drift = [
            {"position": place, "velocity": (0.5, -0.1 * k), "radius": 0.1, "mass": 1.0 + k}
            for k, place in enumerate(places)
        ]
        moving = bp.Scene(box=scene().box.model_dump(), disks=drift, duration=60.0,
                          sample_interval=0.6, name="fluid")  # fmt: skip
        velocity = np.average([one["velocity"] for one in drift], axis=0, weights=[1, 2, 3, 4])
        square = (velocity**2).sum()
        result = analysis(moving, 1)
        assert reasons(result) == "drift, untested"
    else:
        moving = scene(velocities={"temperature": 1.0, "zero_momentum": False})
        square = 2 * 1.0 / (3.0 + 20)  # <V^2> = 2kT/M
        result = analysis(moving, 300)
        assert "drift" in reasons(result)
    first = result.isel(window=0)
    expected = square * (first.window_start + first.window_end) / 4
    assert first.window_drift_diffusion.item() == pytest.approx(expected.item(), rel=1e-12)
    text = " ".join(summary(result).split())
    assert f"which adds {expected.item():.2g} to D" in text and "zero_momentum" in text


@pytest.mark.parametrize("boundary", [CHANNEL_X, CHANNEL_Y])
def test_half_of_the_d_along_a_channel_is_marked(boundary):
    """Once its width is filled the slope is that of one component, and does not change any more."""
    result = analysis(scene(boundary=boundary), 40, [(30.0, 60.0)])
    assert reasons(result) == "walls"
    assert result.wall_reduction.item() == pytest.approx(0.5, abs=0.02)
    assert "walls" not in summary(result)  # which has D along the channel


@pytest.mark.parametrize("boundary", [CHANNEL_X, CHANNEL_Y])
def test_a_drift_along_a_channel_is_marked(boundary):
    """At kT/M, half of that in a periodic box: walls stop the drift across the channel."""
    moving = scene(boundary=boundary, velocities={"temperature": 1.0, "zero_momentum": False})
    first = analysis(moving, 10, [(12.0, 60.0)]).isel(window=0)
    expected = 1.0 / (3.0 + 20) * (first.window_start + first.window_end) / 4
    assert first.window_drift_diffusion.item() == pytest.approx(expected.item(), rel=1e-12)


def test_no_drift_is_marked_without_total_momentum_or_between_walls():
    for still in (scene(), scene(boundary="reflecting"), scene(boundary=CHANNEL_X)):
        result = analysis(still, 10, [(12.0, 60.0)])
        assert not result.window_drift_diffusion.max() > 0


def test_a_window_that_begins_before_the_velocity_is_forgotten_is_marked():
    result = analysis(scene(), 20, [(0.6, 60.0), (6.0, 60.0)])
    assert "early" in reasons(result) and "early" not in reasons(result, 1)
    start = result.not_diffusive_before.item()
    (line, *_) = [line for line in marked_lines(result) if "begins before" in line]
    assert f"begins before 3/gamma of the tracer, {start:.3g} for" in line


@pytest.mark.parametrize("seeds", [1, 7])
def test_a_d_of_few_runs_is_marked_as_untested(seeds):
    result = analysis(scene(), seeds)
    assert reasons(result) == "untested"
    said = " ".join(summary(result).split())
    runs = {1: "1 run", 7: "7 runs"}[seeds]
    assert f"constant, {runs} for fluid, N = 21; needed: more runs (8 at least)." in said


@pytest.mark.parametrize(
    ("slope_change_p_value", "cure"),
    [(0.5, "more runs"), (np.nan, "three samples in the window, and runs that differ")],
)
def test_what_enough_runs_need_that_do_not_tell_the_slope_from_zero(slope_change_p_value, cure):
    fit = made_up([0.0] * 5, [0.3] * 5, slope=0.2).isel(scene=0, window=0)
    fit["slope_change_p_value"] = fit.slope_change_p_value * 0 + slope_change_p_value
    assert WORDS[diffusive.UNTESTED].cure(fit) == cure


def test_the_mark_is_in_dataset_table_legend_and_inspection(tmp_path, capsys):
    from brownpipe.cli import main

    result = analysis(scene(), 20, [(0.6, 60.0)])
    mark = result.diffusion_mark
    names = mark.flag_meanings.split()
    assert dict(zip(mark.flag_masks.tolist(), names, strict=True)) == diffusive.REASONS
    (label,) = [
        str(line.get_label())
        for line in bp.plot(result, "msd").axes[0].lines
        if "slope" in str(line.get_label())
    ]
    assert label.endswith(" °")
    assert "early" in bp.table(result).mark.item()
    bp.save(result, tmp_path / "marked.nc")
    assert bp.open(tmp_path / "marked.nc").diffusion_mark.equals(mark)
    assert main(["inspect", str(tmp_path / "marked.nc")]) == 0
    assert " °" in capsys.readouterr().out


# -- the choice of windows -------------------------------------------------------------------------


def test_candidates_begin_late_and_end_before_walls():
    still = [scene(disks={"tracer": TRACER}, duration=8.0)]  # nothing is known of its friction
    pairs = candidate_windows(still, 8.0)
    assert [first for first, _ in pairs] == [(0.8, 8.0), (2.0, 8.0), (4.0, 8.0)]
    assert [second for _, second in pairs] == [(4.0, 8.0), (4.0, 8.0), (6.0, 8.0)]
    ends = earlier_ends(still, "runs")
    assert ends[:3] == [8.0, 5.7, 4.0] and len(ends) == 16
    assert longest_end(still, "origins") == 4.0
    known = [scene()]
    assert min(earlier_ends(known, "runs")) > 2 * 4.5


def made_up(changes, errors, slope=1.0):
    """The numbers of three pairs of windows of one case with these changes of the slope."""
    names = ["[1, 8]", "[4, 8]", "[2, 8]", "[4.5, 8]", "[6, 8]"]
    window = (("scene", "window"), np.array([changes]))
    change = Estimate(np.array([changes]), np.array([errors]), *np.full((2, 1, 5), np.nan))
    p = displacement.p_value(change, np.full((1, 5), slope), 50)
    per_window = {
        "slope_change": window,
        "slope_change_standard_error": (("scene", "window"), np.array([errors])),
        "slope_change_p_value": (("scene", "window"), p),
    }
    same = {
        "slope": slope, "slope_standard_error": 0.01, "growth_exponent": 1.0,
        "growth_exponent_standard_error": 0.01, "wall_reduction": np.nan,
        "window_drift_diffusion": np.nan, "diffusion_coefficient": slope / 4,
        "diffusion_coefficient_standard_error": 0.01,
    }  # fmt: skip
    constant = {name: (("scene", "window"), np.full((1, 5), value)) for name, value in same.items()}
    data = xr.Dataset(per_window | constant).assign_coords(window=names)
    data["runs"] = ("scene", [50])
    data["not_diffusive_before"] = ("scene", [0.5])
    data["window_start"] = ("window", [1.0, 4.0, 2.0, 4.5, 6.0])
    data["window_end"] = ("window", np.full(5, 8.0))
    data = data.set_coords(["window_start", "window_end"])
    return data.assign_coords(model=["msd"])


PAIRS = [((1.0, 8.0), (4.0, 8.0)), ((2.0, 8.0), (4.5, 8.0)), ((4.0, 8.0), (6.0, 8.0))]


@pytest.mark.parametrize(
    ("changes", "errors", "window", "mark"),
    [
        ([-0.02, 0.0, 0.0, 0.0, 0.0], [0.05] * 5, "[1, 8]", ""),
        ([-0.5, 0.0, -0.1, 0.0, 0.0], [0.05] * 5, "[2, 8]", ""),  # the change has ended
        ([-0.5, -0.3, -0.4, 0, 0], [0.05, 0.3, 0.05, 1, 1], "[1, 8]", "slope changes"),  # unknown
        ([-0.08, 0.0, 0.0, 0.0, 0.0], [0.01] * 5, "[1, 8]", ""),  # small
        ([+0.2, 0.0, 0.0, 0.0, 0.0], [0.01] * 5, "[1, 8]", ""),  # as in two dimensions
        ([+0.4, 0.4, 0.4, 0.4, 0.4], [0.01] * 5, "[1, 8]", "slope changes"),
    ],
)
def test_a_later_window_is_chosen_where_it_shows_that_the_slope_has_ceased_to_change(
    changes, errors, window, mark
):
    chosen = diffusive.best_windows(made_up(changes, errors), PAIRS)
    assert chosen.window.values[0] == window
    assert diffusive.mark_in_words(chosen.diffusion_mark.values[0, 0]) == mark


def between_unequal_walls(changes, errors):
    """`made_up` fits of motion along y, along x at walls, and of all motion at them, too."""
    along_y = made_up(changes, errors)
    at_walls = along_y.assign(wall_reduction=along_y.wall_reduction.fillna(0.5))
    parts = [at_walls.reset_coords(drop=True), along_y.reset_coords(drop=True)]
    along = xr.concat(parts, xr.Variable("component", ["x", "y"]))
    fits = {}
    for name, component_name in diffusive.COMPONENT_FITS.items():
        if name in along:
            fits[component_name] = along[name]
    return at_walls.assign(fits).assign_coords(component=["x", "y"])


def test_windows_between_unequal_walls_are_chosen_by_the_motion_whose_d_is_stated():
    """Where D along x has its walls in all windows, and D along y none; that of all motion, which
    is not stated, has them, too.
    """
    changes = [-0.5, 0.0, -0.1, 0.0, 0.0]
    chosen = diffusive.best_windows(between_unequal_walls(changes, [0.05] * 5), PAIRS)
    assert chosen.window.values[0] == "[2, 8]"
    marks = chosen.component_diffusion_mark.isel(scene=0, window=0)
    assert [diffusive.mark_in_words(mark) for mark in marks.values] == ["walls", ""]
    assert diffusive.number_of_plain(chosen) == 1


def test_default_windows_between_unequal_walls_end_before_those_of_the_shorter_side():
    """Walkers, folded at walls in y that reduce the slope along y by 8.5 % at t = 5 and by 1.8 % at
    t = 3.5, that of all motion by half of it. Of 2,000 walkers the shares are known to 0.6 %.
    """
    box = {"x": [-6.0, 6.0], "y": [-1.2, 1.2]}
    hot = {"temperature": 500.0}
    oblong = make_scene(box=box, duration=20.0, velocities=hot, sample_interval=0.25)
    runs = make_runs(oblong, np.arange(2000), diffusion=0.0102)
    position = runs.ensemble.tracer.position
    position[..., 1] = 0.9 - abs((position[..., 1] + 0.9) % 3.6 - 1.8)
    result = aggregate([runs])
    assert result.window_end[0] == 3.5
    reduction = result.component_wall_reduction.sel(component="y")[..., 0].item()
    assert reduction < diffusive.WALLS_FELT / 2


# -- averages over time origins --------------------------------------------------------------------


def test_with_averages_over_origins_numbers_stand_where_there_are_origins():
    observables = ["square_displacement", "velocity_autocorrelation"]
    result = analysis(scene(), 12, observables=observables, average="origins")
    assert result.window_end.values.tolist() == [30.0, 30.0]
    text = summary(result)
    heading = text.splitlines()[0]
    assert "MSD(t = 30)" in heading
    at_end = result.isel(scene=0, particles=0, engine=0).sel(time=30.0, method="nearest")
    assert f"{at_end.green_kubo.item():.2f}" in text
    assert "<v(0).(r(t) - r(0))>/2, of the tracer, at t = 30" in " ".join(text.split())


def test_the_green_kubo_integral_stands_at_the_end_of_the_window_that_was_asked_for():
    options = {"observables": ["velocity_autocorrelation"]}
    result = analysis(scene(), 12, [(6.0, 30.0)], **options)
    case = result.isel(scene=0, particles=0, engine=0)
    integral = bp.table(result).green_kubo.item()
    assert integral == case.green_kubo.sel(time=30.0, method="nearest").item()


def coarse_walls(**keys):
    """A crowd between walls that are felt after 13, sampled at few times before."""
    crowd = {"tracer": TRACER | {"position": [3.0, 3.0]}, "species": [BATH | {"count": 150}]}
    pinned = {"time": 2.0, "tracer": "pinned"}
    return scene(boundary="reflecting", disks=crowd, equilibrate=pinned, **keys)


@pytest.mark.parametrize("interval", [3.0, 9.0])
def test_default_windows_have_samples_and_walls_are_named_where_none_before_them_has(interval):
    walls = coarse_walls(duration=45.0, sample_interval=interval)
    result = analysis(walls, 20)
    assert np.isfinite(result.diffusion_coefficient[..., 0].item())
    assert reasons(result) == ("walls" if interval == 9.0 else "")


@pytest.mark.parametrize("boundary", ["reflecting", "periodic", CHANNEL_X])
def test_a_lone_disk_never_diffuses(boundary):
    """It drifts with no other disk, and a later window or longer runs do not help."""
    alone = scene(boundary=boundary, disks={"tracer": TRACER}, duration=2.0, sample_interval=0.1)
    result = analysis(alone, 60, [(0.3, 1.9)])
    assert "early" in reasons(result)
    assert "drift" not in reasons(result)
    text = " ".join(summary(result).split())
    lone = "infinite for a lone disk for fluid, N = 1(, along x)?; needed: other disks."
    assert re.search(f"the window begins before 3/gamma of the tracer, {lone}", text)
    (sentences,) = answer_in_words(result)
    assert re.search("It is not diffusive( along x)? between t = 0.3 and 1.9", sentences)
    assert "it remembers its initial velocity for good, as a lone disk" in sentences


@pytest.mark.parametrize(
    ("growth_exponent", "wall_reduction", "mark"),
    [(1.0, np.nan, "untested"), (0.1, np.nan, "plateau"), (0.1, 0.9, "walls"), (1.0, 0.9, "walls")],
)
def test_a_slope_that_is_not_told_from_zero_is_untested_if_nothing_holds_the_tracer(
    growth_exponent, wall_reduction, mark
):
    noise = made_up([0.0] * 5, [0.3] * 5, slope=0.2)
    noise["slope_standard_error"] = noise.slope_standard_error + 0.5
    noise["growth_exponent"] = noise.growth_exponent * 0 + growth_exponent
    noise["wall_reduction"] = noise.wall_reduction.fillna(0) + wall_reduction
    chosen = diffusive.best_windows(noise, PAIRS)
    assert diffusive.mark_in_words(chosen.diffusion_mark.values[0, 0]) == mark
