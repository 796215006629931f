"""What `inspect` says about a file, and runs that come out again from the file alone."""

import re
import shlex
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import xarray

import brownpipe as bp
from brownpipe import analysis, inspection
from brownpipe.cli import main
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, RunError
from brownpipe.figures.summary import summary
from brownpipe.inspection.reports import failed_runs
from brownpipe.provenance import ANALYSIS_PACKAGES, PACKAGES, versions
from brownpipe.storage import trajectories
from brownpipe.storage.configurations import read_scene
from brownpipe.storage.datasets import write_dataset
from brownpipe.storage.files import write_checkpoint
from brownpipe.storage.layout import described
from brownpipe.storage.trajectories import read_trajectories, write_trajectories
from ensembles import make_runs, make_scene, write

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("elsewhere")]

SCENE = Path(__file__).parent.parent / "config" / "scenes" / "harrison2020.yaml"
TEN = [SCENE, "--particles", "10", "--seeds", "3,5-6"]
PERIODIC = """\
box: {x: [-1.0, 4.0], y: [2.0, 6.0], boundary: periodic}
disks: {tracer: {radius: 0.3, mass: 20.0},
  species: [{name: bath, count: 12, radius: 0.2, mass: 0.5}]}
velocities: {temperature: 1.5}
equilibrate: {time: 1.0, tracer: free}
duration: 100.0
sample_interval: 5.0
"""
WHOLE_BOX = ["periodic.yaml", "--seeds", "0-2"]
MADE = {  # name: options of `simulate`
    "whole": [
        *TEN,
        "--record",
        "all,events",
        "--observables",
        "velocity_autocorrelation,pair_distribution",
    ],
    "nothing": [*TEN, "--record", "none"],
    "origins": [
        *WHOLE_BOX,
        "--record",
        "none",
        "--observables",
        "velocity_autocorrelation",
        "--average",
        "origins",
    ],
    "steps": [*TEN, "--engine", "timestep", "--time-step", "0.01"],
    "langevin": [*WHOLE_BOX, "--engine", "langevin", "--friction", "boltzmann"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A file of each entry of MADE; no scene file."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "periodic.yaml").write_text(PERIODIC)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name, options in MADE.items():
            assert main(["simulate", *map(str, options), "--output", f"{name}.h5"]) == DONE
    (folder / "periodic.yaml").unlink()
    return folder


# -- trajectory files ------------------------------------------------------------------------------


def test_the_worst_and_the_failed_runs_are_named(tmp_path):
    runs = make_runs(make_scene(), [0, 1, 2, 7], failed=(1, 7))
    runs.ensemble.observables.update(
        energy_drift=np.array([1e-16, -3e-15, 0.0, 2e-15]),
        worst_overlap=np.zeros(4),
        momentum_residual=np.array([1e-16, 2e-16, 3e-16, np.nan]),
    )
    path = write(tmp_path, runs)
    counts = runs.ensemble.observables["pair_collisions"]
    health = (
        "failed their health check: 2 of 4 runs: 1,7; worst energy drift 3e-15 (seed 1); worst "
        "overlap 0"
    )
    assert (
        f"health       {health}; worst momentum residual nan (seed 7)\n"
        in inspection.file_report(path)
    )
    for seed, numbers in (
        (None, [of(counts[[0, 2]]) for of in (np.mean, np.min, np.max)]),
        (7, counts[3:]),
    ):
        (line,) = re.findall(
            "^pair_collisions (.*)", inspection.file_report(path, seed), re.MULTILINE
        )
        assert line.split()[: len(numbers)] == [f"{number:.6g}" for number in numbers]


def test_one_run_says_all_about_itself(folder):
    text = inspection.file_report(folder / "whole.h5", 5)
    ensemble = read_trajectories(folder / "whole.h5").ensemble
    start, end = ensemble.tracer.position[[0, -1], 1]
    assert f"squared displacement {np.sum((end - start) ** 2):.6g}\n" in text
    assert "recorded     all, events, tracer\n" in text
    assert "health       no failed runs; worst energy drift" in text
    for name in ensemble.observables.keys() - {"failed"}:
        values = ensemble.observables[name]
        units = described(name)["units"]
        (line,) = (line for line in text.splitlines() if line.startswith(f"{name} "))
        assert f" {units} " in line
        assert values.ndim > 1 or f" {values[1]:.6g} " in line
    assert re.search(r"^velocity_autocorrelation .*\(time 101\)$", text, re.MULTILINE)
    assert "recorded     none\n" in inspection.file_report(folder / "nothing.h5", 5)


def test_a_run_in_a_periodic_box_is_unwrapped(folder):
    scene, _, ensemble, *_ = read_trajectories(folder / "langevin.h5")
    track = ensemble.tracer
    unwrapped = track.position[:, 2] + track.image[:, 2] * [scene.box.width, scene.box.height]
    assert np.any(track.image[-1, 2])
    found = float(
        re.search(r"squared displacement (\S+)", inspection.file_report(folder / "langevin.h5", 2))[
            1
        ]
    )
    assert found == pytest.approx(np.sum((unwrapped[-1] - unwrapped[0]) ** 2), rel=1e-5)


# -- datasets --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """A dataset of two cases, one with a failed run and a missing one: its path, contents and
    report.
    """
    folder = tmp_path_factory.mktemp("dataset")
    runs = (
        make_runs(make_scene("few", 10), range(30), failed=(4,)),
        make_runs(make_scene("many", 20), range(31)),
    )
    contents = analysis.aggregate([write(folder, one) for one in runs], [(0.1, 1.0), (0.5, 1.0)])
    contents.energy_drift[:] = -abs(contents.energy_drift)  # the largest is negative
    write_dataset(folder / "study.nc", contents)
    return folder / "study.nc", contents, inspection.file_report(folder / "study.nc")


def test_a_dataset_says_its_results_and_what_made_it(dataset, tmp_path):
    path, contents, text = dataset
    assert failed_runs(path) == (1, 61, "few, N = 10: seeds 4")  # of 30 and 31
    assert text.endswith(f"\n\n{summary(contents)}".rstrip("\n"))
    drift, overlap = (
        np.nanmax(np.abs(contents[name])) for name in ("energy_drift", "worst_overlap")
    )
    assert "\nsimulated    " in text and "Initial velocities: normal" in text
    assert f"health       worst energy drift {drift:.2g}; worst overlap {overlap:.2g}\n" in text
    line = re.search(
        r"^source       of aggregate: (\w{12}), that of this installation$", text, re.MULTILINE
    )
    assert line[1] == contents.attrs["source_digest"][:12]
    told = [f"{name} {version(name)}" for name in ("brownpipe", *PACKAGES, *ANALYSIS_PACKAGES)]
    assert {"numpy", "scipy", "xarray", "h5py", "pandas"} <= {name.split()[0] for name in told}
    assert f"\nwritten by   {', '.join(told)}\n" in text
    unknown = contents.drop_attrs().assign_attrs(
        {name: contents.attrs[name] for name in ("title",)}
    )
    for changed, source in (
        (contents.assign_attrs(source_digest="0" * 64), "000000000000"),
        (unknown, "unknown"),
    ):
        write_dataset(tmp_path / "changed.nc", changed)
        assert (
            f"source       of aggregate: {source}, not that of this installation"
            in inspection.file_report(tmp_path / "changed.nc")
        )


def test_all_variables_with_units_and_meaning(dataset, said):
    path, contents, _ = dataset
    status, out, err = said("inspect", path, "--variables")
    lines = {line.split()[0]: line for line in out.splitlines()[1:]}
    assert (status, err) == (DONE, "")
    assert lines.keys() == {str(name) for name in contents.variables}
    for name in contents.data_vars:
        attributes = contents[name].attrs
        assert attributes["units"] in lines[name] and lines[name].endswith(attributes["long_name"])


# -- the scene, and the command that a file names --------------------------------------------------


@pytest.mark.parametrize("name", MADE)
def test_the_command_in_a_file_works_with_that_file_alone(name, folder, said):
    path = folder / f"{name}.h5"
    simulate = shlex.split(read_trajectories(path).header["command"])[1:]
    assert {*MADE[name][1:]} <= {*simulate}
    Path(simulate[1]).write_text(said("inspect", path, "--scene")[1])
    assert read_scene(simulate[1]).digest == read_trajectories(path).scene.digest
    assert main([*simulate, "--output", "again.h5"]) == DONE
    assert Path("again.h5").read_bytes() == path.read_bytes()


# -- runs again ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MADE)
def test_runs_come_out_again(name, folder, said):
    before = sorted(folder.iterdir())
    status, out, err = said("inspect", folder / f"{name}.h5", "--reproduce")
    first, last = out.splitlines()
    engine = read_trajectories(folder / f"{name}.h5").engine.options
    assert re.fullmatch(
        rf"running again 3 runs of \w+, N = 1[03], {engine}: some [0-9.]+ m?s of CPU", first
    )
    assert (status, last, err) == (DONE, "identical: 3 runs, all variables bit-identical", "")
    assert sorted(folder.iterdir()) == before and list(Path().iterdir()) == []


def changed(path, change):
    """A copy of a file whose ensemble has been changed by a function."""
    contents = read_trajectories(path)
    change(contents.ensemble)
    write_trajectories("changed.h5", contents.scene, contents.engine, contents.ensemble)
    return "changed.h5"


def cut(ensemble):
    ensemble.events[6] = type(ensemble.events[6])(*(values[:-1] for values in ensemble.events[6]))


def shift(ensemble):
    ensemble.tracer.position[-1, 0] += 2.0**-30
    ensemble.whole[5].velocity[3, 2, 1] -= 2.0**-20
    ensemble.observables["pair_expected"][1, 1, 9] += (
        2.0**-10
    )  # other pairs have NaN, before and again


def lose(ensemble):
    del ensemble.observables["virial"]
    ensemble.observables["velocity_autocorrelation"][1, 7] = np.nan


CHANGES = {
    "shift": (shift, ["2 of 3", "position: by at most 9.3e-10 (seed 3)",
                      "disks/velocity: by at most 9.5e-07 (seed 5)",
                      "pair_expected: by at most 0.00098 (seed 5)"]),
    "cut": (cut, ["1 of 3", *(f"events/{name}: in shape, type or NaN (seed 6)"
                              for name in ("event_time", "a", "b", "impulse"))]),
    "lost": (lose, ["3 of 3", "velocity_autocorrelation: in shape, type or NaN (seed 5)",
                    "virial: in shape, type or NaN (seeds 3,5-6)"]),
}  # fmt: skip


@pytest.mark.parametrize("change", CHANGES)
def test_what_differs_is_named(change, folder, said):
    make, (count, *lines) = CHANGES[change]
    path = changed(folder / "whole.h5", make)
    status, out, _ = said("inspect", path, "--reproduce")
    verdict, *found = out.splitlines()[1:]
    assert (status, verdict) == (FAILED, f"different: {count} runs")
    assert sorted(line.strip() for line in found) == sorted(lines)
    if change == "shift":  # of the seeds 3 and 5
        assert [said("inspect", path, "--reproduce", "--seed", seed)[0] for seed in (5, 6)] == [
            FAILED,
            DONE,
        ]


def test_another_source_is_said_before_the_runs_begin(folder, said, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(trajectories, "source_digest", lambda *_: "f00d" * 16)
        patch.setattr(trajectories, "versions", lambda: versions() | {"numba_version": "0.1"})
        path = changed(folder / "nothing.h5", lambda _: None)
    bp.save(bp.open(path), "again.h5")

    def simulate(*_, **__):
        raise RunError("stopped")

    monkeypatch.setattr("brownpipe.engines.exact.simulation.simulate", simulate)
    status, out, err = said("inspect", "again.h5", "--reproduce")
    assert (status, err) == (FAILED, "brownpipe: stopped\n")
    made_with = r"numba 0\.1, here \S+; source f00df00df00d, here \w{12}"
    assert re.search(
        rf"^results may differ: the file was made with {made_with}$", out, re.MULTILINE
    )


REFUSED = [  # options, what the message must contain
    (["RUNS", "--seed", "4"], "--seed 4: is not in the file; must be of 3,5-6"),
    (["RUNS", "--variables"], "is a trajectory file (of `brownpipe simulate`), not a dataset"),
    (["RUNS", "--scene", "--reproduce"], "--scene: must not be given with --reproduce"),
    (["RUNS", "--variables", "--seed", "0"], "--variables: must not be given with --seed"),
    (["small.nc", "--scene"], "is a dataset (of `brownpipe aggregate`), not a trajectory file"),
    (["runs.checkpoint"], "is the checkpoint of unfinished runs (repeat the command that wrote it"),
    (["absent.h5", "--reproduce"], "cannot be read: No such file or directory"),
]


@pytest.mark.parametrize(("options", "message"), REFUSED)
def test_what_cannot_be_told_is_refused_in_one_line(options, message, folder, said):
    write_dataset("small.nc", xarray.Dataset({"msd": ("time", [0.0, 1.0])}))
    write_checkpoint("runs.checkpoint", {"seeds": "0-3"}, {"done": np.array(2)})
    status, out, err = said(
        "inspect", *(folder / "whole.h5" if word == "RUNS" else word for word in options)
    )
    assert (status, out, err.count("\n")) == (WRONG_REQUEST, "", 1) and message in err
