"""Motion along x and y: mean squared displacements, D along a channel, their errors and marks."""

import re

import numpy as np
import pytest
import xarray as xr

import brownpipe as bp
from brownpipe import analysis
from brownpipe.analysis import components, diffusive, displacement
from brownpipe.analysis.estimator import Averages, Case
from brownpipe.engines import Engine
from brownpipe.engines.ensemble import Ensemble
from brownpipe.figures.cases import SUFFIXES, cases_of, plus_minus
from brownpipe.figures.diffusion import table_of_diffusion
from brownpipe.figures.marks import power_in_words
from brownpipe.figures.msd import table_of_msd
from brownpipe.figures.scan import table_of_scan
from brownpipe.figures.summary import summary, summary_table
from brownpipe.figures.velocity_autocorrelation import table_of_autocorrelations
from brownpipe.observables.trajectory import Track
from brownpipe.report.answer import answer_in_words
from ensembles import make_runs, make_scene, walk
from scenes import CHANNEL_X, CHANNEL_Y, PERIODIC, WALLS

CHANNELS = [CHANNEL_X, CHANNEL_Y]
ALONG_X = 0.3  # D
ALONG_Y = 0.05
WINDOW = (0.25, 1.0)
BOX = {"x": [-3.0, 3.0], "y": [-2.0, 2.0]}
OBLONG = {"x": [-3.0, 3.0], "y": [-2.0, 2.0], "boundary": "reflecting"}


def analysed(runs):
    """The dataset with one fit window: the choice of default windows takes 0.5 s and more."""
    return bp.analyse(runs, fit_windows=[WINDOW], quiet=True)


def words(result, component):
    """The reasons of the mark of D along x or y in the first window."""
    return diffusive.mark_in_words(
        result.component_diffusion_mark.sel(component=component)[..., 0].item()
    )


# -- in runs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("average", ["runs", "origins"])
@pytest.mark.parametrize("boundary", CHANNELS)
def test_a_lone_disk_flies_along_its_channel(boundary, average):
    """MSD = <v^2> t^2 along it, to round-off; across it, never more than the width."""
    lone = bp.Scene(
        box={"x": [0, 4], "y": [0, 4], "boundary": boundary},
        disks={"species": [{"name": "disk", "count": 1, "radius": 0.5, "mass": 2.0}]},
        velocities={"temperature": 1.5, "zero_momentum": False},
        equilibrate={"time": 1.0, "tracer": "free"},
        duration=20.0,
        sample_interval=0.5,
    )
    observables = ["square_displacement", "quartic_displacement", "velocity_autocorrelation"]
    runs = bp.simulate(
        lone, 20, observables=observables, average=average, record=["tracer", "velocity"]
    )
    result = bp.analyse(runs, fit_windows=[(5.0, 10.0)]).isel(scene=0, particles=0, engine=0)
    along, across = ("x", "y") if boundary == CHANNEL_X else ("y", "x")
    velocity = runs.velocity.isel(time=0).sel(component=along)
    expected = (velocity**2).mean().item() * result.time.values**2
    msd = result.component_msd.sel(component=along)
    np.testing.assert_allclose(msd, expected, rtol=1e-12, atol=1e-12)
    assert result.component_msd.sel(component=across).max() <= 3.0**2
    assert result.channel_axis == along
    flight = (velocity**2).mean().item() * result.time.values
    for name in ("green_kubo", "diffusion_running"):
        integral = result[f"component_{name}"]
        np.testing.assert_allclose(integral.sel(component=along), flight, rtol=1e-12, atol=1e-12)
        assert abs(integral.sel(component=across)[-1]) < 0.2 * flight[-1]
    correlation = result.component_velocity_autocorrelation
    np.testing.assert_allclose(
        correlation.sel(component=along), flight[-1] / result.time[-1].item(), rtol=1e-12
    )
    assert correlation.sel(component=across).min() < 0  # after a wall
    # the velocities of 20 runs
    moments = [(velocity**power).mean().item() for power in (2, 4)]
    parameter = result.component_non_gaussian_parameter.sel(component=along)[1:]
    np.testing.assert_allclose(parameter, moments[1] / (3 * moments[0] ** 2) - 1, rtol=1e-9)


@pytest.mark.parametrize("average", ["runs", "origins", "disks"])
@pytest.mark.parametrize("boundary", [WALLS, PERIODIC, *CHANNELS])
def test_the_msd_is_the_sum_of_its_components(boundary, average):
    scene = make_scene(
        boundary=boundary,
        disks={"species": [{"name": "disk", "count": 20, "radius": 0.2, "mass": 1.0}]},
        velocities={"temperature": 1.0, "zero_momentum": False},
        equilibrate={"time": 1.0, "tracer": "free"},
    )
    runs = bp.simulate(scene, 12, observables="square_displacement", average=average)
    result = analysed(runs)
    total = result.component_msd.sum("component")
    np.testing.assert_allclose(total, result.msd, rtol=1e-12, atol=1e-14)
    is_channel = boundary in CHANNELS
    assert ("component_diffusion" in result) == ("channel_axis" in result) == is_channel


def test_recorded_tracks_have_components_without_an_observable():
    runs = [make_runs(make_scene(boundary=CHANNEL_X), np.arange(10), diffusion=[ALONG_X, ALONG_Y])]
    result = analysis.aggregate(runs, [WINDOW]).isel(scene=0, particles=0, engine=0)
    moved = runs[0].ensemble.tracer.position  # from the origin, where all start
    np.testing.assert_allclose(result.component_msd.values.T, (moved**2).mean(axis=1), rtol=1e-12)


# -- errors ----------------------------------------------------------------------------------------


def test_fits_along_each_axis_are_those_of_a_walk_along_it():
    """Slopes and errors by plain loops over runs; D of each run is kept."""
    runs = make_runs(make_scene(boundary=CHANNEL_Y), np.arange(30), diffusion=[ALONG_X, ALONG_Y])
    result = analysis.aggregate([runs], [WINDOW]).isel(scene=0, particles=0, engine=0, window=0)
    times = runs.ensemble.times
    inside = (times >= WINDOW[0] - 1e-9) & (times <= WINDOW[1] + 1e-9)
    for axis in (0, 1):
        slopes = []
        intercepts = []
        for run in range(30):
            square = runs.ensemble.tracer.position[inside, run, axis] ** 2
            slope, intercept = np.polyfit(times[inside], square, 1)
            slopes.append(slope)
            intercepts.append(intercept)
        along = result.isel(component=axis)
        np.testing.assert_allclose(along.run_component_diffusion, np.array(slopes) / 2, rtol=1e-9)
        error = np.std(slopes, ddof=1) / np.sqrt(30)
        assert along.component_slope == pytest.approx(np.mean(slopes), rel=1e-9)
        assert along.component_intercept == pytest.approx(np.mean(intercepts), rel=1e-8)
        assert along.component_diffusion == pytest.approx(np.mean(slopes) / 2, rel=1e-9)
        assert along.component_diffusion_standard_error == pytest.approx(error / 2, rel=1e-9)
        exponent = along.component_slope * WINDOW[1] / along.component_msd[-1]
        assert along.component_growth_exponent == pytest.approx(exponent.item(), rel=1e-12)


@pytest.mark.slow
def test_errors_cover_the_truth_for_different_d_along_x_and_y(fewer_replicates):
    """Of 400 ensembles of 40 walks. A coverage of 95 % is then known to 1.1 %, four of which it may
    be off by; the scatter of 400 means to 3.5 %, of which it may differ by four from the rms of the
    stated errors.
    """
    scene = make_scene(boundary=CHANNEL_X)
    case = Case(scene, Engine("exact"), scene.times, windows=(WINDOW,))
    rng = np.random.default_rng(21)
    d = np.array([ALONG_X, ALONG_Y])
    truth = {"D": d, "MSD": 2 * d, "alpha": np.zeros(2)}
    is_covered = {name: [] for name in truth}
    means = {name: [] for name in truth}
    errors = {name: [] for name in truth}
    seeds = np.arange(40)
    for _ in range(400):
        track = Track(walk(rng, scene.times, 40, d), None, None)
        quartic = np.moveaxis(track.position**4, 0, -1)
        seen = {"component_quartic_displacement": quartic}
        runs = Ensemble(seeds, scene.times, track, seen, {}, {}, {}, {})
        averages = Averages().add(seeds, components.component_columns(case, runs))
        values = components.component_results(case, averages)
        estimates = {
            "D": values["component_diffusion"].at((..., 0)),
            "MSD": averages.estimate("component_msd").at((..., -1)),
            "alpha": values["component_non_gaussian_parameter"].at((..., -1)),
        }
        for name, estimate in estimates.items():
            expected = truth[name]
            is_covered[name].append((estimate.low <= expected) & (expected <= estimate.high))
            means[name].append(estimate.mean)
            errors[name].append(estimate.standard_error)
    for name in ("D", "MSD"):
        assert np.mean(is_covered[name], axis=0) == pytest.approx([0.95, 0.95], abs=0.045)
        scatter = np.std(means[name], axis=0)
        stated = np.sqrt(np.mean(np.square(errors[name]), axis=0))
        assert scatter / stated == pytest.approx([1.0, 1.0], abs=0.14)
    # as in the plane, where some 91 % of 50 runs are covered (`distribution.kurtosis`)
    assert np.mean(is_covered["alpha"], axis=0) == pytest.approx([0.91, 0.91], abs=0.06)


def test_non_gaussian_parameter_along_an_axis_is_that_of_its_distribution():
    """0 for normal steps, -2/5 for uniform ones, of 20,000 runs: within 5 standard errors."""
    rng = np.random.default_rng(3)
    scene = make_scene(boundary=CHANNEL_X)
    case = Case(scene, Engine("exact"), scene.times[:2], windows=(WINDOW,))
    steps = np.stack([rng.standard_normal(20_000), rng.uniform(-1, 1, 20_000)], axis=1)
    square = np.stack([0 * steps, steps**2], axis=-1)
    seen = {
        "square_displacement": square.sum(axis=1),
        "component_square_displacement": square,
        "component_quartic_displacement": square**2,
    }
    averages = Averages()
    for seeds in np.split(np.arange(20_000), range(1024, 20_000, 1024)):
        some = {name: values[seeds] for name, values in seen.items()}
        runs = Ensemble(seeds, case.times, None, some, {}, {}, {}, {})
        averages.add(seeds, components.component_columns(case, runs))
    values = components.component_results(case, averages)
    mean, error, _, _ = values["component_non_gaussian_parameter"].at((..., 1))
    assert (abs(mean - [0.0, -0.4]) < 5 * error).all() and (error < 0.05).all()


# -- marks -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("boundary", CHANNELS)
def test_d_along_a_channel_has_no_mark_where_a_quarter_of_the_slope_has_one(boundary):
    runs = make_runs(make_scene(boundary=boundary), np.arange(200), diffusion=5.0)
    result = analysis.aggregate([runs], [WINDOW])
    along, across = ("x", "y") if boundary == CHANNEL_X else ("y", "x")
    # 3/gamma of the scene is later than the window
    assert words(result, along) == "early"
    assert words(result, across) == "walls, early"
    assert result.diffusion_mark.item() & diffusive.WALLS
    shown = diffusive.fits_along_channels(result)
    expected = result.component_diffusion.sel(component=along)
    assert (shown.diffusion_coefficient == expected).all()
    assert (shown.diffusion_mark == result.component_diffusion_mark.sel(component=along)).all()
    assert shown.diffusion_coefficient.dims == result.diffusion_coefficient.dims


def test_in_an_oblong_box_of_walls_the_shorter_axis_is_filled_first():
    runs = make_runs(make_scene(box=OBLONG), np.arange(100), diffusion=0.6)
    result = analysis.aggregate([runs], [WINDOW])
    assert "channel_axis" not in result
    reduction = result.component_wall_reduction.isel(scene=0, particles=0, engine=0, window=0)
    assert 0 < reduction[0] < reduction[1] <= 1


@pytest.mark.parametrize("average", ["runs", "origins"])
def test_walls_reduce_the_slope_along_each_axis_by_what_the_msd_says(average):
    """The mean of the axes is the reduction of the slope of the whole MSD."""
    scene = make_scene(box=OBLONG)
    spread = 1.3
    growth = []
    for axis in (0, 1):
        msd, growth_along = displacement._msd_along_axis(axis, scene, average, spread)
        reduction = displacement.wall_reduction_along(axis, scene, average, msd)
        assert reduction == pytest.approx(1 - growth_along / 2, rel=1e-6)
        growth.append(growth_along)
    msd, _ = displacement._msd_between_walls(scene, average, spread)
    whole = displacement.wall_reduction(scene, average, msd)
    assert whole == pytest.approx(1 - sum(growth) / 4, rel=1e-6)
    assert displacement.wall_reduction_along(1, scene, average, 100.0) == 1.0
    channel = make_scene(boundary=CHANNEL_Y)
    assert displacement.wall_reduction_along(1, channel, average, 100.0) == 0.0


@pytest.mark.parametrize("boundary", CHANNELS)
def test_a_drift_adds_to_d_along_a_channel_twice_what_it_adds_to_half_of_it(boundary):
    moving = make_scene(boundary=boundary, velocities={"temperature": 1.0, "zero_momentum": False})
    result = analysis.aggregate([make_runs(moving, np.arange(10))], [WINDOW])
    along, across = ("x", "y") if boundary == CHANNEL_X else ("y", "x")
    drift = result.component_drift_diffusion
    total_mass = 1.0 + 19 * 0.4
    expected = 1.0 / total_mass * (WINDOW[0] + WINDOW[1]) / 2
    assert drift.sel(component=along).item() == pytest.approx(expected, rel=1e-12)
    assert 2 * result.window_drift_diffusion.item() == pytest.approx(expected, rel=1e-12)
    assert np.isnan(drift.sel(component=across)).all()


# -- in summary, tables and figures ----------------------------------------------------------------


def walks(boundary, name="channel", **more):
    """100 walks with D = 0.3 along x and 0.05 along y."""
    scene = make_scene(name, boundary=boundary, velocities={"temperature": 20.0}, **more)
    return make_runs(scene, np.arange(100), diffusion=[ALONG_X, ALONG_Y])


def without_marks(result):
    marks = ("diffusion_mark", "component_diffusion_mark")
    return result.assign({name: 0 * result[name] for name in marks})


@pytest.fixture(scope="module")
def of_channel():
    return analysis.aggregate([walks(CHANNEL_X)], [WINDOW])


@pytest.fixture(scope="module")
def of_oblong():
    """Walls with unequal sides."""
    return analysis.aggregate([walks(WALLS, "oblong", box=OBLONG)], [WINDOW])


@pytest.fixture(scope="module")
def of_boxes():
    """A periodic box, and channels along x and y."""
    boundaries = {"box": PERIODIC, "along_x": CHANNEL_X, "along_y": CHANNEL_Y}
    return analysis.aggregate([walks(boundaries[name], name) for name in boundaries], [WINDOW])


def test_the_summary_of_a_channel_has_d_along_it(of_channel):
    text = summary(of_channel)
    header, row = text.splitlines()[:2]
    assert header.split()[-1] == "D_x"
    d = of_channel.isel(scene=0, particles=0, engine=0, window=0, component=0)
    expected = plus_minus(d.component_diffusion, d.component_diffusion_standard_error)
    assert row.rstrip(" °").endswith(expected)
    assert "D_x: diffusion coefficient along x, slope/2, in the window [0.25, 1]." in text
    assert "slope/4" not in text and "walls reduce" not in text


def test_the_msd_of_a_summary_is_that_of_the_motion_beside_which_it_stands(of_boxes, of_oblong):
    """In its columns, in the table of numbers, and in words."""
    header, *rows = summary(of_boxes).splitlines()[:4]
    headings = [f"{name}(t = 1)" for name in ("MSD", "MSD_x", "MSD_y")]
    assert re.split("  +", header)[3:6] == headings
    at_end = of_boxes.isel(particles=0, engine=0, time=-1)
    msd = [at_end.msd[0], at_end.component_msd[1, 0], at_end.component_msd[2, 1]]
    cells = [re.split("  +", row)[3 + k].split()[0] for k, row in enumerate(rows)]
    assert [float(cell) for cell in cells] == pytest.approx(np.array(msd), abs=5e-4)
    assert summary_table(of_boxes).msd.tolist() == [value.item() for value in msd]
    text = summary(of_oblong)
    for axis in "xy":
        assert f"MSD_{axis}: mean squared displacement along {axis} of the tracer, at the" in text
    both = of_oblong.component_msd.isel(time=-1).values.ravel()
    assert summary_table(of_oblong).msd.tolist() == both.tolist()


@pytest.mark.parametrize("box", [OBLONG, BOX | {"boundary": CHANNEL_Y}])
def test_the_non_gaussian_parameter_of_a_summary_is_that_of_an_axis(box):
    scene = make_scene(box=box, velocities={"temperature": 1.0})
    observables = ["square_displacement", "quartic_displacement"]
    result = bp.analyse(bp.simulate(scene, 12, observables=observables, quiet=True), quiet=True)
    axes = ["y"] if scene.box.is_channel else ["x", "y"]
    header, row = (re.split("  +", line) for line in summary(result).splitlines()[:2])
    at_end = result.isel(scene=0, particles=0, engine=0, time=-1)
    for axis in axes:
        cell = row[header.index(f"alpha_2_{axis}")]
        part = at_end.sel(component=axis)
        value = part.component_non_gaussian_parameter
        error = part.component_non_gaussian_parameter_standard_error
        assert cell == plus_minus(value, error)
    table = summary_table(result).drop_duplicates("component").set_index("component")
    expected = at_end.component_non_gaussian_parameter.sel(component=axes)
    assert table.non_gaussian_parameter.tolist() == expected.values.tolist()
    assert table.index.tolist() == axes


def test_the_summary_of_several_boxes_has_a_column_for_each_d(of_boxes):
    lines = summary(of_boxes).splitlines()
    assert lines[0].split()[-3:] == ["D", "D_x", "D_y"]
    cells = [re.split("  +", line)[-3:] for line in lines[1:4]]
    is_there = [[cell != "-" for cell in row] for row in cells]
    assert is_there == np.eye(3, dtype=bool).tolist()
    table = summary_table(of_boxes)
    assert table.component.tolist() == ["", "x", "y"]
    shown = diffusive.fits_along_channels(of_boxes).diffusion_coefficient.values
    values = [shown[k, 0, 0, 0] for k in range(3)]
    assert table.diffusion_coefficient.tolist() == values
    assert table.slope.tolist() == pytest.approx([4 * values[0], 2 * values[1], 2 * values[2]])


def test_the_summary_of_unequal_walls_has_d_along_each_axis(of_oblong):
    """What swaps the axes, or gives half of a slope for another, is found by the exact values."""
    text = summary(of_oblong)
    header, row = text.splitlines()[:2]
    assert header.split()[-2:] == ["D_x", "D_y"]
    cells = [cell.rstrip(" °") for cell in re.split("  +", row)[-2:]]
    table = summary_table(of_oblong)
    assert table.component.tolist() == ["x", "y"]
    for axis, cell in zip((0, 1), cells, strict=True):
        slopes = 2 * of_oblong.run_component_diffusion.isel(component=axis).values.ravel()
        error = slopes.std(ddof=1) / 10
        assert cell == plus_minus(slopes.mean() / 2, error / 2)
        assert table.diffusion_coefficient[axis] == pytest.approx(slopes.mean() / 2, rel=1e-9)
        assert table.slope[axis] == pytest.approx(slopes.mean(), rel=1e-9)
    d_x, d_y = table.diffusion_coefficient
    assert d_x > 3 * d_y  # six times
    for axis in "xy":
        line = f"D_{axis}: diffusion coefficient along {axis}, slope/2, in the window [0.25, 1]."
        assert line in text
    frame = bp.table(of_oblong)
    assert frame.component.tolist() == ["x", "y"]
    assert frame.diffusion_coefficient.tolist() == [d_x, d_y]


def test_reasons_against_d_name_its_axis():
    """The walls stop the motion along y alone, at a third of the square of the half-width."""
    narrow = {"x": [-30.0, 30.0], "y": [-0.8, 0.8], "boundary": WALLS}
    runs = make_runs(make_scene(box=narrow), np.arange(100), diffusion=[ALONG_X, 0.2])
    result = analysis.aggregate([runs], [WINDOW])
    text = " ".join(summary(result).split())
    limit = (0.8 - 0.3) ** 2 / 3
    assert result.component_msd_limit.values.ravel()[1] == pytest.approx(limit, rel=1e-12)
    msd = result.component_msd.values[0, 0, 0, 1, -1]
    where = f"where the MSD is {msd:.3g} of at most {limit:.3g} for plain, N = 20, along y"
    assert f"walls reduce the slope at its end in 1 of 2 fits, by 100 % {where}" in text


def test_the_answer_says_how_far_and_how_fast_along_the_same_axis(of_channel, of_oblong):
    for result, axes in ((of_channel, "x"), (of_oblong, "xy")):
        error = 1e-3 * result.component_slope_change_standard_error
        plain = without_marks(result).assign(component_slope_change_standard_error=error)
        (text,) = answer_in_words(plain)
        expected = []
        for axis in axes:
            case = plain.sel(component=axis).isel(scene=0, particles=0, engine=0, window=0)
            root = float(case.component_msd[-1]) ** 0.5
            moved = plus_minus(root, float(case.component_msd_standard_error[-1]) / (2 * root))
            d = plus_minus(case.component_diffusion, case.component_diffusion_standard_error)
            expected.append(
                f"After 1 time unit the tracer has moved by {moved} along {axis} on average (root "
                f"of the MSD along {axis}). It diffuses along {axis}: D_{axis} = {d} between "
                "t = 0.25 and 1."
            )
        assert text == " ".join(expected)


def test_a_channel_without_a_fit_has_no_d():
    """Two samples after t = 0, beside one with twenty."""
    scenes = [make_scene("fine", boundary=CHANNEL_X)]
    scenes.append(make_scene("coarse", boundary=CHANNEL_X, sample_interval=0.5))
    result = analysis.aggregate([make_runs(scene, np.arange(10)) for scene in scenes], [WINDOW])
    header, fine, coarse = summary(result).splitlines()[:3]
    assert header.endswith("D_x") and "±" in fine and coarse.endswith(" -")
    assert summary_table(result).diffusion_coefficient.isna().tolist() == [False, True]
    assert "D_x" in answer_in_words(result)[0]
    assert "D_x" not in answer_in_words(result)[1]


def test_the_power_is_that_of_the_tests_along_channels(of_channel, of_boxes):
    """Two components of one window; of three boxes three tests of all motion, and four."""
    cases = [without_marks(case) for case in cases_of(of_channel)]
    text = " ".join(power_in_words(cases))
    assert text.startswith("D_x without °") and "for 2 tests" in text
    cases = [without_marks(case) for case in cases_of(of_boxes)]
    text = " ".join(power_in_words(cases))
    assert text.startswith("D or D_x or D_y without °") and "for 3 tests or 4 tests" in text


def test_the_green_kubo_integral_of_a_channel_is_that_along_it(of_boxes):
    """And of no other box; without a temperature it is not a D."""
    integral = 0.2 + 0 * of_boxes.msd
    along = xr.concat([0.3 + 0 * of_boxes.msd, 0.5 + 0 * of_boxes.msd], of_boxes.component)
    along = along.where(of_boxes.component_diffusion.notnull().any("window"))
    known = {f"green_kubo{suffix}": integral for suffix in SUFFIXES}
    known |= {f"component_green_kubo{suffix}": along for suffix in SUFFIXES}
    known["enskog_diffusion"] = 0.2 + 0 * of_boxes.packing_fraction
    result = of_boxes.assign(known)
    header, *rows = summary(result).splitlines()[:4]
    columns = [f"{name} (Green-Kubo)" for name in ("D", "D_x", "D_y")]
    starts = [header.index(column) for column in columns]
    cells = [[row[start:].split()[0] for start in starts] for row in rows]
    assert cells == [["0.20", "-", "-"], ["-", "0.30", "-"], ["-", "-", "0.50"]]
    assert summary_table(result).green_kubo.tolist() == [0.2, 0.3, 0.5]
    assert "Green-Kubo" not in summary(result.drop_vars("enskog_diffusion"))


def test_a_sum_over_both_components_is_not_shown_as_that_of_one(of_channel):
    integral = {f"green_kubo{suffix}": 0.2 + 0 * of_channel.msd for suffix in SUFFIXES}
    integral["enskog_diffusion"] = 0.2 + 0 * of_channel.packing_fraction
    assert "Green-Kubo" not in summary(of_channel.assign(integral))


@pytest.fixture(scope="module")
def of_fluids():
    """Runs of disks in a channel along y, and between walls of unequal lengths."""
    disks = {"species": [{"name": "disk", "count": 12, "radius": 0.4, "mass": 1.0}]}
    results = {}
    for name, boundary in (("channel", CHANNEL_Y), ("oblong", WALLS)):
        scene = bp.Scene(
            box={"x": [0, 4], "y": [0, 8], "boundary": boundary},
            disks=disks,
            velocities={"temperature": 1.0, "zero_momentum": name == "channel"},
            equilibrate={"time": 2.0, "tracer": "free"},
            duration=4.0,
            sample_interval=0.1,
            name=name,
        )
        observables = ["square_displacement", "velocity_autocorrelation"]
        runs = bp.simulate(scene, 12, observables=observables, average="origins", quiet=True)
        results[name] = bp.analyse(runs, fit_windows=[(0.5, 2.0)], quiet=True)
    return results


@pytest.mark.parametrize("name", ["channel", "oblong"])
def test_what_follows_from_velocities_is_the_sum_of_its_components(of_fluids, name):
    result = of_fluids[name]
    shares = {"velocity_autocorrelation": 1.0, "green_kubo": 0.5, "diffusion_running": 0.5}
    for variable, share in shares.items():
        total = share * result[f"component_{variable}"].sum("component")
        np.testing.assert_allclose(total, result[variable], rtol=1e-12, atol=1e-13)


def test_both_components_of_the_autocorrelation_are_drawn(of_fluids):
    for result in of_fluids.values():
        upper, _ = bp.plot(result, "velocity_autocorrelation").axes
        assert upper.get_legend_handles_labels()[1][:2] == ["along x", "along y"]
        of_tracer = result.component_velocity_autocorrelation.squeeze()
        for line, curve in zip(upper.lines[1:3], of_tracer.values, strict=True):
            np.testing.assert_allclose(line.get_ydata(), curve / curve[0], rtol=1e-12)
        table = table_of_autocorrelations(cases_of(result))
        total = table["velocity_autocorrelation along x"]
        total = total + table["velocity_autocorrelation along y"]
        np.testing.assert_allclose(total, table.velocity_autocorrelation, rtol=1e-10, atol=1e-13)


def test_d_along_a_channel_is_drawn_by_every_route(of_fluids):
    result = of_fluids["channel"]
    (axes,) = bp.plot(result, "diffusion").axes
    labels = axes.get_legend_handles_labels()[1]
    assert labels[0].startswith("d$\\langle y^2 \\rangle$/d$t$ / 2")
    assert labels[1].startswith("$\\langle y^2 \\rangle$ / 2$t$")
    assert labels[2].startswith("Green-Kubo: $\\langle v_y(0)")
    along = result.sel(component="y").squeeze()
    curves = (
        along.component_diffusion_running,
        along.component_msd / 2 / along.time,
        along.component_green_kubo,
    )
    for line, curve in zip(axes.lines, curves, strict=False):
        np.testing.assert_allclose(line.get_ydata(), curve[1:], rtol=1e-12)
    table = table_of_diffusion(cases_of(result))
    np.testing.assert_array_equal(table["green_kubo along y"], along.component_green_kubo)
    header = summary(result).splitlines()[0]
    assert "D_y (Green-Kubo)" in header and "D_x" not in header


def test_the_slope_and_the_integral_of_the_autocorrelation_have_one_d_along_a_channel(of_fluids):
    """d<y^2>/dt / 2 and the integral are equal at each time in equilibrium: within 5 standard
    errors.
    """
    along = of_fluids["channel"].sel(component="y").squeeze().isel(time=slice(1, 21))
    difference = abs(along.component_diffusion_running - along.component_green_kubo)
    error = np.hypot(
        along.component_diffusion_running_standard_error, along.component_green_kubo_standard_error
    )
    assert (difference < 5 * error).all()


@pytest.mark.parametrize("boundary", [PERIODIC, CHANNEL_X, "reflecting"])
def test_the_ring_of_an_integral_has_its_reason_where_no_slope_is_stated(boundary):
    """A summary has the columns that its observables ask for; four runs tell nothing of a slope."""
    scene = make_scene(
        box=BOX | {"boundary": boundary},
        disks={"species": [{"name": "disk", "count": 20, "radius": 0.3, "mass": 1.0}]},
        velocities={"temperature": 1.0},
        equilibrate={"time": 1.0, "tracer": "free"},
    )
    runs = bp.simulate(scene, 4, observables="velocity_autocorrelation", quiet=True)
    result = bp.analyse(runs, quiet=True)  # given fit windows would ask for D
    header, row, *legend = summary(result).splitlines()
    assert "(Green-Kubo)" in header and "MSD" not in header
    assert row.endswith("°")
    assert any(line.startswith("° D") and "is not that of diffusion" in line for line in legend)


def test_without_displacements_no_integral_is_stated_as_a_d():
    """Nothing would tell whether it is one: between walls it is not, and had no mark."""
    scene = make_scene(
        boundary=CHANNEL_X,
        disks={"species": [{"name": "disk", "count": 20, "radius": 0.3, "mass": 1.0}]},
        velocities={"temperature": 1.0},
        equilibrate={"time": 1.0, "tracer": "free"},
    )
    runs = bp.simulate(scene, 4, record="none", observables="velocity_autocorrelation", quiet=True)
    result = bp.analyse(runs, quiet=True)
    assert result.component_green_kubo.notnull().all()
    assert "Green-Kubo" not in summary(result) and "green_kubo" not in bp.table(result)
    assert answer_in_words(result) == []


def test_the_figure_of_the_msd_has_both_components_and_names_them(of_channel, of_boxes):
    (axes, below) = bp.plot(of_channel, "msd").axes
    labels = axes.get_legend_handles_labels()[1]
    assert [label.split(":")[0] for label in labels[:2]] == ["along x", "along y"]
    assert "$\\langle x^2 \\rangle$(1) = " in labels[0]
    assert sum("$D_x$ = " in label or "$D_x$ over" in label for label in labels) >= 1
    curve = axes.lines[1].get_ydata()
    np.testing.assert_array_equal(curve, of_channel.component_msd.values[0, 0, 0, 1])
    assert len(below.lines) >= 2
    squares = {axis: f"$\\langle {axis}^2 \\rangle$" for axis in "xyr"}
    both = f"{squares['x']}, {squares['y']}"
    assert axes.get_ylabel() == f"mean squared displacement {both}"
    assert below.get_ylabel() == both
    (axes, _) = bp.plot(of_boxes, "msd").axes
    assert axes.get_ylabel() == f"mean squared displacement {squares['r']}, {both}"
    labels = " ".join(axes.get_legend_handles_labels()[1])
    assert labels.count("$D_x$ over") == labels.count("$D_y$ over") == 2


def test_axes_of_ones_own_are_labelled_by_component(of_channel):
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    bp.plot(of_channel, "msd", ax=axes)
    both = "$\\langle x^2 \\rangle$, $\\langle y^2 \\rangle$"
    assert axes.get_ylabel() == f"mean squared displacement {both}"


def test_the_table_of_the_msd_has_both_components(of_channel):
    table = table_of_msd(cases_of(of_channel))
    total = table["msd along x"] + table["msd along y"]
    np.testing.assert_allclose(total, table.msd, rtol=1e-12)
    inside = table.time >= WINDOW[0] - 1e-9
    line = table["fit along x over [0.25, 1]"]
    assert line.notnull().tolist() == inside.tolist()
    slope = np.diff(line[inside]) / np.diff(table.time[inside])
    assert slope == pytest.approx(of_channel.component_slope.values[0, 0, 0, 0, 0])


def test_figures_of_d_have_that_along_the_channel(of_channel, of_boxes):
    (axes,) = bp.plot(of_channel, "diffusion").axes
    labels = axes.get_legend_handles_labels()[1]
    assert labels[0] == "$\\langle x^2 \\rangle$ / 2$t$"
    assert labels[1].startswith("slope/2: $D_x$ over [0.25, 1] = ")
    msd = of_channel.component_msd.values[0, 0, 0, 0, 1:]
    expected = msd / 2 / of_channel.time.values[1:]
    np.testing.assert_allclose(axes.lines[0].get_ydata(), expected, rtol=1e-12)
    (axes,) = bp.plot(of_boxes, "diffusion").axes
    assert "$D_y$ over" in " ".join(axes.get_legend_handles_labels()[1])


def test_a_scan_of_unequal_walls_has_d_along_each_axis():
    """Beside a square, whose D is that of all motion."""
    scenes = {"oblong": make_scene("oblong", box=OBLONG), "square": make_scene("square")}
    runs = []
    for scene in scenes.values():
        for number in (10, 20):
            more_disks = scene.replace(particles=number)
            runs.append(make_runs(more_disks, np.arange(30), diffusion=[ALONG_X, ALONG_Y]))
    result = analysis.aggregate(runs, [WINDOW])
    panels = {panel.get_ylabel(): panel for panel in bp.plot(result, "scan").axes}
    panel = panels["$D$ = slope/4; $D_x$, $D_y$ = slope/2"]
    labels = panel.get_legend_handles_labels()[1]
    assert labels == ["oblong, along x", "oblong, along y", "square"]
    table = table_of_scan(cases_of(result))
    assert table.component.tolist() == ["x", "x", "y", "y", "", ""]
    d = table.diffusion_coefficient.values.reshape(3, 2)
    expected = result.component_diffusion.sel(scene="oblong").values[:, 0, :, 0].T
    np.testing.assert_array_equal(d[:2], expected)
    np.testing.assert_array_equal(d[2], result.diffusion_coefficient.values[1, :, 0, 0])
    msd = table.msd.values.reshape(3, 2)
    at_end = result.isel(time=-1, engine=0)
    of_oblong = at_end.component_msd.sel(scene="oblong").values.T
    np.testing.assert_array_equal(msd[:2], of_oblong)
    np.testing.assert_array_equal(msd[2], at_end.msd.sel(scene="square"))
    change = np.diff(of_oblong, axis=1).ravel()
    assert table.msd_difference.values[[1, 3]] == pytest.approx(change, rel=1e-9)
    panel = panels["$\\langle x^2 \\rangle$, $\\langle y^2 \\rangle$, $\\langle r^2 \\rangle$"]
    assert panel.get_legend_handles_labels()[1] == labels


def test_a_scan_of_channels_has_d_along_them():
    runs = []
    for number in (10, 20):
        scene = make_scene(particles=number, boundary=CHANNEL_Y, velocities={"temperature": 20.0})
        runs.append(make_runs(scene, np.arange(30), diffusion=[ALONG_X, ALONG_Y]))
    result = analysis.aggregate(runs, [WINDOW])
    labels = [axes.get_ylabel() for axes in bp.plot(result, "scan").axes]
    assert "$D_y$ = slope/2" in labels
    table = table_of_scan(cases_of(result))
    assert table.component.tolist() == ["y", "y"]
    along = result.run_component_diffusion.sel(component="y").squeeze()
    difference = (along[1] - along[0]).mean().item()
    assert table.diffusion_coefficient_difference[1] == pytest.approx(difference, rel=1e-12)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_channel_is_drawn_beside_a_periodic_box(order, tmp_path):
    """Parts along x and y beside a case of all motion, whichever comes first."""
    channel = make_scene(box=BOX | {"boundary": CHANNEL_X})
    periodic = channel.replace(box=BOX | {"boundary": PERIODIC}, name="periodic")
    runs = [bp.simulate(scene, 4, quiet=True) for scene in (channel, periodic)]
    result = analysed([runs[k] for k in order])
    for name in ("msd", "diffusion"):
        bp.plot(result, name).savefig(tmp_path / f"{name}.png")
    assert len(bp.table(result)) == 2


@pytest.fixture(scope="module")
def runs_with_velocities():
    """Four runs in a channel along x, in a box of unequal walls and in a periodic box, of which
    velocity autocorrelations alone are measured in the last.
    """
    observables = {"periodic": ["velocity_autocorrelation"]}
    runs = {}
    for name, boundary in {"channel": CHANNEL_X, "oblong": WALLS, "periodic": PERIODIC}.items():
        scene = make_scene(
            name,
            box=OBLONG | {"boundary": boundary},
            velocities={"temperature": 1.0},
            equilibrate={"time": 1.0, "tracer": "free"},
        )
        measured = observables.get(name, ["square_displacement", "velocity_autocorrelation"])
        runs[name] = bp.simulate(scene, 4, record="none", observables=measured, quiet=True)
    return runs


@pytest.mark.parametrize("order", [("channel", "periodic"), ("periodic", "channel")])
def test_tables_have_the_components_of_a_channel_beside_a_periodic_box(order, runs_with_velocities):
    """Columns that the periodic box lacks are empty in its rows, whichever comes first."""
    result = analysed([runs_with_velocities[name] for name in order])
    columns = ["velocity_autocorrelation along x", "velocity_autocorrelation along y"]
    table = table_of_autocorrelations(cases_of(result)).set_index("scene")
    is_there = table[columns].notnull().groupby("scene").all()
    assert is_there.loc["channel"].all() and not is_there.loc["periodic"].any()
    table = table_of_diffusion(cases_of(result)).set_index("scene")
    for name in ("diffusion_running along y", "green_kubo along x"):
        is_there = table[name].notnull().groupby("scene").any()
        assert is_there["channel"] and not is_there["periodic"]


def test_curves_of_components_are_told_apart_beside_a_periodic_box(runs_with_velocities):
    """Also by default windows, which are chosen for boxes of all kinds together."""
    result = bp.analyse([*runs_with_velocities.values()], quiet=True)
    labels = bp.plot(result, "velocity_autocorrelation").axes[0].get_legend_handles_labels()[1]
    curves = [label.split(":")[0] for label in labels if "lower panel" not in label]
    assert curves == [
        *("channel, along x", "channel, along y", "oblong, along x", "oblong, along y"),
        "periodic",
    ]


@pytest.mark.parametrize("names", [("channel", "periodic"), ("oblong",)])
def test_the_table_says_along_which_axis_an_integral_is(names, runs_with_velocities):
    result = analysed([runs_with_velocities[name] for name in names])
    at_end = result.component_green_kubo.sel(time=result.window_end[0])
    for row in bp.table(result).itertuples():
        if row.component:
            of_axis = at_end.sel(scene=row.scene, component=row.component).item()
            assert row.green_kubo == pytest.approx(of_axis, rel=1e-12)
    expected = {"channel": ["x"], "oblong": ["x", "y"], "periodic": [""]}
    found = bp.table(result).groupby("scene").component.agg(list).to_dict()
    assert found == {name: expected[name] for name in names}


def test_the_table_of_numbers_says_at_which_time_they_are(of_fluids):
    """With averages over time origins MSD and integral are those at the end of the window, not of
    the runs.
    """
    result = of_fluids["channel"]
    row = summary_table(result).iloc[0]
    at_end = result.sel(time=row.msd_time, component=row.component).squeeze()
    assert row.duration == 4.0 and row.msd_time == row.green_kubo_time == 2.0
    assert row.msd == at_end.component_msd.item()
    assert row.green_kubo == at_end.component_green_kubo.item()


def test_the_summary_says_over_which_disks_an_integral_is():
    """Also where the displacement is the tracer's alone."""
    disks = {"species": [{"name": "disk", "count": 20, "radius": 0.3, "mass": 1.0}]}
    scene = make_scene(
        boundary=CHANNEL_X,
        disks=disks,
        velocities={"temperature": 1.0},
        equilibrate={"time": 1.0, "tracer": "free"},
    )
    observables = "velocity_autocorrelation"
    runs = bp.simulate(scene, 4, observables=observables, average="disks", quiet=True)
    result = analysed(runs)
    of_tracer = result.attrs["msd_of"]
    of_disks = result.attrs["velocity_autocorrelation_of"]
    assert (of_tracer, of_disks) == ("the tracer", "all disks equal to the tracer")
    text = " ".join(summary(result).split())
    assert f"integral of the velocity autocorrelation along x of {of_disks}, at" in text
