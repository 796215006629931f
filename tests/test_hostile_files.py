"""Files that are planted, endless, declared huge or broken: one line, at once, and nothing else is touched."""

import os
import re
import shutil
import signal
import socket
import stat
import subprocess
import time

import h5py
import numpy as np
import pytest
import xarray

import brownpipe
import hostile
import synthetic
from brownpipe import storage
from brownpipe.analysis import aggregate
from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.errors import FAILED, BrownpipeError, RequestError, StorageError
from brownpipe.figures.catalogue import FIGURES
from brownpipe.opening import opened_unlinked
from brownpipe.storage import files
from brownpipe.study import read_study
from brownpipe.verbs.output import say, writable
from test_storage import make_ensemble, make_scene

LONGEST = 300  # characters of a message, besides the path
SCENE = """\
box: {x: [-3.0, 3.0], y: [-3.0, 3.0], boundary: periodic}
particles: 24
disks:
  tracer: {radius: 0.3, mass: 1.0, position: [0.0, 0.0]}
  species: [{name: bath, count: rest, radius: 0.1, mass: 0.4}]
velocities: {temperature: 1.0}
equilibrate: {time: 0.5, tracer: free}
duration: 1.0
sample_interval: 0.2
"""
STUDY = """\
scenes: [scene.yaml]
tolerance: 5 %
target: msd
particles: [10, 24]
engines: [exact, {name: timestep, time_step: 0.01}]
batch: 100
figures: [msd, health]
fit_windows: [[0.2, 1.0]]
rings: {dr: 0.1, count: 10}
"""


@pytest.fixture(scope="module")
def valid(tmp_path_factory):
    """A folder with a valid file of each kind."""
    folder = tmp_path_factory.mktemp("valid")
    (folder / "scene.yaml").write_text(SCENE)
    (folder / "study.yaml").write_text(STUDY)
    scene = make_scene(boundary="periodic")
    ensemble = make_ensemble(scene, seeds=(0, 1), whole=(0, 1), events=((0, 9), (1, 12)))
    squares = np.random.default_rng(1).random((2, len(scene.times)))
    measured = {"square_displacement": squares, "displacement_velocity": squares.copy()}
    ensemble.observables.update(measured)
    storage.write_trajectories(folder / "runs.h5", scene, Engine("exact"), ensemble)
    dataset = aggregate([folder / "runs.h5"])
    storage.write_dataset(folder / "study.nc", synthetic.with_measures(dataset))
    brownpipe.plot(brownpipe.open(folder / "study.nc"), "msd")  # imports here what the forked processes need
    return folder


def refused_in_one_line(ended, what):
    """The promise: an exit status of its own, no traceback, one line on stderr that is not long."""
    assert ended.status in (0, 1, 2), (ended, what)
    assert "Traceback" not in ended.errors + ended.printed, (ended.errors, what)
    lines = ended.errors.splitlines()
    if ended.status:
        assert len(lines) == 1 and lines[0].startswith("brownpipe"), (ended.errors[:2000], what)
        assert len(lines[0]) <= 2 * LONGEST, (lines, what)


def verb(*arguments):
    return lambda: main([*map(str, arguments)])


def opened(path):
    """The Python interface reads the file, and shows it."""

    def call():
        try:
            data = brownpipe.open(path)
            if isinstance(data, xarray.Dataset):
                brownpipe.plot(data, "msd")
            else:
                brownpipe.analyse(data)
        except BrownpipeError as error:
            return say(str(error), error.exit_status)
        return 0

    return call


def readers(path, random):
    """The calls that read a file of its kind, and one of them for this try."""
    if path.suffix == ".yaml":
        return verb("check", path)
    if path.suffix == ".nc":
        figure = verb("figures", path, "--output", "figures", "--figures", random.choice([*FIGURES]))
        return random.choice([verb("inspect", path), verb("inspect", path, "--variables"), figure, opened(path)])
    exports = [verb("export", path, "--to", form, "--output", f"x.{form}") for form in ("csv", "xyz", "gsd")]
    inspections = [verb("inspect", path, *more) for more in ([], ["--scene"], ["--seed", "1"], ["--variables"])]
    movies = [verb("movie", path, "--output", "x.png")]
    return random.choice([*exports, *inspections, *movies, opened(path), verb("aggregate", path, "--output", "x.nc")])


@pytest.mark.slow
@pytest.mark.promise(
    "A file that was made or changed to do harm",
    "Every reader of a file refuses it in one line, or reads it, within 400 MB of memory and without a traceback.",
)
def test_no_change_of_a_file_leads_to_more_than_one_line(valid, faults, tmp_path):
    names = ("scene.yaml", "study.yaml", "runs.h5", "runs.h5", "runs.h5", "study.nc", "study.nc")
    for number in faults.tries(10):
        name = faults.random.choice(names)
        folder = tmp_path / str(number)
        shutil.copytree(valid, folder)
        path, contents = folder / name, (valid / name).read_bytes()
        done = ["bytes"]
        if path.suffix == ".yaml":
            contents = hostile.changed_yaml(contents, faults.random)
        elif (kind := faults.random.random()) < 0.6:
            contents, done = hostile.changed_tree(contents, faults.random, path)
        elif kind < 0.9:
            contents, done = hostile.changed_metadata(contents, faults.random, tmp_path), ["metadata"]
        else:
            contents = hostile.changed_bytes(contents, faults.random)
        path.write_bytes(contents)
        before = {file.name: file.read_bytes() for file in folder.iterdir()}
        call = readers(path, faults.random)
        ended = hostile.in_child(call, folder)
        arguments = [cell.cell_contents for cell in call.__closure__]
        refused_in_one_line(ended, f"{arguments} {done} ({folder})")
        assert all((folder / name).read_bytes() == old for name, old in before.items())
        assert not [*folder.glob("*.part")]
        shutil.rmtree(folder)


# -- no ordinary files ----------------------------------------------------------------------------------------------

OF_YAML = (["check"], ["simulate"], ["run"], ["tradeoff"], ["plan"])
OF_HDF5 = (
    *(["inspect"], ["movie", "--output", "x.gif"], ["export", "--to", "csv", "--output", "x.csv"]),
    *(["aggregate", "--output", "x.nc"], ["figures", "--output", "figures"]),
)


def endless(folder):
    """A pipe, a socket and devices, of which none ends, and a link to one."""
    os.mkfifo(folder / "pipe")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(folder / "socket"))
    (folder / "zero").symlink_to("/dev/zero")
    return {"pipe": "a pipe", "socket": "a socket", "zero": "a device", "/dev/urandom": "a device"}


@pytest.mark.promise(
    "A pipe, a device or a socket in place of a file",
    "It is refused at once: only ordinary files are read.",
)
@pytest.mark.parametrize("verbs", [OF_YAML, OF_HDF5], ids=["YAML", "HDF5"])
def test_no_verb_waits_at_a_file_without_an_end(verbs, tmp_path):
    def call():
        statuses = [main([name, path, *options]) for path in kinds for name, *options in verbs]
        return max(statuses) if min(statuses) == max(statuses) else FAILED

    kinds = endless(tmp_path)
    ended = hostile.in_child(call, tmp_path)
    assert ended.status == 2, ended
    lines = ended.errors.splitlines()
    assert len(lines) == len(kinds) * len(verbs)
    for (path, kind), line in zip(((item) for item in kinds.items() for _ in verbs), lines, strict=True):
        assert line.startswith(f"brownpipe: {path}: ")
        assert line.endswith(f"cannot be read: {kind}, not an ordinary file")
    assert ended.seconds < 10


def test_paths_that_no_system_allows(tmp_path):
    for path in ("a\0b.yaml", str(tmp_path / ("x" * 5000)), str(tmp_path)):
        for read in (brownpipe.read_scene, storage.read_trajectories, storage.read_dataset, brownpipe.open):
            with pytest.raises(BrownpipeError, match="cannot be read") as caught:
                read(path)
            assert len(str(caught.value)) <= LONGEST + len(path)


def test_a_pipe_in_place_of_a_checkpoint(tmp_path):
    os.mkfifo(tmp_path / "x.h5.checkpoint")
    with pytest.raises(StorageError, match="a pipe, not an ordinary file; delete it to begin anew"):
        storage.read_checkpoint(tmp_path / "x.h5.checkpoint", {})


def test_a_wrong_file_is_not_shown(tmp_path):
    """The text of a file that is no scene or study may be a secret."""
    path = tmp_path / "passwd.yaml"
    path.write_text("root:x:0:0:secret:/root:/bin/bash\ndaemon:x:1:1:secret:/usr/sbin\n")
    for read in (brownpipe.read_scene, read_study):
        with pytest.raises(BrownpipeError) as caught:
            read(path)
        assert "secret" not in str(caught.value) and str(caught.value).endswith("not a text")


# -- files that are declared huge -----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.promise(
    "A small file that declares gigabytes",
    "It is refused before memory is taken, also if seal and digest are valid.",
)
@pytest.mark.parametrize("name", ["runs.h5", "study.nc"])
@pytest.mark.parametrize("change", [hostile.huge, hostile.bomb], ids=lambda change: change.__name__)
def test_a_size_that_is_not_stored_is_refused_before_it_is_taken(name, change, valid, faults, tmp_path):
    for _ in faults.tries(3):
        path = tmp_path / name
        path.write_bytes((valid / name).read_bytes())
        with h5py.File(path, "r+") as file:
            change(file, "observables/run/huge" if name == "runs.h5" else "huge", faults.random)
        path.write_bytes(hostile.resealed(path.read_bytes()))
        ended = hostile.in_child(verb("inspect", path), tmp_path)
        assert ended.status == FAILED, ended
        assert re.search("declares more|of shape|too large|does not fit|too many|not laid out", ended.errors), ended
        assert ended.seconds < 5


@pytest.mark.slow
def test_a_variable_with_the_same_dimension_twice_is_refused(valid, tmp_path, recwarn):
    path = tmp_path / "study.nc"
    path.write_bytes((valid / "study.nc").read_bytes())
    with h5py.File(path, "r+") as file:
        axes = file["msd"].dims
        axes[1].detach_scale(axes[1][0])
        axes[1].attach_scale(axes[0][0])
    path.write_bytes(hostile.resealed(path.read_bytes()))
    with pytest.raises(StorageError, match=r"has a variable with the same dimension twice \(/msd\)"):
        storage.read_dataset(path)
    assert not recwarn.list


# -- parts and links that are planted -------------------------------------------------------------------------------


@pytest.mark.promise(
    "A link or file planted under the name of a file that is being written",
    "No other file is opened, followed or overwritten.",
)
def test_a_planted_part_is_neither_followed_nor_used(tmp_path, monkeypatch):
    monkeypatch.setattr(files.os, "urandom", lambda count: bytes(count))  # the random part is guessed
    with files.replacing(tmp_path / "x") as part:
        part.write_bytes(b"")
    (tmp_path / "precious").write_bytes(b"mine")
    part.symlink_to("precious")
    with pytest.raises(StorageError, match="not written: File exists"):
        storage.write_file(tmp_path / "x", b"new")
    assert (tmp_path / "precious").read_bytes() == b"mine" and (tmp_path / "x").read_bytes() == b""


def test_a_part_that_is_exchanged_while_it_is_written_never_becomes_the_file(tmp_path):
    (tmp_path / "precious").write_bytes(b"mine")
    writing = files.replacing(tmp_path / "x")
    part = writing.__enter__()
    part.unlink()
    part.symlink_to("precious")
    with pytest.raises(OSError, match="symbolic link"):
        opened_unlinked(part, os.O_WRONLY)
    with pytest.raises(StorageError, match="another process has replaced its part"):
        writing.__exit__(None, None, None)
    assert os.listdir(tmp_path) == ["precious"] and (tmp_path / "precious").read_bytes() == b"mine"


def test_a_link_in_place_of_a_file_is_replaced_and_a_linked_folder_is_used(tmp_path):
    (tmp_path / "precious").write_bytes(b"mine")
    (tmp_path / "x").symlink_to("precious")
    (tmp_path / "scratch").mkdir()
    (tmp_path / "results").symlink_to("scratch")
    storage.write_file(tmp_path / "x", b"new")
    storage.write_file(tmp_path / "results" / "y", b"new")
    assert (tmp_path / "precious").read_bytes() == b"mine" and not (tmp_path / "x").is_symlink()
    assert (tmp_path / "scratch" / "y").read_bytes() == b"new" and (tmp_path / "results").is_symlink()


def test_the_link_of_another_user_is_not_followed(tmp_path, monkeypatch):
    (tmp_path / "link.gif").symlink_to("precious")
    uid = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: uid + 1)
    made = os.stat_result((stat.S_IFLNK, 0, 0, 0, uid + 2, 0, 0, 0, 0, 0))
    monkeypatch.setattr(os, "lstat", lambda path: made)
    with pytest.raises(RequestError, match="is a link that another user has made"):
        writable(str(tmp_path / "link.gif"), suffixes=(".gif",))


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_files_have_the_usual_permissions(mask, tmp_path):
    before = os.umask(mask)
    try:
        storage.write_file(tmp_path / "x", b"")
    finally:
        os.umask(before)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o666 & ~mask


@pytest.mark.slow
@pytest.mark.promise(
    "A process that is killed while it writes a file",
    "The old file stays, and the next writer of that file removes what was left.",
)
def test_killed_writers_leave_the_old_file_and_the_next_one_no_litter(faults, tmp_path):
    contents = [bytes([k]) * 300_000 for k in range(2)]
    storage.write_file(tmp_path / "x", contents[0])
    left = 0
    for _ in faults.tries(20):
        child = os.fork()
        if child == 0:
            while True:
                for each in contents:
                    storage.write_file(tmp_path / "x", each)
        time.sleep(faults.random.uniform(0.0, 0.02))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        left += len([*tmp_path.glob("*.part")])
        assert (tmp_path / "x").read_bytes() in contents
        storage.write_file(tmp_path / "x", contents[0])
        assert os.listdir(tmp_path) == ["x"]
    print(f"parts left by killed writers: {left}")


def test_parts_of_running_processes_other_places_and_other_files_stay(tmp_path):
    place, ended = files._place(), 4_999_999  # above the largest process number
    stay = [
        f"x.{os.getpid()}-{place}-00000000.part",
        f"x.{ended}-ffffffff-00000000.part",
        f"y.{ended}-{place}-00000000.part",
    ]
    stay += [f"x.{ended}-{place}-0.part", "x.part", f"x.{ended}.part"]
    go = [f"x.{ended}-{place}-00000000.part", f"x.{ended}-fffffff0-00000000.part"]
    for name in stay + go:
        (tmp_path / name).write_bytes(b"")
    os.utime(tmp_path / go[1], (0, 0))
    storage.write_file(tmp_path / "x", b"")
    assert sorted(os.listdir(tmp_path)) == sorted([*stay, "x"])


# -- standard streams -----------------------------------------------------------------------------------------------


@pytest.mark.promise(
    "A closed standard output, or one that nobody reads to its end",
    "The command ends as usual or with status 1, without a traceback, and no file takes its place.",
)
@pytest.mark.parametrize(
    ("command", "status"),
    [
        ("brownpipe schema scene >&-", 0),
        ("brownpipe check absent.yaml <&- >&- 2>&-", 2),
        ("(brownpipe schema scene; echo $? >&2) | true", 0),
        ("brownpipe schema scene >/dev/full", 1),
    ],
)
def test_closed_streams(command, status, valid):
    done = subprocess.run(["bash", "-c", command], cwd=valid, capture_output=True, text=True, timeout=60)
    assert done.returncode == status
    assert "Traceback" not in done.stderr and "Exception" not in done.stderr
    assert len(done.stderr.splitlines()) <= 1
