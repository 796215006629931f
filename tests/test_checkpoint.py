"""Checkpoints: a run that is stopped and goes on, wherever and however often, is the same to the
byte.
"""

import os
import re
import signal
import time
from importlib.metadata import version
from itertools import count
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from brownpipe import provenance
from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.engines.exact import run as exact_run
from brownpipe.engines.exact.simulation import NO_CHECKPOINTS, Checkpoints, simulate
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST
from brownpipe.observables import OBSERVABLES
from brownpipe.storage.files import read_checkpoint, write_checkpoint
from brownpipe.storage.trajectories import write_trajectories
from scenes import swarm
from test_timestep import mixture_in_box

SEEDS = [8, 9, 10]  # as texts 10 is the first
W, P = "reflecting", "periodic"
TRACER = {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]}


def around_tracer(boundary, duration, **more):
    """A scene of the note's tracer among 39 disks, equilibrated before."""
    return mixture_in_box(boundary, (6.0, 6.0), [(39, 0.1, 0.4)], duration, TRACER, **more)


CASES = {  # some blocks each, and samples that do not fall on their ends
    "walls": (mixture_in_box(W, (3, 3), [(24, 0.2, 1)], 70.0, sample_interval=3.0), {"tracer"}),
    "walls-everything": (
        mixture_in_box(W, (3, 3), [(24, 0.2, 1)], 70.0, sample_interval=4.0),
        {"tracer", "all", "events"},
    ),
    "periodic": (
        mixture_in_box(P, (3, 3), [(24, 0.2, 1)], 70.0, sample_interval=3.0),
        {"tracer", "events"},
    ),
    "periodic-mixture": (
        mixture_in_box(
            P, (4, 3), [(12, 0.1, 1), (12, 0.14, 0.3), (8, 0.2, 4)], 30.0, sample_interval=1.0
        ),
        {"tracer", "all", "events"},
    ),
    "crowded": (
        mixture_in_box(W, (3, 2), [(60, 0.14, 1)], 10.0, placement="lattice"),
        {"tracer", "events"},
    ),
    "crowded-mixture": (
        mixture_in_box(
            P,
            (2.5, 2),
            [(15, 0.2, 1), (14, 0.165, 0.3)],
            10.0,
            placement="lattice",
            sample_interval=1.0,
        ),
        {"tracer", "all"},
    ),
    "pinned": (
        around_tracer(
            W, 400.0, sample_interval=7.0, equilibrate={"time": 300.0, "tracer": "pinned"}
        ),
        {"tracer"},
    ),
    "swarm": (swarm(15.0), {"tracer", "all"}),  # with more room in its cells than usual
}


OTHERS = [
    "periodic",
    "crowded",
    "crowded-mixture",
    "pinned",
    "swarm",
]  # than those killed at every block below


class KilledError(Exception):
    """Stands for the end of a process."""


def file_of(folder, scene, ensemble):
    """The bytes of the trajectory file."""
    write_trajectories(folder / "x.h5", scene, Engine("exact"), ensemble)
    return (folder / "x.h5").read_bytes()


def bits_of(ensemble):
    """All that a trajectory file has of an ensemble: each array with its name, type, shape and
    bytes.
    """
    groups = {
        "": {"seeds": ensemble.seeds, "times": ensemble.times},
        "observables": ensemble.observables,
    }
    groups |= {"tracer": {} if ensemble.tracer is None else ensemble.tracer._asdict()}
    for kind in ("whole", "events"):
        groups |= {
            (kind, seed): record._asdict() for seed, record in getattr(ensemble, kind).items()
        }
    named = {(key, name): values for key, group in groups.items() for name, values in group.items()}
    return {
        name: None if v is None else (v.dtype, v.shape, v.tobytes()) for name, v in named.items()
    }


def filed(folder, arrays):
    """The arrays after they were in a checkpoint file."""
    write_checkpoint(folder / "x.checkpoint", {"a": 1}, arrays)
    return read_checkpoint(folder / "x.checkpoint", {"a": 1})


def due_every(stops):
    """A clock by which a checkpoint is due every so many times that the engine asks."""
    numbers = count(1)
    return lambda: next(numbers) % stops == 0


def from_checkpoint(arrays):
    """Continue from these arrays, without further checkpoints."""
    return NO_CHECKPOINTS._replace(stored=arrays)


def stopped_once(scene, record, kept, stops):
    """Run until the first checkpoint and no further; return that, or the ensemble if there was
    none.
    """

    def keep(arrays):
        found.append(
            {name: value[()].copy() for name, value in arrays.items()}
        )  # numbers as numbers, like a file
        raise KilledError

    found = []
    try:
        return None, simulate(scene, SEEDS, record, Checkpoints(due_every(stops), keep, kept))
    except KilledError:
        return found[0], None


# -- the same to the byte --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["walls-everything", *(pytest.param(name, marks=pytest.mark.slow) for name in OTHERS)]
)
def test_from_every_block_to_the_same_bytes(name, tmp_path):
    scene, record = CASES[name]
    usual = simulate(scene, SEEDS, record)
    expected = bits_of(usual)
    kept = []
    checkpoints = Checkpoints(lambda: True, lambda arrays: kept.append(filed(tmp_path, arrays)))
    stored = simulate(scene, SEEDS, record, checkpoints)
    assert file_of(tmp_path, scene, stored) == file_of(tmp_path, scene, usual)
    assert bits_of(stored) == expected
    assert sum("run.motion" in arrays for arrays in kept) >= 2 * len(SEEDS)  # at block ends
    assert [len(arrays["runs.seeds"]) for arrays in kept if "run.motion" not in arrays] == [
        1,
        2,
    ]  # and between runs
    if scene.equilibrate.time:
        assert {bool(arrays.get("run.equilibrating")) for arrays in kept} == {True, False}
    for arrays in kept:
        assert bits_of(simulate(scene, SEEDS, record, from_checkpoint(arrays))) == expected


@pytest.mark.parametrize("stops", [1, 3])
@pytest.mark.parametrize("name", ["walls", "periodic-mixture", "pinned"])
def test_killed_again_and_again(name, stops, monkeypatch):
    """With 3, also where cells that overflow at the end of a run let it begin anew."""
    scene, record = CASES[name]
    if stops == 3:
        to_last = exact_run._to_last_sample
        monkeypatch.setattr(
            exact_run,
            "_to_last_sample",
            lambda p, w, *of: to_last(p, w, *of) and p.workspace is not w,
        )
    expected = bits_of(simulate(scene, SEEDS, record))
    kept, done, deaths = None, None, -1
    while done is None:
        kept, done = stopped_once(scene, record, kept, stops)
        deaths += 1
    assert deaths >= (6 if stops == 1 else 2)
    assert bits_of(done) == expected


@pytest.mark.slow
@pytest.mark.parametrize(("record", "average"), [("none", "origins"), ("tracer", "runs")])
def test_what_is_measured_in_the_runs(record, average, tmp_path):
    """From every block and from between the runs; where nothing else is kept of them, too."""
    more = {
        "sample_interval": 4.0,
        "equilibrate": {"time": 20.0, "tracer": "free"},
        "velocities": {"temperature": 1.0},
    }
    scene, measured = (
        around_tracer(P, 100.0, **more),
        {"observables": tuple(OBSERVABLES), "average": average},
    )
    expected = bits_of(simulate(scene, SEEDS, {record}, **measured))
    kept = []
    checkpoints = Checkpoints(lambda: True, lambda arrays: kept.append(filed(tmp_path, arrays)))
    assert bits_of(simulate(scene, SEEDS, {record}, checkpoints, **measured)) == expected
    assert {len(arrays["runs.seeds"]) for arrays in kept} == {0, 1, 2}
    for arrays in kept:
        assert (
            bits_of(simulate(scene, SEEDS, {record}, from_checkpoint(arrays), **measured))
            == expected
        )


# -- from the command line -------------------------------------------------------------------------

SCENE = """
box: {x: [0.0, 3.0], y: [0.0, 3.0], boundary: reflecting}
particles: 24
disks: {species: [{name: bath, count: rest, radius: 0.2, mass: 1.0}]}
velocities: {temperature: 1.0}
equilibrate: 1.0
duration: DURATION
"""
ASKED = [
    "--seeds",
    "3-5",
    "--record",
    "tracer,events",
    "--observables",
    "square_displacement",
    "--output",
    "x.h5",
]
KEPT = Path("x.h5.checkpoint")


@pytest.fixture(autouse=True)
def _scene(elsewhere):
    """Every test in a folder of its own, with a scene of a few blocks."""
    Path("some.yaml").write_text(SCENE.replace("DURATION", "70.0"))


@pytest.fixture(scope="module")
def of_early_end(tmp_path_factory):
    """The checkpoint of a run that ended early."""

    def die(*_, **__):
        raise KilledError

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("early"))
        patch.setattr("brownpipe.verbs.simulate.write_trajectories", die)
        Path("some.yaml").write_text(SCENE.replace("DURATION", "70.0"))
        with pytest.raises(KilledError):
            main(["simulate", "some.yaml", *ASKED, "--checkpoint-every", "1e-9"])
        return KEPT.read_bytes()


@pytest.fixture
def kept(of_early_end):
    """The same, in x.h5.checkpoint."""
    KEPT.write_bytes(of_early_end)
    return of_early_end


@pytest.mark.slow
def test_the_interval_changes_nothing_and_nothing_is_left(kept, said):
    Path("x.h5.checkpoint.brownpipe.part").write_bytes(
        b"of a process that was killed while it wrote"
    )
    assert said("simulate", "some.yaml", *ASKED, "--checkpoint-every", "1e6")[::2] == (DONE, "")
    first = Path("x.h5").read_bytes()
    assert sorted(os.listdir()) == ["some.yaml", "x.h5"]
    for more in ([], ["--checkpoint-every", "1e-9"], ["--checkpoint-every", "0.01"]):
        assert said("simulate", "some.yaml", *ASKED, *more)[::2] == (DONE, "")
        assert Path("x.h5").read_bytes() == first
        assert sorted(os.listdir()) == ["some.yaml", "x.h5"]


def test_without_the_option_a_checkpoint_is_left_alone(kept, said):
    assert said("simulate", "some.yaml", *ASKED)[::2] == (DONE, "")
    assert KEPT.read_bytes() == kept


@pytest.mark.slow
def test_killed_at_any_moment():
    """In the middle of a run, or, as a checkpoint is due at every block, most likely while one is
    written.
    """
    Path("some.yaml").write_text(SCENE.replace("DURATION", "6e3"))
    argv = ["simulate", "some.yaml", "--seeds", "3-4", "--output", "x.h5", "--checkpoint-every"]
    for seconds, delay in (("1e-9", 0.0), ("0.1", 0.05), ("1e-9", 0.0371)):
        before = KEPT.stat().st_mtime_ns if KEPT.exists() else 0
        process = get_context("fork").Process(target=main, args=([*argv, seconds],))
        process.start()
        while process.is_alive() and not (KEPT.exists() and KEPT.stat().st_mtime_ns > before):
            time.sleep(0.001)
        time.sleep(delay)
        process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL  # it was not at the end
    assert main([*argv, "0.5"]) == DONE
    interrupted = Path("x.h5").read_bytes()
    assert sorted(os.listdir()) == ["some.yaml", "x.h5"]
    assert main(argv[:-1]) == DONE
    assert Path("x.h5").read_bytes() == interrupted


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--seeds", "3-6", "seeds 3-5, not 3-6"),
        ("--record", "all,events", "record events,tracer, not all,events,tracer"),
        ("--observables", "species_energy", "observables square_displacement, not species_energy"),
        ("--average", "disks", "average runs, not disks"),
        ("scene", "71.0", "scene "),
        ("source", "0" * 64, "source "),
        ("numba", "0.0.1", f"numba {version('numba')}, not 0.0.1"),
    ],
)
def test_a_checkpoint_of_another_run(option, value, message, kept, said, monkeypatch):
    asked = [*ASKED, "--checkpoint-every", "60"]
    if option == "scene":
        Path("some.yaml").write_text(SCENE.replace("DURATION", value))
    elif option in ("source", "numba"):
        made_with, kinds = (
            provenance.made_with("simulate", "exact"),
            {"source": "digest", "numba": "version"},
        )
        monkeypatch.setattr(
            "brownpipe.verbs.simulate.made_with",
            lambda *_: made_with | {f"{option}_{kinds[option]}": value},
        )
    else:
        asked += [option, value]
    status, err = said("simulate", "some.yaml", *asked)[::2]
    assert status == WRONG_REQUEST
    assert err.startswith(f"brownpipe: x.h5.checkpoint: is of a run with {message}")
    assert err.endswith(
        "; repeat that command, delete this file to begin anew, or choose another --output\n"
    )
    assert err.count("\n") == 1
    assert KEPT.read_bytes() == kept
    assert not Path("x.h5").exists()


@pytest.mark.slow
def test_a_damaged_checkpoint(kept, said):
    damaged = [kept[: len(kept) // 2], kept[:-1], b"", kept + b"\0"]
    for bit in np.random.default_rng(3).integers(0, 8 * len(kept), 20).tolist():
        flipped = bytearray(kept)
        flipped[bit // 8] ^= 1 << bit % 8
        damaged.append(bytes(flipped))
    for contents in damaged:
        KEPT.write_bytes(contents)
        status, err = said("simulate", "some.yaml", *ASKED, "--checkpoint-every", "60")[::2]
        assert status == FAILED
        assert re.fullmatch(
            r"brownpipe: x\.h5\.checkpoint: [^\n]* delete it and run [^\n]* again\n", err
        )
        assert not Path("x.h5").exists()
