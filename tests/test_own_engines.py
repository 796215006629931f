"""Engines of a user's own: passed to Python, recorded in files, read without their module."""

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import brownpipe as bp
from brownpipe import cli
from brownpipe.engines.start.initial_state import draw_state
from brownpipe.errors import WRONG_REQUEST, AnalysisError, RequestError

GUIDE = Path(__file__).parents[1] / "docs" / "guide.md"
SECTION = GUIDE.read_text().partition("An engine of your own")[2]
EXAMPLE = re.search(r"```python\n(.*?)```", SECTION, re.DOTALL)[1]
BATH = {"name": "bath", "count": "rest", "radius": 0.1, "mass": 1.0}


def periodic_scene(samples=4):
    box = {"x": [-2.0, 3.0], "y": [0.0, 4.0], "boundary": "periodic"}
    disks = {"tracer": {"radius": 0.2, "mass": 5.0}, "species": [BATH]}
    return bp.Scene(
        box=box,
        disks=disks,
        duration=6.0,
        particles=12,
        velocities={"temperature": 1.0},
        sample_interval=6.0 / samples,
        name="free",
    )


def imported(folder, text):
    """The module of the guide's example, with this text, imported anew."""
    Path(folder, "my_engine.py").write_text(text)
    sys.modules.pop("my_engine", None)
    importlib.invalidate_caches()
    return importlib.import_module("my_engine")


@pytest.fixture
def free_flight(tmp_path, monkeypatch):
    """The engine of the guide's example, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # two texts may have one time of change
    yield imported(tmp_path, EXAMPLE).FREE_FLIGHT
    sys.modules.pop("my_engine", None)


def test_the_example_of_the_guide_flies_freely(free_flight):
    scene = periodic_scene()
    runs = bp.simulate(scene, 3, engine=free_flight, speed_up=2.0, record="all", quiet=True)
    for seed in range(3):
        state = draw_state(scene, seed)
        straight = state.position + 2 * state.velocity * scene.times[:, None, None]
        disks = runs.disks.sel(seed=seed)
        np.testing.assert_allclose(disks.unwrapped, straight, atol=1e-12)
    assert (runs.disks.position.sel(component="y") >= 0.0).all()
    assert runs.attrs["engine"] == "free_flight"


def test_runs_are_analysed_as_those_of_other_engines(free_flight):
    scene = periodic_scene()
    runs = bp.simulate(
        scene, 40, engine=free_flight, observables=["square_displacement"], cores=2, quiet=True
    )
    result = bp.analyse(runs, quiet=True)
    assert result.engine.values.tolist() == ["free_flight-speed_up=1.0"]
    displacement = runs.unwrapped - runs.unwrapped.isel(time=0)
    msd = (displacement**2).sum("component").mean("seed")
    np.testing.assert_allclose(result.msd.squeeze(), msd, rtol=1e-12)
    assert bp.plot(result, "msd").axes


def test_a_file_is_read_without_the_module_and_says_what_needs_it(free_flight, capsys, monkeypatch):
    runs = bp.simulate(periodic_scene(), 4, engine=free_flight, speed_up=3.0, quiet=True)
    bp.save(runs, "free.h5")
    monkeypatch.setattr("brownpipe.engines._own_definitions", {})
    Path("my_engine.py").unlink()
    again = bp.open("free.h5")
    xr.testing.assert_identical(again.to_dataset(), runs.to_dataset())
    bp.save(again, "copy.h5")
    expected = bp.analyse(runs, quiet=True)
    xr.testing.assert_equal(bp.analyse("copy.h5", quiet=True), expected)
    assert cli.main(["inspect", "free.h5"]) == 0
    assert "free_flight speed_up=3.0 [my_engine " in capsys.readouterr().out
    assert cli.main(["inspect", "free.h5", "--reproduce"]) == WRONG_REQUEST
    (line,) = capsys.readouterr().err.splitlines()
    assert "free_flight: is an engine of module my_engine, which this needs" in line


def test_runs_of_an_edited_module_are_not_averaged_with_those_before(free_flight, tmp_path):
    runs = bp.simulate(periodic_scene(), [0, 1], engine=free_flight, quiet=True)
    edited = imported(tmp_path, EXAMPLE + "# edited\n").FREE_FLIGHT
    others = bp.simulate(periodic_scene(), [2, 3], engine=edited, quiet=True)
    with pytest.raises(AnalysisError, match="has another source of the engine than"):
        bp.analyse([runs, others], quiet=True)


def test_wrong_settings_and_definitions_are_refused_in_one_line(free_flight):
    scene = periodic_scene()
    for settings, reason in (
        ({"speed_up": "fast"}, "speed_up: must be a valid number"),
        ({"speed": 2.0}, "speed: unknown"),
    ):
        with pytest.raises(RequestError, match=reason):
            bp.simulate(scene, engine=free_flight, quiet=True, **settings)
    for name in ("exact", "Free flight"):
        with pytest.raises(RequestError, match=f"^engine: {name!r}: must be a word"):
            bp.simulate(scene, engine=free_flight._replace(name=name), quiet=True)
    returns_none = free_flight._replace(simulation=lambda *_, **__: None)
    with pytest.raises(RequestError, match="free_flight: must return an Ensemble"):
        bp.simulate(scene, engine=returns_none, quiet=True)
