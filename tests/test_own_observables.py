"""Observables of a user's own: measured, stored, averaged; the mistakes that users make."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import brownpipe as bp
from brownpipe import cli
from brownpipe.analysis import dataset
from brownpipe.engines import Engine
from brownpipe.errors import DONE, WRONG_REQUEST, RequestError
from brownpipe.figures import own_observables
from brownpipe.figures.cases import cases_of
from brownpipe.figures.summary import summary
from brownpipe.observables.reserved_names import RESERVED_NAMES
from brownpipe.storage import layout
from brownpipe.study import read_study, trial
from brownpipe.study.run_sets import commands, files_of, run_sets
from ensembles import make_scene
from pipeline import FEW_DISKS

GUIDE = Path(__file__).parents[1] / "docs" / "guide.md"
_, _, SECTION = GUIDE.read_text().partition("An observable of your own")
EXAMPLE = re.search(r"```python\n(.*?)```", SECTION, re.DOTALL)[1]
STUDY = (
    "scenes: few.yaml\nseeds: 12\nbatch: 6\nobservables: [square_displacement, "
    "my_module:my_function]\n"
)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with the scene of the guide's example, its module and study in a folder below."""
    monkeypatch.chdir(tmp_path)
    Path("sub").mkdir()
    for name, text in (("few.yaml", FEW_DISKS), ("my_module.py", EXAMPLE), ("study.yaml", STUDY)):
        Path("sub", name).write_text(text)
    return tmp_path


def make_files(study):
    """Make the runs of a study by its own commands; the file of each batch."""
    paths = [file.path for file in files_of(study)]
    for path in paths:
        key = path.parent.name[-8:]
        words = commands(study)[key].split()
        path.parent.mkdir(parents=True, exist_ok=True)
        batch = ["--seeds", path.stem, "--output", str(path)]
        assert cli.main(["simulate", *words, *batch]) == DONE
    return paths


def test_the_example_of_the_guide_is_measured_and_averaged_without_reading_its_module_again(
    here,
):
    files = make_files(read_study("sub/study.yaml"))
    Path("sub/my_module.py").write_text("raise SystemExit('read')")
    whole = bp.simulate("sub/few.yaml", "0-11", record="all").disks
    left = (whole.position.sel(component="x") < 0.0).sum("disk")  # (time, seed), the box is [-3, 3]
    for file in files:
        with xr.open_datatree(file) as tree:
            assert tree.left_disks.dims == ("seed", "time")
            assert "time" in tree.left_disks.coords
            assert tree.left_disks.attrs == {
                "units": "1",
                "long_name": "disks in the left half",
                "observable": "my_module:my_function",
            }
            assert tree.turned.dims == ("seed",)
            names = "square_displacement,my_module:my_function"
            assert f"--observables {names}" in tree.attrs["command"]
    result = bp.analyse(files)
    np.testing.assert_allclose(result.left_disks.squeeze(), left.mean("seed"), rtol=1e-14)
    error = left.std("seed", ddof=1) / np.sqrt(12)
    np.testing.assert_allclose(result.left_disks_standard_error.squeeze(), error, rtol=1e-12)
    assert result.left_disks.attrs["observable"] == "my_module:my_function"
    assert (result.left_disks_low <= result.left_disks).all()
    assert result.turned_low.notnull().all()
    bp.save(bp.open(files[0]), "again.h5")
    xr.testing.assert_equal(bp.open("again.h5").left_disks, bp.open(files[0]).left_disks)
    without_number = result.assign(left_disks=np.nan * result.left_disks)
    cases = [*cases_of(result), *cases_of(without_number)]
    columns = {*own_observables.table_of_own_observables(cases).columns}
    assert columns >= {"time", "left_disks", "left_disks_low", "turned", "turned_standard_error"}
    assert bp.plot(result, "own_observables").axes


PATHS = """
import numpy as np

def free_path(scene, run):
    "Mean length of the tracer's straight pieces, and its collisions."
    path = run.path(scene)
    lengths = np.hypot(*np.diff(path.position, axis=0).T)
    assert not run.events.time.flags.writeable
    return {"free_path": lengths.mean(), "events_of_tracer": len(path.time) - 2.0}
"""
OF_PATHS = "scenes: few.yaml\nseeds: 4\nobservables: my_paths:free_path\n"


def test_functions_have_exact_paths_where_collisions_are_recorded(here, capsys):
    Path("sub/my_paths.py").write_text(PATHS)
    Path("sub/without.yaml").write_text(OF_PATHS)
    assert cli.main(["check", "sub/without.yaml"]) == WRONG_REQUEST
    message = "my_paths:free_path: ValueError: run: has no collisions, which record: events keeps"
    assert message in capsys.readouterr().err
    Path("sub/study.yaml").write_text(OF_PATHS + "record: [velocity, events]\n")
    assert cli.main(["check", "sub/study.yaml"]) == DONE
    (file,) = make_files(read_study("sub/study.yaml"))
    runs = bp.open(file)
    for seed in runs.seed.values.tolist():
        path = bp.path(runs, seed)
        lengths = np.hypot(*np.diff(path.position, axis=0).T)
        assert runs.free_path.sel(seed=seed) == lengths.mean()
        assert runs.events_of_tracer.sel(seed=seed) == path.sizes["event"] - 2
    assert bp.analyse(file).free_path.item() == pytest.approx(runs.free_path.mean().item())


@pytest.mark.parametrize("disk", [-1, 20])
def test_a_disk_that_is_none_has_no_path(disk):
    def last(scene, run):
        return {"last": run.path(scene, disk).position[-1, 0]}

    message = f"ValueError: disk: must be from 0 to 19, not {disk}"
    with pytest.raises(RequestError, match=message):
        bp.simulate(make_scene(), record="all,events", observables=[last], quiet=True)


def test_an_edited_function_makes_other_runs_wherever_the_study_is_called_and_must_be_there(
    here, monkeypatch
):
    Path("sub/wrong.yaml").write_text(STUDY.replace("my_function]", "my_funktion]"))
    refusal = r"sub/wrong.yaml: line 4: observables: .*my_module.py has no function my_f"
    with pytest.raises(RequestError, match=refusal):
        read_study("sub/wrong.yaml")
    (runs,) = run_sets(read_study("sub/study.yaml"))
    monkeypatch.chdir("sub")
    (same_runs,) = run_sets(read_study("study.yaml"))
    with open("my_module.py", "a") as file:
        file.write("# edited\n")
    (edited,) = run_sets(read_study("study.yaml"))
    assert runs.digest == same_runs.digest
    assert runs.digest != edited.digest
    words = commands(read_study("study.yaml"))[edited.key].split()
    assert cli.main(["simulate", *words, "--output", "x.h5"]) == DONE


def test_a_function_is_given_in_python_and_every_engine_of_all_disks_measures_it(here):
    def in_cells(scene, run):
        counts = [np.histogram(x, 4, (-3, 3))[0] for x in run.whole.position[:, :, 0]]
        return {"in_cells": (("time", "cell"), np.array(counts))}

    def simulate(seeds, **engine):
        return bp.simulate("sub/few.yaml", seeds, observables=[in_cells], **engine)

    result = bp.analyse([simulate(12), simulate(12, engine="timestep", time_step=1e-3)])
    assert result.in_cells.dims[-2:] == ("time", "cell")
    assert "cell" not in result.coords
    np.testing.assert_allclose(result.in_cells.sum("cell"), 12.0, rtol=1e-14)
    with (
        pytest.warns(match="does not measure .*in_cells$"),
        pytest.warns(match="langevin is rough here"),
    ):
        runs = simulate(3, engine="langevin", friction="enskog")
    assert "in_cells" not in runs


def test_a_checkpoint_keeps_what_is_said_of_the_arrays(here):
    from brownpipe.engines.ensemble import new_batch
    from brownpipe.engines.exact.simulation import pack, resume

    Path("heights.py").write_text(
        "def places(scene, run):\n    return {'mine': ('x', [1, 2]), 'x': ('x', [0.1, 0.7])}\n"
    )
    scene = bp.read_scene("sub/few.yaml")
    names = ("sub/my_module:my_function", "heights:places")
    ensemble = Engine("exact").simulate(scene, [0, 1], {"tracer"}, observables=names)
    batch = new_batch(scene, [0, 1, 2], {"tracer"}, names, "runs")
    assert resume(pack(ensemble, 2, None), batch)[0] == 2
    assert batch.ensemble.own == ensemble.own
    assert ensemble.own["x"].coordinates == (0.1, 0.7)


# -- coordinates of one's own ----------------------------------------------------------------------


def profile_of_heights(scene, run):
    """Disks between heights at the end, with the middle of each interval."""
    edges = np.linspace(*scene.box.y, 7)
    counts, _ = np.histogram(run.whole.position[-1, :, 1], edges)
    return {
        "disks_at_height": ("height", counts, {"units": "1", "long_name": "disks at a height"}),
        "height": ("height", (edges[1:] + edges[:-1]) / 2, {"units": "length"}),
    }


HEIGHTS = [-2.5, -1.5, -0.5, 0.5, 1.5, 2.5]  # the box is [-3, 3]


def runs_with_heights(**keys):
    scene = bp.read_scene("sub/few.yaml").replace(**keys)
    return bp.simulate(scene, 12, observables=[profile_of_heights])


def test_a_coordinate_of_ones_own_is_in_runs_files_and_datasets(here):
    runs = runs_with_heights()
    bp.save(runs, "runs.h5")
    for tree in (runs, bp.open("runs.h5"), xr.open_datatree("runs.h5")):
        assert tree.disks_at_height.dims == ("seed", "height")
        np.testing.assert_allclose(tree.height, HEIGHTS, rtol=1e-14)
        assert tree.height.dims == ("height",)
        assert tree.height.attrs == {"units": "length", "long_name": "height"}
    result = bp.analyse("runs.h5")
    assert "height" in result.coords
    assert result.height.attrs == {"units": "length", "long_name": "height"}
    mean = runs.disks_at_height.mean("seed")
    xr.testing.assert_allclose(result.disks_at_height.squeeze(drop=True), mean)
    assert cli.main(["inspect", "runs.h5"]) == DONE
    bp.save(bp.open("runs.h5"), "again.h5")
    xr.testing.assert_equal(bp.open("again.h5").height, runs.height)


def test_scenes_may_differ_in_the_values_of_a_coordinate(here):
    whole = runs_with_heights()
    half = runs_with_heights(**{"box.y": [-1.5, 1.5]}, name="half")
    result = bp.analyse([whole, half])
    shared = {*HEIGHTS, *(height / 2 for height in HEIGHTS)}
    np.testing.assert_allclose(result.height, sorted(shared), rtol=1e-14)
    for runs, scene in ((whole, "few"), (half, "half")):
        values = result.disks_at_height.sel(scene=scene).squeeze(drop=True).dropna("height")
        np.testing.assert_allclose(values.height, runs.height, rtol=1e-14)
        np.testing.assert_allclose(values, runs.disks_at_height.mean("seed"), rtol=1e-14)


def test_an_array_is_drawn_against_its_coordinate_with_its_band(here):
    result = bp.analyse(runs_with_heights())
    (axes,) = bp.plot(result, "own_observables").axes
    assert axes.get_xlabel() == "height [length]"
    assert axes.get_ylabel() == "disks at height"
    (line,) = axes.lines
    np.testing.assert_allclose(line.get_xdata(), HEIGHTS, rtol=1e-14)
    np.testing.assert_allclose(line.get_ydata(), result.disks_at_height.values.ravel())
    (band,) = axes.collections
    x, y = band.get_paths()[0].vertices.T
    assert (x.min(), x.max()) == pytest.approx((-2.5, 2.5))
    assert y.max() == pytest.approx(result.disks_at_height_high.max().item())
    table = own_observables.table_of_own_observables(cases_of(result))
    np.testing.assert_allclose(table.height, HEIGHTS, rtol=1e-14)


def test_a_second_dimension_with_coordinates_labels_the_curves(here):
    def counts(scene, run):
        return {
            "count": (("height", "moment"), np.ones((2, 2))),
            "height": ("height", [0.5, 1.5], {"units": "length", "long_name": "height y"}),
            "moment": ("moment", [0.0, 0.25], {"units": "time"}),
        }

    result = bp.analyse(bp.simulate("sub/few.yaml", 12, observables=[counts]))
    (axes,) = bp.plot(result, "own_observables").axes
    assert axes.get_xlabel() == "height y [length]"
    labels = [line.get_label() for line in axes.lines]
    assert labels == ["moment = 0", "moment = 0.25"]


def test_runs_of_a_case_have_one_coordinate(here):
    def mine(scene, run):
        return {"mine": ("place", [1.0, 2.0]), "place": ("place", [0.0, next(ends)])}

    ends = iter([1.0] * 3 + [2.0] * 3)
    runs = [bp.simulate("sub/few.yaml", seeds, observables=[mine]) for seeds in ("0-2", "3-5")]
    with pytest.raises(ValueError, match="place: must be alike in all runs of a case"):
        bp.analyse(runs)
    for selection in ({"place": [0]}, {"place": slice(None, None, -1)}):
        with pytest.raises(ValueError, match="of place it must hold all 2 in order"):
            bp.analyse(runs[0].isel(selection))


def test_functions_may_share_a_coordinate(here):
    def first(scene, run):
        return {"first": ("place", [1.0, 2.0]), "place": ("place", [0.0, 1.0])}

    def second(scene, run):
        return {"second": ("place", [3.0, 4.0]), "place": ("place", [0.0, 1.0])}

    def third(scene, run):
        return {"third": ("place", [3.0, 4.0, 5.0])}

    runs = bp.simulate("sub/few.yaml", 3, observables=[first, second])
    assert runs.second.dims == runs.first.dims == ("seed", "place")
    wrong = r"third: must have \(2,\) values along \('place',\), not \(3,\)"
    with pytest.raises(RequestError, match=wrong):
        bp.simulate("sub/few.yaml", 3, observables=[first, third])


# -- mistakes --------------------------------------------------------------------------------------

FUNCTION = "def f(scene, run):\n    return "


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, r"my:f cannot be used: FileNotFoundError: .*my.py"),
        ("def f(scene, run)", r"SyntaxError: .*\(my.py, line 1\)"),
        ("import nothing_such", r"ModuleNotFoundError: .*\(my.py, line 1\)"),
        ("def g(scene, run): return {}", r"my.py has no function f"),
        (
            "def f(scene): return {}",
            r"seed 0: my:f: TypeError: f\(\) takes 1 positional argument but 2 were given",
        ),
        (
            FUNCTION + "{'mine': 1 / 0}",
            r"seed 0: my:f: ZeroDivisionError: division by zero \(my.py, line 2\)",
        ),
        (FUNCTION + "3", r"my:f: TypeError: must return a mapping of names to arrays, not 3"),
        (
            FUNCTION + "{'mine': 'text'}",
            r"my:f: ValueError: mine: must be numbers: could not convert string to float: 'text'",
        ),
        (
            FUNCTION + "{'a b': 1}",
            r"my:f: ValueError: a b: names of arrays and dimensions must be words",
        ),
        (
            FUNCTION + "{'mine': ('time', [1, 2])}",
            r"my:f: ValueError: mine: must have \(11,\) values along",
        ),
        (
            FUNCTION + "{'mine': (('x', 'y'), [1, 2])}",
            r"my:f: ValueError: mine: must be \(dims, values\) with a dim",
        ),
        (
            FUNCTION + "{'pair_collisions': 1}",
            r"my:f: ValueError: pair_collisions: pair_collisions is a name in runs",
        ),
        (
            "n = [1]\n" + FUNCTION + "{'msd': n.pop()}",
            r"my:f: ValueError: msd: msd is a name in runs or datasets",
        ),
        (
            FUNCTION + "{'mine': ('window', [1, 2])}",
            r"my:f: ValueError: mine: window is a name in runs or datasets",
        ),
        (
            FUNCTION + "{'mine': run.whole.position.fill(0)}",
            r"my:f: ValueError: .*read-only \(my.py, line 2\)",
        ),
        (
            "n = []\n" + FUNCTION + "{'mine': ('x', n.append(1) or n)}",
            r"seed 1: my:f: ValueError: mine: must be al",
        ),
        (
            "n = [2]\n"
            + FUNCTION
            + "{'x': ('x', [1, n.append(n[-1] + 1) or n[-1]]), 'mine': ('x', [1, 2])}",
            r"seed 1: my:f: ValueError: x: must be alike in all runs; its values have changed",
        ),
        (
            FUNCTION + "{'mine': ('x', [1, 2, 3]), 'x': ('x', [1, 2])}",
            r"my:f: ValueError: mine: must have \(2,\) values along \('x',\), not \(3,\)",
        ),
        *(
            (
                FUNCTION + f"{{'x': ('x', [1.0, {end}])}}",
                r"my:f: ValueError: x: must be finite and ascending, as the coordinate of x",
            )
            for end in ("1.0", "0.0", "float('nan')")
        ),
        (
            FUNCTION + "{'mine': ('x', []), 'x': ('x', [])}",
            r"my:f: ValueError: mine: must have values, and is of shape \(0,\)",
        ),
        (
            FUNCTION + "{'mine': 1.0, 'x': ('x', [1.0, 2.0])}",
            r"my:f: ValueError: x: is a coordinate, and no array is along it",
        ),
        (
            FUNCTION + "{'mine': ('x', ['a'])}",
            r"my:f: ValueError: mine: must be numbers: could not convert string to float: 'a'",
        ),
        (FUNCTION + "{}", r"my:f: ValueError: must return an array, not an empty mapping"),
        (
            FUNCTION + "{'x': (('x', 'y'), [[1, 2]])}",
            r"my:f: ValueError: x: must be \(dims, values\) with a dim",
        ),
    ],
)
def test_mistakes_are_one_line_and_nothing_is_written(here, capsys, text, message):
    if text is not None:
        Path("my.py").write_text(text)
    command = "simulate sub/few.yaml --seeds 0-2 --observables my:f --output x.h5"
    assert cli.main(command.split()) == WRONG_REQUEST
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert error.count("\n") == 1
    assert not Path("x.h5").exists()


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("{'density_profile': ('y', [1, 2])}", "density_profile is a name in runs or datasets"),
        ("{'mine': ('r', [1.0])}", "mine: r is a name in runs or datasets; choose another"),
        (
            "{'mine': run.whole.velocities[-1]}",
            r"AttributeError: .*velocities.*\(.*my.py, line 2\)",
        ),
        ("{'mine': run.tracer.position[len(scene.times), 0, 0]}", "IndexError: "),
    ],
)
def test_check_calls_a_function_once_and_refuses_its_mistakes_in_a_line(
    here, capsys, monkeypatch, body, message
):
    Path("sub/my.py").write_text(f"{FUNCTION}{body}")
    Path("sub/own.yaml").write_text("scenes: few.yaml\nseeds: 30-90\nobservables: my:f\n")
    for longest in (trial.LONGEST, 1e-5):
        monkeypatch.setattr(trial, "LONGEST", longest)
        assert cli.main(["check", "sub/own.yaml"]) == WRONG_REQUEST
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("\n") == 1
        assert re.search(message, printed.err)
        assert "seed 30: " in printed.err
    assert not Path("results").exists()


def test_check_calls_a_function_once_and_for_as_many_samples(here, capsys, monkeypatch):
    Path("sub/my.py").write_text(
        "from pathlib import Path\n\ndef f(scene, run):\n"
        "    number = len(list(Path().glob('call*')))\n"
        "    Path(f'call{number}').write_text(f'{len(scene.times)} {scene.duration}')\n"
        "    return {'mine': 1}\n"
    )
    Path("sub/own.yaml").write_text(
        "scenes: few.yaml\nparticles: [4, 9]\nseeds: 30\nobservables: my:f\n"
    )
    assert cli.main(["check", "sub/own.yaml"]) == DONE
    monkeypatch.setattr(trial, "LONGEST", 1e-5)
    assert cli.main(["check", "sub/own.yaml"]) == DONE
    samples, duration = Path("call0").read_text().split()
    samples_of_trial, duration_of_trial = Path("call1").read_text().split()
    assert not Path("call2").exists()
    assert samples_of_trial == samples
    assert float(duration_of_trial) < float(duration)


def test_names_of_runs_and_datasets_are_reserved():
    """The page of files, to which the guide refers, is made from these tables
    (docs/_ext/reference.py).
    """
    listed = {*dataset.ALL_VARIABLES, *dataset.ALL_COORDINATES, *layout.VARIABLES}
    assert listed - RESERVED_NAMES == set(), "enter them in observables/reserved_names.py"
    assert RESERVED_NAMES - listed == set(), "gone: take them out of observables/reserved_names.py"


def test_a_function_given_in_python_is_itself_alone_and_others_are_not_joined_with_it(here):
    def function_of(value):
        return lambda scene, run: {"mine": ("x", [value])}

    module = {"__name__": "obs"}
    exec(compile(FUNCTION + "{'mine': ('x', [1.0])}", "obs.py", "exec"), module)
    Path("obs.py").write_text(FUNCTION + "{'mine': ('x', [2.0])}")  # after it was imported
    cases = []
    for function in (module["f"], "obs:f", function_of(3.0), function_of(4.0)):
        particles = 12 + len(cases)
        runs = bp.simulate("sub/few.yaml", 3, particles=particles, observables=[function])
        cases.append(runs)
    assert [runs.mine.values[0, 0] for runs in cases] == [1.0, 2.0, 3.0, 4.0]
    refusal = r"mine: (was measured by another function .*:|is of .*, in other runs of )"
    for k in range(3):
        with pytest.raises(ValueError, match=refusal):
            bp.analyse(cases[k : k + 2])


def test_runs_of_a_case_whose_arrays_differ_in_shape_are_not_joined(here):
    def mine(scene, run):
        return {"mine": ("x", np.ones(next(sizes)))}

    sizes = iter([3, 3, 3, 1, 1, 1])
    runs = [bp.simulate("sub/few.yaml", seeds, observables=[mine]) for seeds in ("0-2", "3-5")]
    with pytest.raises(ValueError, match="mine: must have one shape in all runs"):
        bp.analyse(runs)


def test_a_name_like_that_of_a_quantity_which_may_drift_is_ones_own(here):
    def mine(scene, run):
        return {
            "quarter_mine": ("x", [1.0, 2.0, 3.0]),
            "kinetic_energy_of_mine": 1.0,
            "sometimes": next(numbers),
        }

    scene = bp.read_scene("sub/few.yaml").replace(equilibrate={"time": 1.0, "tracer": "free"})
    numbers = iter([0.0])
    with pytest.raises(RequestError, match="msd is a name in runs or datasets"):  # after one run
        bp.simulate(scene, 2, observables=[lambda *_: {"msd": next(numbers)}])
    numbers = iter([*range(7), np.nan])
    result = bp.analyse(bp.simulate(scene, 8, observables=[mine]))
    assert "\nsometimes: no mean where a run has no number of it.\n" in summary(result)
    assert result.quarter_mine.values.ravel().tolist() == [1.0, 2.0, 3.0]
