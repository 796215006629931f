"""Files are whole or absent, the same bytes every time, and never silently wrong."""

import errno
import os
import subprocess
import sys

import h5py
import numpy as np
import pytest
import xarray

import brownpipe
from brownpipe import inspection, provenance
from brownpipe.engines import Engine, configured
from brownpipe.engines.ensemble import Ensemble, Events, Track
from brownpipe.errors import StorageError
from brownpipe.scene import parse_scene
from brownpipe.storage import files, trajectories
from brownpipe.storage.datasets import read_dataset, write_dataset
from brownpipe.storage.files import write_file
from brownpipe.storage.trajectories import read_outline, read_trajectories, write_trajectories

COUNTS = ("pair_collisions", "wall_collisions", "tracer_collisions")
ENSKOG = (("friction", "enskog"),)
SEEDS = (0, 1, 2, 7)
EVERYTHING = {"whole": SEEDS, "events": ((0, 12), (1, 3), (2, 0), (7, 1))}
ERRORS = ("energy_drift", "worst_overlap", "momentum_residual")


def make_scene(particles=5, boundary="reflecting"):
    species = [{"name": "bath", "count": "rest", "radius": 0.1, "mass": 0.4}]
    tracer = {"tracer": {"radius": 0.3, "mass": 1.0}} if particles else {}
    mapping = {
        "box": {"x": [-3.0, 3.0], "y": [-3.0, 3.0], "boundary": boundary},
        "particles": particles,
        "disks": tracer | {"species": species},
        "velocities": {"standard_deviation": 2.0},
        "duration": 1.0,
        "sample_interval": 0.2,
    }
    return parse_scene(mapping, "a.scene.yaml")


def make_ensemble(scene, seeds=SEEDS, whole=(), events=()):
    """Records of the right shapes with random numbers in them."""
    rng, samples = np.random.default_rng(1), len(scene.times)

    def track(disks, moving):
        shape, periodic = (samples, disks, 2), scene.box.periodic
        velocity = rng.normal(size=shape) if moving else None
        image = rng.integers(-2, 3, shape).astype(np.int32) if periodic else None
        return Track(rng.normal(size=shape), velocity, image)

    def log(size):
        a, b = rng.integers(-4, max(1, scene.particles), (2, size)).astype(np.int32)
        return Events(np.sort(rng.random(size)), a, b, rng.normal(size=(size, 2)))

    observables = {name: rng.integers(0, 2000, len(seeds)) for name in COUNTS}
    observables |= {name: 1e-15 * rng.random(len(seeds)) for name in ERRORS}
    observables["failed"] = np.zeros(len(seeds), np.uint8)
    return Ensemble(
        seeds=np.array(seeds, np.int64),
        times=scene.times,
        tracer=track(len(seeds), False) if scene.particles else None,
        observables=observables,
        whole={seed: track(scene.particles, True) for seed in whole},
        events={seed: log(size) for seed, size in events},
    )


def make_dataset():
    rng = np.random.default_rng(2)
    data = {
        "msd": (("scene", "time"), rng.random((2, 6)), {"units": "length^2", "long_name": "mean squared displacement"}),
        "runs": (("scene",), np.array([2400, 100])),
        "diffusion": ((), 0.2435, {"window": [0.1, 1.0]}),
    }
    coords = {"scene": ["harrison2020", "thermal"], "time": ("time", np.arange(6.0), {"units": "time"})}
    return xarray.Dataset(data, coords, {"title": "a study", "Conventions": "CF-1.11"})


CASES = {
    "tracer": (make_scene(), {}),
    "whole runs and events": (make_scene(), EVERYTHING),
    "periodic": (make_scene(boundary="periodic"), {"whole": SEEDS}),
    "no disks": (make_scene(0), {"whole": SEEDS, "events": [(seed, 0) for seed in SEEDS]}),
    "one seed": (make_scene(), {"seeds": (123456,), "whole": (123456,)}),
}


@pytest.fixture(params=CASES)
def case(request):
    scene, recorded = CASES[request.param]
    return scene, make_ensemble(scene, **recorded)


@pytest.fixture
def full(tmp_path):
    """A file with everything in it."""
    scene, path = make_scene(boundary="periodic"), tmp_path / "full.h5"
    write_trajectories(path, scene, Engine("exact"), make_ensemble(scene, **EVERYTHING))
    return path


def same(one, other):
    """Equal to the bit, types included."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple):
        return type(one) is type(other) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    return one == other


def refusal(read, path):
    with pytest.raises(StorageError) as error:
        read(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)
    return str(error.value)


# -- trajectories ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "engine",
    [Engine("exact"), configured("timestep", time_step=1e-3), Engine("langevin", ENSKOG)],
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
    assert f"engine       {engine.options}\n" in inspection.report(tmp_path / "new" / "runs.h5")


def test_an_engine_of_another_version(tmp_path):
    """A setting of no meaning here is refused."""
    path, scene = tmp_path / "runs.h5", make_scene()
    write_trajectories(path, scene, Engine("exact", (("cell_side", 1.5),)), make_ensemble(scene))
    for read in (read_trajectories, read_outline):
        assert "not of this one: cell_side: unknown key" in refusal(read, path)


def test_every_variable_has_units_a_meaning_and_dimensions(case, tmp_path):
    write_trajectories(tmp_path / "runs.h5", case[0], Engine("exact"), case[1])
    with h5py.File(tmp_path / "runs.h5") as file:
        items = [item for name in ("/", *file) for item in ([file[name]] if name != "/" else [])]
        items += [item for item in items if isinstance(item, h5py.Group) for item in item.values()]
        variables = [item for item in items if isinstance(item, h5py.Dataset) and not item.name.endswith("/event")]
        for item in variables:
            assert item.attrs["units"] and item.attrs["long_name"]
            assert item.is_scale or all(len(dim) == 1 for dim in item.dims), item
            assert item.nbytes <= trajectories.SMALL or (item.compression, item.compression_opts) == ("gzip", 4)
        assert len(variables) > 10


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("engine", ["h5netcdf", None])
def test_xarray_shows_the_tree_of_brownpipe(engine, full):
    runs = brownpipe.open(full)
    with xarray.open_datatree(full, engine=engine) as found:
        assert dict(found.attrs) == runs.attrs
        for node in found.subtree:
            shown = runs[node.path].to_dataset().variables
            for name, variable in node.to_dataset().variables.items():
                assert shown[name].identical(variable)
            assert shown.keys() - node.to_dataset().variables.keys() <= {"unwrapped", "box_size", "failed"}
    assert runs.image.dims == ("time", "seed", "component")
    assert runs.disks.velocity.dims == ("time", "seed", "disk", "component")
    assert runs.events.impulse.dims == ("event", "component")
    assert np.array_equal(runs.position.sel(seed=7), read_trajectories(full).ensemble.tracer.position[:, 3])


# -- datasets -------------------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
def test_dataset_round_trip(tmp_path):
    path, dataset = tmp_path / "study.nc", make_dataset()
    write_dataset(path, dataset)
    assert read_dataset(path).identical(dataset)
    with xarray.open_dataset(path) as plain:
        assert plain.drop_attrs().identical(dataset.drop_attrs())
    write_dataset(tmp_path / "again.nc", read_dataset(path))
    assert (tmp_path / "again.nc").read_bytes() == path.read_bytes()


@pytest.mark.filterwarnings("error")
def test_netcdf_gives_back_what_is_written(tmp_path):
    """Dimensions without coordinates, missing values, flags and texts; all in the same order, of the same types."""
    more = {
        "verdict": (("scene", "sample"), [["yes", "µ"], ["", "no"]]),
        "missing": (("sample", "scene"), [[np.nan, 1.0], [-0.0, np.inf]], {"units": "length"}),
        "flag": (("scene",), [True, False]),
        "status": (("scene",), np.array([0, 3], np.int8), {"flag_values": np.array([0, 3], np.int8), "one": 1.5}),
        "label": ((), "a word"),
    }
    written = make_dataset().assign(more).assign_coords(area=("scene", [0.1, 0.2]))
    write_dataset(tmp_path / "study.nc", written)
    found = [read_dataset(tmp_path / "study.nc")]
    with xarray.open_dataset(tmp_path / "study.nc", engine="h5netcdf") as opened:
        found.append(opened.load().drop_encoding())
    for dataset in found:
        assert dataset.identical(written)
        assert [*dataset.data_vars] == [*written.data_vars]
        for name, variable in written.variables.items():
            assert dataset[name].dtype.kind == variable.dtype.kind and [*dataset[name].attrs] == [*variable.attrs]
    assert found[0].sizes == found[1].sizes


# -- the same bytes -------------------------------------------------------------------------------------------------

ELSEWHERE = """
import sys, time
sys.path[:0] = sys.argv[1:3]
from test_storage import *
time.sleep(1.1)  # a time stamp in seconds would show
scene = make_scene()
write_trajectories("a/runs.h5", scene, Engine("exact"), make_ensemble(scene, **EVERYTHING))
write_dataset("a/study.nc", make_dataset())
"""


@pytest.mark.slow
def test_same_bytes_in_another_process_place_and_time_zone(tmp_path):
    scene = make_scene()
    write_trajectories(
        tmp_path / "runs.h5",
        scene,
        Engine("exact"),
        make_ensemble(scene, **EVERYTHING),
    )
    write_dataset(tmp_path / "study.nc", make_dataset())
    other = {"TZ": "Asia/Tokyo", "LANG": "C", "LC_ALL": "C", "PYTHONHASHSEED": "7", "HOME": str(tmp_path)}
    run_elsewhere(ELSEWHERE, tmp_path, other)
    for name in ("runs.h5", "study.nc"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / name).read_bytes()
    assert str(tmp_path).encode() not in (tmp_path / "runs.h5").read_bytes()


def run_elsewhere(program, folder, environment):
    places = [os.path.dirname(__file__), str(provenance.PACKAGE.parent)]
    environment = {"PATH": os.environ["PATH"]} | environment
    command = [sys.executable, "-c", program, *places]
    return subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True, text=True)


def test_writing_trajectories_leaves_xarray_alone(tmp_path):
    program = "import sys; sys.path[:0] = sys.argv[1:3]; import brownpipe.storage.trajectories"
    assert run_elsewhere(f"{program}; print('xarray' in sys.modules)", tmp_path, {}).stdout == "False\n"


# -- damage ---------------------------------------------------------------------------------------------------------


def test_no_bit_flip_of_runs_is_silent(full):
    contents = full.read_bytes()
    for bit in np.random.default_rng(3).integers(0, 8 * len(contents), 200):
        damaged = bytearray(contents)
        damaged[bit // 8] ^= 1 << (bit % 8)
        full.write_bytes(damaged)
        refusal(read_trajectories, full)


def test_no_truncation_is_silent(full):
    contents = full.read_bytes()
    for size in (0, 7, 8, 100, len(contents) // 2, len(contents) - 1):
        full.write_bytes(contents[:size])
        refusal(read_trajectories, full)


def test_no_bit_flip_of_a_dataset_is_silent(tmp_path):
    path = tmp_path / "study.nc"
    write_dataset(path, make_dataset())
    contents = path.read_bytes()
    for bit in np.random.default_rng(4).integers(0, 8 * len(contents), 200):
        damaged = bytearray(contents)
        damaged[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(damaged)
        refusal(read_dataset, path)


def test_a_damaged_file_names_the_cure(full):
    contents = bytearray(full.read_bytes())
    contents[-1] ^= 1
    full.write_bytes(contents)
    message = refusal(read_trajectories, full)
    assert "damaged" in message and "delete it and run the study, or brownpipe simulate, again" in message
    assert refusal(inspection.report, full) == message


def test_an_edited_file_is_refused(full):
    with h5py.File(full, "r+") as file:
        file.attrs["engine"] = "other"
    assert "damaged" in refusal(read_trajectories, full)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "runs.h5"
    assert "No such file" in refusal(read_trajectories, path)
    path.write_text("no HDF5 at all")
    assert "is not a trajectory file or dataset" in refusal(read_trajectories, path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    assert "not a file of brownpipe" in refusal(read_trajectories, path)
    assert "not a file of brownpipe" in refusal(read_dataset, path)
    write_dataset(path, make_dataset())
    assert "not a trajectory file" in refusal(read_trajectories, path)
    write_trajectories(path, make_scene(), Engine("exact"), make_ensemble(make_scene()))
    assert "not a dataset" in refusal(read_dataset, path)


# -- writing whole or not at all ------------------------------------------------------------------------------------

FAILURES = [OSError(errno.ENOSPC, "No space left on device"), OSError(errno.EROFS, "Read-only file system")]


@pytest.mark.parametrize("number", [errno.EINVAL, errno.EOPNOTSUPP])
def test_a_file_system_that_cannot_wait_for_folders_is_used(number, monkeypatch, tmp_path):
    fsync = os.fsync

    def of_files_alone(handle):
        if os.path.isdir(f"/proc/self/fd/{handle}"):
            raise OSError(number, os.strerror(number))
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


def test_a_file_in_place_of_the_folder(tmp_path):
    (tmp_path / "x").write_bytes(b"")
    with pytest.raises(StorageError, match="choose a place"):
        write_file(tmp_path / "x" / "y", b"")


KILLED = """
import os, signal, sys
sys.path[:0] = sys.argv[1:3]
from brownpipe.storage.files import write_file
os.fsync = lambda _: os.kill(os.getpid(), signal.SIGTERM)
write_file("x", b"new")
"""


def test_a_killed_writer_leaves_nothing_under_the_final_name(tmp_path):
    with pytest.raises(subprocess.CalledProcessError):
        run_elsewhere(KILLED, tmp_path, {})
    assert not (tmp_path / "x").exists()


# -- provenance and inspection --------------------------------------------------------------------------------------


def test_describe(case, tmp_path):
    path = tmp_path / "runs.h5"
    write_trajectories(path, case[0], Engine("exact"), case[1])
    text = inspection.report(path)
    for word in ("a.scene", f"{case[0].particles} disks", "6 from t = 0 to 1", "no failed", "intact       yes"):
        assert word in text
    assert all(name in text for name in case[1].observables)


def test_describe_a_dataset(tmp_path):
    write_dataset(tmp_path / "study.nc", make_dataset())
    text = inspection.report(tmp_path / "study.nc")
    assert "a study" in text and "msd, runs, diffusion" in text and "intact       yes" in text
