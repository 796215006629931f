"""Files are whole or absent, the same bytes every time, and never silently wrong."""

import errno
import os

import h5py
import numpy as np
import pytest
import xarray

import brownpipe
from brownpipe import inspection, provenance
from brownpipe.analysis import aggregate
from brownpipe.cli import main
from brownpipe.engines import Engine, engine_of_request
from brownpipe.errors import FAILED, StorageError
from brownpipe.storage import files
from brownpipe.storage.datasets import read_dataset, write_dataset
from brownpipe.storage.files import write_file
from brownpipe.storage.trajectories import from_tree, read_trajectories, write_trajectories
from ensembles import make_runs, make_scene, write

SEEDS = (0, 1, 2, 7)
EVERYTHING = {"tracer", "all", "events"}


def make_ensemble(scene, seeds=SEEDS, record=EVERYTHING):
    return engine_of_request("exact", {}).simulate(scene, seeds, record)


def make_dataset():
    rng = np.random.default_rng(2)
    data = {
        "msd": (
            ("scene", "time"),
            rng.random((2, 6)),
            {"units": "length^2", "long_name": "mean squared displacement"},
        ),
        "runs": (("scene",), np.array([2400, 100])),
        "diffusion": ((), 0.2435, {"window": [0.1, 1.0]}),
    }
    coords = {
        "scene": ["harrison2020", "thermal"],
        "time": ("time", np.arange(6.0), {"units": "time"}),
    }
    return xarray.Dataset(data, coords, {"title": "a study", "Conventions": "CF-1.11"})


BATH = {"species": [{"name": "bath", "count": 0, "radius": 0.1, "mass": 0.4}]}
CASES = {
    "tracer": (make_scene(particles=5), SEEDS, {"tracer"}),
    "whole runs and events": (make_scene(particles=5), SEEDS, EVERYTHING),
    "periodic": (make_scene(particles=5, boundary="periodic"), SEEDS, {"tracer", "all"}),
    "no disks": (make_scene(particles=0, disks=BATH), SEEDS, EVERYTHING),
    "one seed": (make_scene(particles=5), (123456,), {"all"}),
}


@pytest.fixture(params=CASES)
def case(request):
    scene, *made = CASES[request.param]
    return scene, make_ensemble(scene, *made)


@pytest.fixture
def full(tmp_path):
    """A file with everything in it."""
    scene = make_scene(particles=5, boundary="periodic")
    path = tmp_path / "full.h5"
    write_trajectories(path, scene, Engine("exact"), make_ensemble(scene))
    return path


def same(one, other):
    """Equal to the bit, types included."""
    if isinstance(one, dict):
        if one.keys() != other.keys():
            return False
        return all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple):
        return type(one) is type(other) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return (
            one.dtype == other.dtype
            and one.shape == other.shape
            and one.tobytes() == other.tobytes()
        )
    return one == other


def refusal(read, path):
    with pytest.raises(StorageError) as error:
        read(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)
    return str(error.value)


# -- trajectories ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "engine",
    [
        Engine("exact"),
        engine_of_request("timestep", {"time_step": 1e-3}),
        engine_of_request("langevin", {"friction": "enskog"}),
    ],
    ids=lambda engine: engine.label,
)
def test_round_trip(case, engine, tmp_path):
    scene, ensemble = case
    write_trajectories(tmp_path / "new" / "runs.h5", scene, engine, ensemble)
    assert os.listdir(tmp_path / "new") == ["runs.h5"]
    source = provenance.made_with("simulate", engine.name)["source_digest"]
    found = read_trajectories(tmp_path / "new" / "runs.h5")
    assert same(found[:4], (scene, engine, ensemble, source))
    assert found.header["numba_version"] == provenance.versions()["numba_version"]
    text = inspection.file_report(tmp_path / "new" / "runs.h5")
    told = (
        f"engine       {engine.options}",
        f"{scene.particles} disks",
        "21 from t = 0 to 1",
        "no failed",
    )
    assert all(word in text for word in (*told, "intact       yes", *ensemble.observables))


def test_an_engine_of_another_version(tmp_path):
    """A setting of no meaning here is refused."""
    path = tmp_path / "runs.h5"
    scene = make_scene(particles=5)
    write_trajectories(path, scene, Engine("exact", (("cell_side", 1.5),)), make_ensemble(scene))
    assert "cell_side: unknown key; allowed: name; if a version" in refusal(read_trajectories, path)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("engine", ["h5netcdf", None])
def test_xarray_shows_the_tree_of_brownpipe(engine, full):
    runs = brownpipe.open(full)
    with xarray.open_datatree(full, engine=engine) as found:
        assert dict(found.attrs) == runs.attrs
        for node in found.subtree:
            shown = runs[node.path].to_dataset().variables
            for name, variable in node.to_dataset().variables.items():
                assert (shown[name].dims, shown[name].attrs) == (variable.dims, variable.attrs)
            assert all(
                {"units", "long_name"} <= variable.attrs.keys() for variable in shown.values()
            )
            assert shown.keys() - node.to_dataset().variables.keys() <= {
                "unwrapped",
                "box_size",
                "failed",
            }
    assert runs.image.dims == ("time", "seed", "component")
    assert runs.events.impulse.dims == ("seed", "event", "component")
    assert np.array_equal(
        runs.position.sel(seed=7), read_trajectories(full).ensemble.tracer.position[:, 3]
    )


# -- datasets --------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
def test_dataset_round_trip(tmp_path):
    path = tmp_path / "study.nc"
    dataset = make_dataset()
    write_dataset(path, dataset)
    assert read_dataset(path).identical(dataset)
    with xarray.open_dataset(path) as plain:
        assert plain.drop_attrs().identical(dataset.drop_attrs())
    write_dataset(tmp_path / "again.nc", read_dataset(path))
    assert (tmp_path / "again.nc").read_bytes() == path.read_bytes()


# -- damage ----------------------------------------------------------------------------------------


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "runs.h5"
    assert "No such file" in refusal(read_trajectories, path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    assert "no file of brownpipe" in refusal(read_trajectories, path)
    assert "no file of brownpipe" in refusal(read_dataset, path)
    write_dataset(path, make_dataset())
    assert "not a trajectory file" in refusal(read_trajectories, path)
    write_trajectories(path, make_scene(), Engine("exact"), make_ensemble(make_scene()))
    assert "not a dataset" in refusal(read_dataset, path)


# -- writing whole or not at all -------------------------------------------------------------------

FAILURES = [
    OSError(errno.ENOSPC, "No space left on device"),
    OSError(errno.EROFS, "Read-only file system"),
]


def test_a_file_system_that_cannot_wait_for_folders_is_used(monkeypatch, tmp_path):
    fsync = os.fsync

    def of_files_alone(handle):
        if os.path.isdir(handle):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", of_files_alone)
    files.write_file(tmp_path / "file", b"contents")
    assert (tmp_path / "file").read_bytes() == b"contents"


@pytest.mark.parametrize("call", ["fsync", "replace"])
@pytest.mark.parametrize("failure", [*FAILURES, KeyboardInterrupt(), SystemExit(143)], ids=repr)
def test_a_failed_write_keeps_the_old_file_and_nothing_else(call, failure, tmp_path, monkeypatch):
    (tmp_path / "x").write_bytes(b"old")

    def fail(*_):
        raise failure

    monkeypatch.setattr(files.os, call, fail)
    with pytest.raises(StorageError if isinstance(failure, OSError) else type(failure)) as error:
        write_file(tmp_path / "x", b"new")
    assert os.listdir(tmp_path) == ["x"] and (tmp_path / "x").read_bytes() == b"old"
    if isinstance(failure, OSError):
        assert f"{tmp_path / 'x'}: not written: {failure.strerror}" in str(error.value)


def add_attribute(file):
    file.attrs["note"] = "mine"


def change_number(file):
    file["time" if "time" in file else "msd"][0] = 3.0


def add_variable(file):
    file["mine"] = np.arange(3000.0)


@pytest.mark.parametrize("mode", ["r+", "a"])
@pytest.mark.parametrize("change", [lambda file: None, add_attribute, change_number, add_variable])
@pytest.mark.parametrize("kind", ["runs.h5", "study.nc"])
def test_a_file_that_was_opened_for_writing_is_told_from_a_damaged_one(
    kind, change, mode, tmp_path, capsys
):
    """What it holds is never taken for the runs, as it may have been changed."""
    path = tmp_path / kind
    runs_in_memory = make_runs(make_scene(), range(12))
    runs = write(tmp_path, runs_in_memory)
    if kind == "runs.h5":
        runs.rename(path)
    else:
        write_dataset(path, aggregate([runs]))
    with h5py.File(path, mode) as file:
        change(file)
    for verb in (["inspect", str(path)], ["verify", str(path)], ["verify", str(tmp_path)]):
        assert main(verb) == FAILED
        said = "".join(capsys.readouterr())
        assert f"{kind}: has lost its seal, the last line, as when another program opens" in said
        assert "put a copy in its place, or move it away and run the study" in said
        assert "damaged;" not in said and "delete" not in said
    if kind == "runs.h5" and change is add_attribute:
        with xarray.open_datatree(path) as tree:  # at one's own risk
            assert aggregate([from_tree(tree)]).equals(aggregate([runs_in_memory]))
    contents = path.read_bytes()
    path.write_bytes(contents[: len(contents) - 100])
    assert main(["inspect", str(path)]) == FAILED
    assert "is damaged, cut short or edited" in capsys.readouterr().err
