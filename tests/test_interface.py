"""The Python interface gives the numbers of the command line, to the bit, and names the argument
that is wrong.
"""

import io
import math
import multiprocessing
import os
import re
import subprocess
import sys
import time
from fractions import Fraction
from functools import partial
from importlib.metadata import version
from inspect import signature
from pathlib import Path

import h5py
import matplotlib.pyplot as plt
import numpy as np
import pandas
import pytest
import xarray
import yaml
from matplotlib.figure import Figure
from PIL import Image

import brownpipe as bp
import forked
from brownpipe import interface, progress
from brownpipe.analysis import diffusive
from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.engines.exact import run as exact_run
from brownpipe.errors import (
    AnalysisError,
    BrownpipeError,
    FigureError,
    RequestError,
    RunError,
    StorageError,
)
from brownpipe.observables.trajectory import displacement
from brownpipe.scene import parse_scene
from pipeline import ROOT, environment
from synthetic import render

SCENE = str(ROOT / "config" / "scenes" / "harrison2020.yaml")
KEYS = yaml.safe_load(Path(SCENE).read_text())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Runs and their analysis, made by the command line."""
    folder = tmp_path_factory.mktemp("interface")
    words = [
        "--particles",
        "20",
        "--seeds",
        "0-9",
        "--record",
        "all,events",
        "--observables",
        "square_displacement",
    ]
    assert main(["simulate", SCENE, *words, "--output", str(folder / "runs.h5")]) == 0
    assert main(["aggregate", str(folder / "runs.h5"), "--output", str(folder / "study.nc")]) == 0
    return folder


@pytest.fixture(scope="module")
def runs():
    return bp.simulate(
        SCENE,
        10,
        particles=20,
        record=["all", "events"],
        observables=["square_displacement"],
        quiet=True,
    )


@pytest.mark.parametrize(("engine", "settings"), [("exact", {}), ("timestep", {"time_step": 0.1})])
def test_runs_without_disks_have_the_tracks_of_no_disks(engine, settings):
    empty = bp.read_scene(ROOT / "tests" / "scenes" / "empty.yaml")
    runs = bp.simulate(empty, engine=engine, record="all", quiet=True, **settings)
    sizes = {"time": 2, "seed": 1, "disk": 0, "component": 2}
    assert runs.disks.position.sizes == sizes
    assert "disks" not in bp.simulate(empty, engine=engine, quiet=True, **settings).children


@pytest.fixture(scope="module")
def result(runs):
    return bp.analyse(runs)


@pytest.mark.slow
def test_runs_and_analysis_are_those_of_the_command_line_to_the_byte(folder, runs, result):
    bp.save(runs, folder / "mine.h5")
    assert (folder / "mine.h5").read_bytes() == (folder / "runs.h5").read_bytes()
    assert bp.open(folder / "runs.h5").identical(runs)
    assert result.identical(bp.open(folder / "study.nc"))
    bp.save(result, folder / "mine.nc")
    assert (folder / "mine.nc").read_bytes() == (folder / "study.nc").read_bytes()
    assert bp.analyse(folder / "runs.h5").identical(result)


@pytest.mark.slow
def test_runs_in_parts_in_memory_and_in_files_make_the_same_analysis(folder, runs, result):
    first = runs.isel(seed=slice(4))
    second = runs.isel(seed=slice(4, None))
    bp.save(second, folder / "second.h5")
    assert bp.analyse([first, str(folder / "second.h5")]).identical(result)
    assert bp.open(folder / "second.h5").events.a.count() == second.events.a.count()


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (lambda runs: runs.isel(time=slice(50)), "of time it must hold all 101 in order; select"),
        (lambda runs: runs.sel(component=["x"]), "of component it must hold all 2"),
        (lambda runs: runs.sel(component=["y", "x"]), "of component it must hold all 2 in order"),
        (lambda runs: runs.isel(seed=[]), "different integers"),
        (lambda runs: runs.isel(seed=[0, 0]), "different integers"),
        (
            lambda runs: runs.map_over_datasets(
                lambda node: node.assign_coords(seed=node.seed * 1.0)
            ),
            "different integers",
        ),
        (lambda runs: runs.sel(seed=3), r" a selection of its seeds, as in sel\(seed=\[3\]\)"),
        (lambda runs: runs.isel(disk=slice(5)), "of disk it must hold all 20"),
        (
            lambda runs: runs.isel(event=slice(30)),
            "of event it must hold all collisions of each run",
        ),
    ],
)
def test_another_selection_is_neither_analysed_nor_saved(runs, tmp_path, part, message):
    """Rates refer to the whole duration, displacements to the first sample and, in a periodic box,
    to both axes.
    """
    selected = part(runs)
    with pytest.raises(
        RequestError, match=f"runs: must be what simulate or open returns.*{message}"
    ):
        bp.save(selected, tmp_path / "part.h5")
    assert not (tmp_path / "part.h5").exists()
    if "of disk" not in message and "of event" not in message:
        with pytest.raises(RequestError, match=message):
            bp.analyse(selected)


def test_periodic_runs_without_image_are_not_analysed():
    scene = bp.Scene(**KEYS | {"box": KEYS["box"] | {"boundary": "periodic"}, "particles": 20})
    runs = bp.simulate(scene, 2, quiet=True)
    wrapped = xarray.DataTree(runs.to_dataset().drop_vars("image"), name=runs.name)
    with pytest.raises(RequestError, match="lacks image"):
        bp.analyse(wrapped)


@pytest.mark.slow
def test_variables_that_a_user_adds_are_neither_analysed_nor_saved(runs, result, tmp_path):
    """Nor is one taken for an observable that was not measured."""
    heated = runs.copy()
    logged = runs.copy()
    joined = runs.copy()
    heated["disks/energy"] = runs.disks.mass * 1
    logged["events/energy"] = runs.events.a * 1
    joined["mine"] = xarray.DataTree(xarray.Dataset({"a": 1}))
    for name, added in (
        ("quartic_displacement", runs.assign(quartic_displacement=runs.square_displacement**2)),
        ("early", runs.assign(early=runs.tracer_collisions > 1)),
        ("energy", logged),
        ("a;", joined),
        ("displaced", runs.assign(displaced=runs.position * 1)),
        ("energy", heated),
        ("speed", runs.assign(speed=runs.failed * 1)),
    ):
        assert bp.analyse(added).equals(result)
        with pytest.raises(RequestError, match=f"a file has no place for {name}"):
            bp.save(added, tmp_path / "added.h5")


COLLIDING = {"box": {"x": (0, 3), "y": (0, 3)}, "duration": 4.0, "sample_interval": 1.0}


@pytest.fixture(scope="module")
def colliding(tmp_path_factory):
    """Runs 3 to 7 of eight disks between walls, and their file."""
    species = [{"name": "bath", "count": 8, "radius": 0.2, "mass": 1.0}]
    scene = bp.Scene(**COLLIDING, disks={"species": species}, velocities={"temperature": 1.0})
    runs = bp.simulate(scene, range(3, 8), record=["tracer", "events"], quiet=True)
    path = tmp_path_factory.mktemp("colliding") / "colliding.h5"
    bp.save(runs, path)
    return scene, runs, path


def log_of(events):
    """The collisions of a run, without coordinates."""
    return events.to_dataset().reset_coords(drop=True).dropna("event")


@pytest.mark.parametrize("route", ["simulate", "open", "open_datatree"])
@pytest.mark.parametrize("seeds", [6, [6], [7, 4], [4, 7, 3]], ids=str)
def test_a_selection_of_seeds_has_the_collisions_of_these_runs_alone(colliding, route, seeds):
    scene, runs, path = colliding
    if route == "simulate":
        tree = runs
    elif route == "open":
        tree = bp.open(path)
    else:
        with xarray.open_datatree(path) as opened:
            tree = opened.load()
    by_label = tree.sel(seed=seeds).events
    by_place = tree.isel(seed=np.array(seeds) - 3).events
    assert by_label.identical(by_place)
    for seed in np.atleast_1d(seeds).tolist():
        alone = bp.simulate(scene, [seed], record=["tracer", "events"], quiet=True)
        log = log_of(alone.events.isel(seed=0))
        assert log_of(by_label.sel(seed=seed) if np.ndim(seeds) else by_label).equals(log)
        assert log.sizes["event"] == alone.pair_collisions + alone.wall_collisions > 20
    walls = int((by_label.b < 0).sum())
    assert walls == int(runs.wall_collisions.sel(seed=np.atleast_1d(seeds)).sum())


def test_a_saved_selection_has_the_collisions_of_its_runs(colliding, tmp_path):
    scene, runs, _ = colliding
    bp.save(runs.sel(seed=[7, 4]), tmp_path / "two.h5")
    alone = bp.simulate(scene, [4], record=["tracer", "events"], quiet=True)
    bp.save(bp.open(tmp_path / "two.h5").sel(seed=[4]), tmp_path / "one.h5")
    assert bp.open(tmp_path / "one.h5").identical(alone)


def test_runs_that_xarray_has_open_are_read_all_the_same(colliding, tmp_path):
    runs, path = colliding[1:]
    result = bp.analyse(runs, quiet=True)
    bp.save(result, tmp_path / "result.nc")
    with xarray.open_datatree(path) as tree, xarray.open_dataset(tmp_path / "result.nc") as dataset:
        assert bp.open(path).identical(runs)
        assert bp.analyse(path, quiet=True).identical(result)
        assert bp.open(tmp_path / "result.nc").identical(result)
        assert (tree.sizes["seed"], dataset.sizes["seed"]) == (5, 5)
    with h5py.File(path) as file:
        assert bp.open(path).identical(runs)
        assert len(file["seed"]) == 5


@pytest.mark.parametrize("stream", [None, type("Stream", (), {"write": print, "flush": print})()])
def test_no_terminal_is_needed(monkeypatch, stream):
    monkeypatch.setattr(sys, "stderr", stream)
    assert bp.analyse(bp.simulate(SCENE, 2, particles=20)).sizes["seed"] == 2


def test_a_tree_has_names_units_and_meanings(runs):
    assert runs.position.dims == ("time", "seed", "component")
    assert runs.disks.position.dims == ("time", "seed", "disk", "component")
    assert np.array_equal(runs.disks.position.sel(disk=0), runs.position)
    assert (runs.position.units, runs.events.event_time.units) == ("length", "time")
    assert list(runs.component.values) == ["x", "y"]
    assert runs.failed.sum() == 0
    variables = [v for node in runs.subtree for v in node.to_dataset().variables.values()]
    assert all(variable.attrs["units"] and variable.attrs["long_name"] for variable in variables)
    squares = ((runs.position - runs.position.isel(time=0)) ** 2).sum("component")
    np.testing.assert_allclose(
        squares.transpose("seed", "time"), runs.square_displacement, rtol=1e-12, atol=1e-15
    )


def test_engines_take_their_settings_as_arguments():
    runs = bp.simulate(
        SCENE, [3, 5], particles=20, engine="timestep", time_step=np.float32(2**-6), quiet=True
    )
    assert (runs.attrs["engine"], list(runs.seed.values)) == ("timestep", [3, 5])
    with pytest.warns(UserWarning, match="langevin is rough here"):
        runs = bp.simulate(SCENE, 2, engine="langevin", friction="enskog", quiet=True)
    assert runs.attrs["settings"] == '{"friction": "enskog"}'


def test_runs_that_failed_are_named(monkeypatch):
    monkeypatch.setattr(exact_run, "HEALTH_BOUND", 1e-30)
    with pytest.warns(
        UserWarning,
        match="^harrison2020: failed their health check: 2 of 2 runs: 0-1; analyse leaves",
    ):
        bp.simulate(SCENE, 2, particles=20, quiet=True)


@pytest.mark.parametrize(
    ("engine", "further"),
    [
        ({}, ["all"]),
        ({"engine": "timestep", "time_step": 0.01}, ["all"]),
        ({"engine": "langevin"}, []),
    ],
)
def test_the_velocity_of_the_tracer_is_recorded_if_asked(tmp_path, capsys, engine, further):
    friction = {"friction": "enskog"} if engine.get("engine") == "langevin" else {}
    keys = {"box.boundary": "periodic", "disks.tracer.mass": 8.0, "velocities.zero_momentum": False}
    scene = bp.read_scene(SCENE, 20).replace(**keys)
    measured = ["velocity_distribution"] if further else []
    runs = bp.simulate(
        scene,
        3,
        record=["velocity", *further],
        observables=measured,
        quiet=True,
        **engine,
        **friction,
    )
    assert not further or runs.velocity_counts.dims == ("seed", "species", "velocity_bin")
    assert (runs.velocity.dims, runs.velocity.units) == (runs.position.dims, "length/time")
    first = (runs.velocity.isel(time=0) ** 2).sum("component")
    np.testing.assert_allclose(first, runs.initial_square_speed, rtol=1e-12)
    if further:
        assert np.array_equal(runs.velocity, runs.disks.velocity.sel(disk=0))
    bp.save(
        runs.map_over_datasets(xarray.Dataset.transpose), tmp_path / "runs.h5"
    )  # whatever the order of dimensions
    assert bp.open(tmp_path / "runs.h5").identical(runs)
    assert main(["inspect", str(tmp_path / "runs.h5"), "--reproduce"]) == 0
    assert "identical: 3 runs" in capsys.readouterr().out
    with pytest.raises(AnalysisError, match="another --record"):
        bp.analyse(
            [runs, bp.simulate(scene, [7], observables=measured, quiet=True, **engine, **friction)]
        )


def test_positions_go_on_where_a_periodic_box_ends(runs):
    box = KEYS["box"] | {"boundary": "periodic", "y": (-3, 4)}
    scene = bp.Scene(**KEYS | {"box": box, "particles": 20})
    wrapped = bp.simulate(scene, 5, record="all", quiet=True)
    assert (wrapped.unwrapped.units, wrapped.box_size.values.tolist()) == ("length", [6.0, 7.0])
    steps = wrapped.disks.unwrapped.diff("time")
    wrapped_steps = wrapped.disks.position.diff("time")
    assert np.abs(steps).max() < 2.0 < np.abs(wrapped_steps).max()
    assert wrapped.disks.unwrapped.sel(disk=0).variable.equals(wrapped.unwrapped.variable)
    assert runs.unwrapped.variable.equals(runs.position.variable)


def test_displacements_of_far_disks_keep_their_digits():
    """A single disk crosses some 4 million boxes, in steps of 15. From t = 0 `unwrapped` is as
    exact as the analysis, to a few roundings of the whole way; the difference of two late samples
    has no more digits either, while that of positions and images has those of the step.
    """
    disk = {"position": [0.4, 0.1], "velocity": [911.3, -2777.7], "radius": 0.1, "mass": 1.0}
    box = {"x": (0, 0.9), "y": (0, 0.7), "boundary": "periodic"}
    scene = bp.Scene(box=box, disks=[disk], duration=1000.0, sample_interval=0.0055)
    run = bp.simulate(scene, quiet=True).isel(seed=0)
    run = run.isel(time=[0, *range(-20_000, 0)])  # the start, and the samples farthest from it
    late = {"time": slice(1, None)}
    rational = np.vectorize(Fraction, otypes=[object])
    crossed = run.image.values.astype(object)
    unwrapped = rational(run.position.values) + crossed * rational(run.box_size.values)
    whole = run.position.copy(data=unwrapped)
    from_start = whole - whole.isel(time=0)
    position = run.position.values[:, None]
    image = run.image.values[:, None]
    analysed = displacement(position, image, tuple(run.box_size.values))[:, 0]
    moved = run.unwrapped - run.unwrapped.isel(time=0)
    step = whole.isel(late).diff("time").astype(float)
    far = run.isel(late)
    by_parts = far.position.diff("time") + far.image.diff("time") * run.box_size

    def error(found, expected):
        return float(abs(found - expected.astype(float)).max())

    of_way = np.spacing(float(abs(moved).max())) / 2  # one rounding: 2.3e-10
    of_step = np.spacing(float(abs(step).max())) / 2  # 0.9e-15
    assert error(analysed, from_start) <= 2 * of_way  # product, sum
    assert error(moved, from_start) <= 4 * of_way  # product, sum, difference, the expected one
    assert of_way / 4 < error(far.unwrapped.diff("time"), step) <= 4 * of_way
    assert error(by_parts, step) <= 4 * of_step
    assert "inside the box" in run.position.long_name
    assert "unwrapped" in run.position.long_name


@pytest.mark.parametrize("boundary", ["periodic", "reflecting"])
def test_the_mean_of_an_own_array_is_that_of_the_analysis(boundary):
    scene = bp.Scene(**KEYS | {"box": KEYS["box"] | {"boundary": boundary}, "particles": 20})
    runs = bp.simulate(scene, range(1015, 1035), quiet=True)
    square = (
        ((runs.unwrapped - runs.unwrapped.isel(time=0)) ** 2)
        .sum("component")
        .assign_attrs(units="length^2")
    )
    found = bp.mean(square)
    expected = bp.analyse(runs).squeeze()
    ends = {"value": "", "standard_error": "_standard_error", "low": "_low", "high": "_high"}
    for name, end in ends.items():
        np.testing.assert_allclose(found[name], expected[f"msd{end}"], rtol=1e-12, atol=1e-15)
        assert found[name].units == "length^2"
    assert list(found.coords) == ["time"]
    at_1 = bp.mean(square.sel(time=1)).value
    np.testing.assert_allclose(at_1, found.value.sel(time=1), rtol=1e-14)  # round-off
    failed = square.assign_coords(failed=("seed", np.arange(20) == 3))
    without = square.isel(seed=np.arange(20) != 3)
    assert bp.mean(failed[::-1, ::-1]).identical(bp.mean(without[::-1]))


def test_times_are_selected_as_one_writes_them(tmp_path):
    """In runs, in an analysis by its windows, and in tables that other programs read."""
    species = [{"name": "bath", "count": 30, "radius": 0.2, "mass": 1.0}]
    scene = bp.Scene(
        box={"x": (0, 6), "y": (0, 5)},
        disks={"species": species},
        velocities={"temperature": 1.0},
        duration=7.0,
        sample_interval=0.07,
    )
    runs = bp.simulate(scene, 2, record="all", quiet=True)
    assert runs.position.sel(time=0.21).dims == ("seed", "component")
    result = bp.analyse(runs, fit_windows=[(1.05, 7), (4.2, 7)], quiet=True)
    assert result.window_start.values.tolist() == [1.05, 4.2]
    assert result.msd.sel(time=result.window_start).sizes["window"] == 2
    file = tmp_path / "runs.h5"
    bp.save(runs, file)
    for kind in ("csv", "xyz"):
        target = str(file.with_suffix(f".{kind}"))
        assert main(["export", str(file), "--to", kind, "--output", target]) == 0
    table = pandas.read_csv(tmp_path / "runs.csv")
    assert len(table[table.time == 0.49]) == 2 * 30
    assert "Time=0.49\n" in (tmp_path / "runs.xyz").read_text()


@pytest.mark.parametrize("until", [slice(13, 14), slice(13, None)], ids=["once", "to the end"])
@pytest.mark.parametrize("name", ["position", "velocity", "image", "square_displacement"])
def test_a_run_with_a_gap_is_named(name, until, tmp_path):
    """Edited by the user: no engine leaves a number out in a run that did not fail."""
    scene = bp.read_scene(SCENE, 20).replace(**{"box.boundary": "periodic"})
    asked = {"record": "velocity", "observables": ["square_displacement"], "quiet": True}
    runs = bp.simulate(scene, range(4, 12), **asked)
    edited = runs.copy(deep=True)
    edited[name] = edited[name].astype(float)
    edited[name].loc[{"seed": 9, "time": edited.time[until]}] = np.nan
    gap = f"seed 9: {name} is not a number at t = 0.13, though the run did not fail; take the run"
    places = {r"^runs\[0\]": edited, "edited.h5": tmp_path / "edited.h5"}
    bp.save(edited, tmp_path / "edited.h5")
    for where, source in places.items():
        with pytest.raises(AnalysisError, match=f"{where}: {gap}"):
            bp.analyse(source, quiet=True)
    others = [*range(4, 9), 10, 11]
    found = bp.analyse(edited.sel(seed=others), quiet=True)
    assert found.equals(bp.analyse(runs.sel(seed=others), quiet=True))
    failed = edited.copy(deep=True)
    failed.failed.loc[{"seed": 9}] = 1
    assert bp.analyse(failed, quiet=True).msd.notnull().all()


def test_a_run_without_a_number_leaves_no_mean_by_either_route(colliding):
    """First passages, of which one did not happen in time, and a curve with one point missing."""

    def passages(scene, run):
        number = next(numbers)
        curve = [run.tracer.position[-1, 0, 0], number, 2.0 * number]
        return {"passage": number, "curve": ("x", curve)}

    numbers = iter([2.5, 3.5, np.nan, 5.5, *np.arange(8.0)])
    runs = bp.simulate(colliding[0], 12, observables=[passages], quiet=True)
    result = bp.analyse(runs, quiet=True).squeeze()
    for name in ("passage", "curve"):
        mean = bp.mean(runs[name])
        for part, end in (("value", ""), ("standard_error", "_standard_error"), ("low", "_low")):
            np.testing.assert_array_equal(mean[part], result[f"{name}{end}"])
    assert np.isnan(bp.mean(runs.passage).value)
    assert np.isnan(bp.mean(runs.curve).value).values.tolist() == [False, True, True]
    assert bp.mean(runs.passage.dropna("seed")).value == pytest.approx(39.5 / 11)


def test_a_table_has_a_row_for_each_case_in_the_order_given(runs):
    result = bp.analyse([runs, bp.simulate(SCENE, 10, particles=10, quiet=True)])
    table = bp.table(result)
    assert table.particles.tolist() == result.particles.values.tolist() == [20, 10]
    assert table.attrs["diffusion_coefficient"] == "length^2/time"
    np.testing.assert_array_equal(
        table.diffusion_coefficient, result.diffusion_coefficient[..., 0].values.ravel()
    )
    np.testing.assert_array_equal(
        table.msd_standard_error, result.msd_standard_error.isel(time=-1).values.ravel()
    )
    axes = [bp.plot(result, particles=count, ax=Figure().subplots()) for count in (20, 10)]
    drawn = [axis.lines[0].get_ydata()[-1] for axis in axes]
    np.testing.assert_array_equal(drawn, result.msd.isel(time=-1).values.ravel())
    assert (
        not table.drifts.any()
        and (table.not_diffusive_before == result.not_diffusive_before.values.ravel()).all()
    )
    marks = result.diffusion_mark[..., 0].values.ravel()
    assert table.mark.tolist() == [diffusive.mark_in_words(mark) for mark in marks]
    assert [*result.data_vars][:3] == ["msd", "diffusion_coefficient", "compressibility"]
    assert [*result.data_vars][-1] == "run_status"


@pytest.mark.slow
def test_runs_on_several_cores_are_the_same(runs):
    """Processes of the caller's own go on."""
    own = multiprocessing.get_context("fork").Process(target=time.sleep, args=(60,))
    own.start()
    asked = {"record": ["all", "events"], "observables": ["square_displacement"]}
    assert bp.simulate(SCENE, 10, particles=20, cores=2, quiet=True, **asked).identical(runs)
    assert own.is_alive()
    own.kill()


@pytest.mark.slow
def test_a_study_is_run_and_its_runs_are_not_made_again(tmp_path, monkeypatch):
    """By the same digest of what determines runs; nothing is written to the store. `brownpipe run`:
    test_wheel.py.
    """
    monkeypatch.chdir(tmp_path)

    def forked_run(words):
        assert words[1:-2] == ["-P", "-m", "brownpipe", "run", "study.yaml", "-j", "1"]
        words = [
            "--snakefile",
            ROOT / "Snakefile",
            "--configfile",
            "study.yaml",
            "--cores",
            "1",
            *words[-2:],
        ]
        path = f"{forked.programs()}:{os.environ['PATH']}"
        return forked.snakemake(*words, cwd=tmp_path, env=environment(PATH=path))

    monkeypatch.setattr(progress, "relayed", forked_run)
    thermal = Path(SCENE).with_name("harrison2020_thermal.yaml").read_text()
    settled = f"{thermal}equilibrate: {{time: 0.1, tracer: free}}\n"
    Path("settled.yaml").write_text(settled)
    asked = {"particles": 20, "observables": "square_displacement", "average": "origins"}
    study = {"scenes": "settled.yaml", "seeds": 60, "fit_windows": [[0.1, 1]], "figures": "health"}
    Path("study.yaml").write_text(yaml.safe_dump(study | asked))
    result = bp.run("study.yaml", cores=1, config={"seeds": 6})
    stored = sorted(Path("results/runs").rglob("*.h5"))
    made = []
    simulate = Engine.simulate

    def counted(self, scene, seeds, *rest, **options):
        made.extend(seeds)
        return simulate(self, scene, seeds, *rest, **options)

    monkeypatch.setattr(Engine, "simulate", counted)
    runs = bp.simulate("settled.yaml", "2-8", quiet=True, **asked)
    again = bp.analyse(runs.sel(seed=range(2, 6)), fit_windows=[(0.1, 1)])
    assert (made, runs.seed.values.tolist()) == ([6, 7, 8], [*range(2, 9)])
    assert np.array_equal(again.run_msd, result.run_msd.sel(seed=range(2, 6)))
    steps = (runs.position.diff("time") ** 2).sum("component").mean("time")  # over time origins
    np.testing.assert_allclose(runs.square_displacement.isel(time=1), steps)
    for other in ({"record": "all"}, {"average": "runs"}, {"observables": "quartic_displacement"}):
        bp.simulate("settled.yaml", 1, quiet=True, **asked | other)
    assert made[3:] == [0, 0, 0], "other runs"
    assert sorted(Path("results/runs").rglob("*.h5")) == stored
    contents = bytearray(stored[0].read_bytes())
    contents[len(contents) // 2] ^= 1
    stored[0].write_bytes(contents)
    with pytest.raises(StorageError, match=r"0-5.h5: is damaged"):
        bp.simulate("settled.yaml", 3, quiet=True, **asked)


def test_a_job_that_fails_is_an_error_with_its_message(tmp_path, monkeypatch):
    """The processes themselves: tests/test_failures.py."""
    monkeypatch.chdir(tmp_path)
    Path("study.yaml").write_text(f"scenes: {SCENE}\nseeds: 6\n")
    cases = (
        ("0-5.h5: was\ndamaged\n", "0-5.h5: was damaged"),
        ("", "study.yaml: ended with exit status 1; "),
    )
    for reason, message in cases:
        monkeypatch.setattr(progress, "relayed", lambda _, reason=reason: (1, reason))
        with pytest.raises(RunError, match=f"^{re.escape(message)}"):
            bp.run("study.yaml")


@pytest.mark.parametrize(
    "seeds", ["0-2", [2, 0, 1], range(3), range(2, -1, -1), np.arange(3), np.int64(3), {0, 1, 2}]
)
def test_seeds_in_every_form(seeds):
    assert list(bp.simulate(SCENE, seeds, particles=20, quiet=True).seed.values) == [0, 1, 2]


def test_a_scene_from_numbers_is_that_of_the_file():
    scene = bp.Scene(**KEYS, name="harrison2020")
    assert scene == bp.read_scene(SCENE)
    before = {"equilibrate": {"time": 0.5, "tracer": "free"}}
    others = KEYS | before | {"sample_interval": None, "samples": {"per_decade": 3}}
    assert bp.Scene(**others, name="a") == parse_scene(others, "a.yaml")
    low, high = KEYS["box"]["x"]
    sides = {"x": np.array([low, high]), "y": (np.float64(low), np.int32(high))}
    of_numpy = {"box": KEYS["box"] | sides, "duration": np.float64(KEYS["duration"])}
    assert bp.Scene(**KEYS | of_numpy).digest == scene.digest
    assert len(repr(scene)) < 120
    assert repr(scene).startswith(
        "<Scene harrison2020: 150 disks in a reflecting box 6 x 6, packing fraction 0.1"
    )


LISTED = {
    "box": {"x": (-1e-3, 20.1), "y": (0, 1 / 3e-2)},
    "disks": [
        {"position": (1.1, 2.0), "velocity": (-1e-7, 0.1 + 0.2), "radius": 0.3, "mass": 1e300},
        {"position": (7.7, 2.0), "velocity": (0, 5), "radius": 0.1, "mass": 1e300},
    ],
    "duration": np.float64(3.3),
}
NAMES = ["bath", "089", "1e3", "no", "null", "0x1f", "1_0", "12.30", "6e-1", "y"]


@pytest.mark.parametrize(
    "scene",
    [
        lambda: bp.Scene(**KEYS, name="mine"),
        lambda: bp.Scene(**LISTED, name="mine"),
        lambda: bp.Scene(**KEYS, name="a").replace(
            "mine", sample_interval=None, samples={"per_decade": 3}, equilibrate=1e-9
        ),
        lambda: bp.Scene(**KEYS, name="a").replace(
            "mine",
            particles=20,
            **{
                "disks.species": [
                    {"name": name, "count": 2, "radius": 0.01 * 3, "mass": 1e22}
                    for name in NAMES[:-1]
                ]
                + [{"name": NAMES[-1], "count": "rest", "radius": 0.1, "mass": 3}]
            },
        ),
    ],
    ids=["species", "listed", "logarithmic", "names"],
)
def test_a_scene_is_saved_as_the_file_that_it_is_read_from(scene, tmp_path):
    saved = scene()
    path = tmp_path / "mine.yaml"
    saved.save(path)
    assert bp.read_scene(path) == saved
    assert bp.read_scene(str(path)).replace(duration=1.0) == saved.replace(duration=1.0)
    saved.save(str(path))  # once more, as a notebook does
    assert main(["check", str(path)]) == 0
    other = saved.replace(duration=2.0)
    before = path.read_bytes()
    with pytest.raises(RequestError, match=r"mine.yaml: exists; delete it, or choose another name"):
        other.save(path)
    with pytest.raises(RequestError, match=r"cannot be written: No such file"):
        other.save(tmp_path / "absent" / "mine.yml")
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["mine.yaml"]


def test_options_of_a_scan_have_the_defaults_of_simulate():
    simulated = signature(bp.simulate).parameters
    requested = signature(interface._request).parameters
    for name in requested.keys() - {"scene", "seeds", "settings"}:
        assert requested[name].default == simulated[name].default


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: bp.Scene(**KEYS, name="a b"), "Scene: name: must be a name"),
        (lambda: bp.simulate(SCENE, -3), "seeds: must be a count like 2400, or seeds"),
        (
            lambda: bp.simulate(SCENE, range(10**9)),
            "seeds: must be at most 10000000 seeds, not 1000000000: '0-999999999'",
        ),
        (lambda: bp.read_scene(None), "path: must be the path of a file, not None"),
        (lambda: bp.simulate(SCENE, recrod="all"), "recrod: unknown; did you mean record?"),
        (
            lambda: bp.simulate(SCENE, engine="timestep", dt=1),
            "dt: unknown; did you mean time_step?",
        ),
        (lambda: bp.scan(SCENE, {"duration": [1, 2]}, settings=2), "settings: unknown; see help"),
        (lambda: bp.simulate(SCENE, cores=0), "cores: must be greater than or equal to 1, not 0"),
        (lambda: bp.mean(np.zeros(3)), "array: must be an array with the dimension seed"),
        (
            lambda: bp.mean(xarray.DataArray([1.0, 2.0], {"seed": [4, 4]})),
            "array: must have every seed once",
        ),
        (lambda: bp.simulate(KEYS), "scene: must be the path of a file, not {"),
        (
            lambda: bp.simulate(SCENE, record=[]),
            "record: must be none, or one or several of tracer, all, events, velocity, with "
            "commas, not ''",
        ),
        (
            lambda: bp.simulate(SCENE, record=None),
            "record: must be a name or a list of names, not None",
        ),
        (
            lambda: bp.simulate(SCENE, engine="timestep"),
            "time_step: missing; must be given with engine timestep",
        ),
        (
            lambda: bp.simulate(SCENE, engine="timestep", time_step=math.nan),
            "time_step: must be a finite number",
        ),
        (
            lambda: bp.simulate(bp.read_scene(SCENE), particles=3),
            "particles: must not be given with a scene",
        ),
        (lambda: bp.analyse(bp.read_scene(SCENE)), "runs: must be what simulate or open returns"),
        (
            lambda: bp.analyse("a.h5", fit_windows=[(1, 0.5)]),
            r"fit_windows\[0\]: must be \[t0, t1\] with t0 < t1",
        ),
        (
            lambda: bp.scan(SCENE, {"duration": [1]}, fit_windows=[(1, 0.5)], observables="no"),
            "fit_windows",
        ),
        (lambda: bp.analyse("a.h5", fit_windows=(0.1, 1)), r"fit_windows\[0\]: must be a list"),
        (
            lambda: bp.run("study.yaml", config=["seeds=3"]),
            r"config: must be .*, not \['seeds=3'\]",
        ),
        (
            lambda: bp.save(xarray.Dataset({"failed_runs": 0}, attrs={"a": None}), "a.nc"),
            "data: .* attr 'a': None",
        ),
        (
            lambda: bp.save(xarray.Dataset({"failed_runs": 0, "a/b": 1}), "a.nc"),
            "data: cannot be written: .*slash",
        ),
        (
            lambda: bp.simulate(SCENE, observables=[partial(max, 0)]),
            "functools.partial.*: must be a function",
        ),
        (lambda: bp.analyse("a.h5", rings={"dr": 0.1}), "rings.count: missing"),
        (
            lambda: bp.run("a.yaml", config={"seeds": "17"}),
            "config: seeds: must not have a text for a number, .* '17'",
        ),
        (lambda: bp.plot(xarray.Dataset()), "result: must be a dataset of brownpipe.analyse"),
        (lambda: bp.save("runs", "a.h5"), "data: must be"),
        (
            lambda: bp.save(bp.read_scene(SCENE), "x.yaml"),
            r"data: is a scene; scene.save\('x.yaml'\) writes it",
        ),
        (lambda: bp.read_scene(SCENE).save("x.h5"), "path: x.h5: must end in .yaml or .yml"),
        (lambda: bp.read_scene(SCENE).save("a b.yaml"), "path: must be a name"),
        (lambda: bp.read_scene(SCENE).save(3), "path: must be the path of a file"),
        (
            lambda: setattr(bp.read_scene(SCENE), "duration", 5),
            r"duration: cannot be changed; scene.replace\(duration=5\) returns another scene",
        ),
        (
            lambda: setattr(bp.read_scene(SCENE).disks.tracer, "mass", 2.0),
            r'mass: cannot be changed; scene.replace .* {"disks.tracer.mass": 3.0}, returns',
        ),
        (lambda: setattr(bp.read_scene(SCENE), "duratoin", 5), "duratoin: cannot be changed"),
        (lambda: bp.save(xarray.DataTree(), "a.nc"), "path: a.nc: must end in .h5 or .hdf5"),
        (
            lambda: bp.save(xarray.Dataset({"failed_runs": 0}), "a.h5"),
            "path: a.h5: must end in .nc",
        ),
    ],
)
def test_an_error_names_the_argument(call, message):
    with pytest.raises(BrownpipeError, match=message) as caught:
        call()
    assert isinstance(caught.value, ValueError | StorageError)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_analyses_that_xarray_joins_are_refused_if_their_windows_differ(runs, result, tmp_path):
    """Marks are bits, and NaN fills the gaps: table and summary ended with a traceback."""
    other = bp.analyse(runs, fit_windows=[(0.2, 1.0)]).assign_coords(scene=["other"])
    joined = xarray.concat(
        [result, other], "scene", join="outer", coords="different", compat="equals"
    )
    reason = (
        r": joins analyses of different fit windows or variables; .* analyse\(\[runs, others\]\)"
    )
    with pytest.raises(RequestError, match=f"result{reason}"):
        bp.table(joined)
    with pytest.raises(FigureError, match=f"result{reason}"):
        bp.plot(joined)
    with pytest.raises(RequestError, match=f"data{reason}"):
        bp.save(joined, tmp_path / "joined.nc")
    same = result.assign_coords(scene=["other"])
    table = bp.table(xarray.concat([result, same], "scene", coords="different", compat="equals"))
    assert [*table.scene] == ["harrison2020", "other"] and table["mark"].nunique() == 1


@pytest.mark.slow
def test_the_layout_of_a_figure_follows_its_size_after_it_was_shown(result):
    """The labels beside a panel need a larger share of a narrower figure."""
    figure = bp.plot(result)
    axes = figure.axes[0]
    figure._repr_png_()
    share = axes.get_position().x0
    figure.set_size_inches(3.4, 6.0)
    figure.draw_without_rendering()
    assert axes.get_position().x0 > 1.2 * share


@pytest.mark.slow
def test_a_figure_is_that_of_the_command_line(runs, result, tmp_path):
    render(result, tmp_path, ["msd"])
    shown = bp.plot(result)._repr_png_()
    with Image.open(io.BytesIO(shown)) as one, Image.open(tmp_path / "msd.png") as other:
        assert one.tobytes() == other.tobytes(), "in notebooks"
    with pytest.raises(RequestError, match=r"figure: must be .*, not 'mds'"):
        bp.plot(result, "mds")
    _, axes = plt.subplots(1, 2)
    with pytest.raises(FigureError, match="panel: must not be given with ax"):
        bp.plot(result, panel="scene", ax=axes[0])
    with pytest.raises(FigureError, match="ax: must be the axes of one panel, not ndarray"):
        bp.plot(result, ax=axes)
    plt.close()
    with pytest.raises(
        AnalysisError, match=r"fit window \[0.1, 0.115\]: must .* have three samples"
    ):
        bp.analyse(runs, fit_windows=[(0.1, 0.115)])
    with pytest.raises(FigureError, match="velocity_autocorrelation: cannot be drawn"):
        bp.plot(result, "velocity_autocorrelation")
    with pytest.raises(
        FigureError, match="result: has no dimension scene, or nothing along it; take"
    ):
        bp.plot(result.squeeze())
    with pytest.raises(FigureError, match="result: has no dimension scene"):
        bp.plot(result.isel(scene=[]))
    for name, figure in (("msd", "msd"), ("runs", "msd"), ("energy_drift", "health")):
        with pytest.raises(FigureError, match=f"result: lacks {name}; plot what analyse returns"):
            bp.plot(result.drop_vars(name), figure)
    with pytest.raises(FigureError, match="particles: 7 is not in the dataset"):
        bp.plot(result, particles=7)


def test_importing_it_takes_no_time_and_lists_its_names():
    code = "import brownpipe, sys; print(*dir(brownpipe)); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    names, modules = done.stdout.splitlines()
    assert {name for name in names.split() if not name.startswith("_")} == set(bp.__all__)
    assert not {"numpy", "numba", "xarray", "h5py", "matplotlib"} & set(modules.split())
    assert bp.__version__ == version("brownpipe")
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = bp.simulat
