"""The command line: what it does, what it says, and with which status it ends."""

import argparse
import errno
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import brownpipe as bp
from brownpipe.cli import build_parser, main
from brownpipe.engines import forecast
from brownpipe.engines.exact import simulation as exact
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, RequestError, RunError
from brownpipe.storage.trajectories import read_trajectories
from brownpipe.text import printable
from brownpipe.verbs import VERBS

SCENES = Path(__file__).parent.parent / "config" / "scenes"
SCENE = str(SCENES / "harrison2020.yaml")
STUDY = str(SCENES.parent / "small.yaml")
COMPARED = str(SCENES.parent / "tradeoff.yaml")
STEP_ONLY = 'engines=[{"name": "timestep", "time_step": 0.01}]'
PAIR = str(Path(__file__).parent / "scenes" / "pair_head_on.yaml")
STEP = ["--engine", "timestep", "--time-step", "0.01"]
LANGEVIN = ["--engine", "langevin", "--friction"]
pytestmark = pytest.mark.usefixtures("elsewhere")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A trajectory file of three short runs."""
    path = tmp_path_factory.mktemp("runs") / "runs.h5"
    assert (
        main(["simulate", SCENE, "--particles", "10", "--seeds", "0-2", "--output", str(path)])
        == DONE
    )
    return path


@pytest.fixture(scope="module")
def dataset(runs):
    path = runs.with_name("runs.nc")
    assert main(["aggregate", str(runs), "--output", str(path)]) == DONE
    return path


# -- what it does ----------------------------------------------------------------------------------


def test_simulate_writes_what_was_asked_for_and_one_seed_again_to_the_bit(runs, said):
    before = read_trajectories(runs)
    assert (before.scene.particles, before.engine.name) == (10, "exact")
    assert before.ensemble.seeds.tolist() == [0, 1, 2]
    assert before.ensemble.tracer.position.shape == (101, 3, 2)
    status, out, err = said(
        "simulate", SCENE, "--particles", 10, "--seeds", 2, "--record", "all,events"
    )
    assert (status, err) == (DONE, "") and re.fullmatch(
        r"harrison2020\.h5: seed 2, 1 run, .* of CPU; 2 runs: --seeds 0-1\n", out
    )
    again = read_trajectories("harrison2020.h5").ensemble
    tracer = again.tracer.position[:, 0]
    assert tracer.tobytes() == before.ensemble.tracer.position[:, 2].tobytes()
    assert again.whole[2].position[:, 0].tobytes() == tracer.tobytes()
    pairs = again.observables["pair_collisions"][0]
    walls = again.observables["wall_collisions"][0]
    assert len(again.events[2].time) == pairs + walls


def test_every_verb_is_in_the_list():
    """One that is not could not be called."""
    listed = []
    for verbs_of_module in dict.fromkeys(VERBS.values()):
        listed += [verb.name for verb in verbs_of_module()]
    assert listed == [*VERBS]


def test_help_says_of_each_verb_what_it_does_in_a_whole_sentence(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    listed = capsys.readouterr().out.partition("VERB\n")[2].partition("\n\n")[0]
    described = re.split(r"^    (\w+)\s+", listed, flags=re.MULTILINE)[1:]
    assert described[::2] == [*VERBS]
    assert all(text.strip().endswith((".", ").")) for text in described[1::2])


@pytest.mark.parametrize("verb", VERBS)
def test_help_has_an_example_that_parses(verb, capsys):
    with pytest.raises(SystemExit) as left:
        main([verb, "--help"])
    assert left.value.code == DONE
    example = " ".join(capsys.readouterr().out.split()).partition("example: brownpipe ")[2].split()
    assert example[0] == verb
    build_parser(example).parse_args(example)


def test_a_dot_in_a_name_is_no_suffix_and_a_link_is_followed(said):
    os.symlink("there.h5", "link.h5")
    for name in ("mass_0.5", "T1.5.h5", "link.h5"):
        assert said("simulate", SCENE, "--particles", 10, "--output", name)[0] == DONE
        assert Path(name).is_file()
    assert Path("link.h5").is_symlink() and read_trajectories("there.h5").scene.particles == 10


@pytest.mark.slow
def test_nobody_reads_on():
    argv = f"{sys.executable} -m brownpipe check {SCENE} | exec 0<&-; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", argv], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (FAILED, "")


# -- what it refuses -------------------------------------------------------------------------------

RUN_IT = f"{STUDY}: is a study, not a scene; run it with brownpipe run {STUDY}"
SIMULATE_IT = (
    f"{SCENE}: is a scene, not a study; run it with brownpipe simulate {SCENE}, or list it in a "
    "study"
)
NO_RESULTS = "is no trajectory file or dataset of brownpipe"
COMMAS = "several values of an option are joined by commas"


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        # arguments
        ([], "required: VERB"),
        (["simulat", SCENE], "invalid choice: 'simulat'; did you mean simulate? (choose from "),
        (
            ["simulate", SCENE, "--particles", "many"],
            "--particles: must be a valid integer, not 'many'",
        ),
        (
            ["simulate", SCENE, "--particles", "5000"],
            "disks: 5000 disks cover 4.37 times the area of the box",
        ),
        (
            ["simulate", SCENE, "--seeds", "9-3"],
            "seeds: must be seeds like 17, 0-2399 or 3,5,9, ascending",
        ),
        (
            ["simulate", PAIR, "--seeds", "0-49"],
            "seeds: must be one seed, as the disks of pair_head_on have given velocities",
        ),
        (
            ["simulate", SCENE, "--record", "everything"],
            "--record: must be none, or one or several of tracer, all, events, velocity, with "
            "commas, not 'everything'",
        ),
        (
            ["simulate", SCENE, "--engine", "timestp"],
            "--engine: must be 'exact', 'timestep' or 'langevin', not",
        ),
        (
            ["simulate", SCENE, "--engine", "timestep"],
            "--time-step: missing; must be given with --engine timestep",
        ),
        (
            ["simulate", SCENE, "--time-step", "1e-3"],
            "--time-step 0.001: the exact engine has no such setting",
        ),
        (
            ["simulate", SCENE, *STEP, "--collisions", "x"],
            "--collisions: must be 'at_contact' or 'late', not 'x'",
        ),
        (
            ["simulate", SCENE, *STEP, "--checkpoint-every", "9"],
            "--checkpoint-every: must go with exact",
        ),
        (
            ["simulate", SCENE, *LANGEVIN, "enskog", "--record", "all,events"],
            "--record all,events: the langevin",
        ),
        (
            ["simulate", SCENE, "--sedes", "3"],
            "unrecognized arguments: --sedes 3; did you mean --seeds?",
        ),
        (
            ["simulate", SCENE, "--dt", "3"],
            "unrecognized arguments: --dt 3 (see brownpipe simulate --h",
        ),
        (["simulate", SCENE, "--seeds", "0-9", "17"], COMMAS),
        (
            ["aggregate", "x.h5", "--output", "a.nc", "--fit-windows", "1:0"],
            "--fit-windows: must be [t0, t1] with t0",
        ),
        (
            ["aggregate", "x.h5", "--output", "a.nc", "--study", STUDY],
            "files: must not be given with --study",
        ),
        (["figures", "a.nc", "--output", "f", "--figures", "msds"], "--figures: "),
        (
            ["plan", STUDY, "--tolerance", "2%", "--write", "my study.yaml"],
            "--write: must be a name: letters, digits,",
        ),
        # files of another kind
        (["simulate", "absent.yaml"], "absent.yaml: cannot be read: No such file or directory"),
        (["simulate", STUDY], RUN_IT),
        (["tradeoff", SCENE], SIMULATE_IT),
        (
            ["tradeoff", COMPARED],
            f"{COMPARED}: has no results yet; run it first: brownpipe run {COMPARED}",
        ),
        (["aggregate", SCENE, "--output", "a.nc"], NO_RESULTS),
        (
            ["aggregate", "a.h5", "--output", "a.nc", "--fit-windows", "3-12"],
            "argument --fit-windows: must be T0:T1, not '3-12'",
        ),
        (["verify", SCENE], f"harrison2020.yaml: {NO_RESULTS}"),
        (["aggregate", "DATASET", "--output", "a.nc"], "not a trajectory file"),
        (["figures", "RUNS", "--output", "f"], "not a dataset"),
        (["simulate", "RUNS"], "it is an HDF5 file: brownpipe inspect "),
        # what is in them
        (["aggregate", "RUNS", "RUNS", "--output", "a.nc"], "seed 0 is already in"),
        (
            ["figures", "DATASET", "--output", "f", "--figures", "scan"],
            "scan: cannot be drawn from this dataset",
        ),
        (["figures", "DATASET", "--output", "f", "--particles", "150"], "150"),
        (
            ["figures", "DATASET", "--output", "f", "--panel", "mass"],
            "panel: must be of scene, particles, engine",
        ),
        *(
            (
                ["tradeoff", study, "--config", key],
                "has no trade-off; must have record: tracer, two seeds or more, the",
            )
            for study, key in (
                (STUDY, "seeds=9"),
                *((COMPARED, key) for key in ("record=none", "seeds=1", STEP_ONLY)),
            )
        ),
        (
            ["tradeoff", COMPARED, "--fit-window", "5:60"],
            "fit window [5, 60]: must end by 25, when the longest run",
        ),
        # outputs of another kind
        (
            ["simulate", SCENE, "--output", "new/x.csv"],
            "new/x.csv: the output must end in .h5 or .hdf5, not '.csv'",
        ),
        (["aggregate", "RUNS", "--output", "x.h5"], "x.h5: the output must end in .nc, not '.h5'"),
        (
            ["movie", "RUNS", "--output", "x"],
            "x: the output must end in .gif, .png or .html, not ''",
        ),
        (["figures", "x.nc", "--output", "msd.png"], "msd.png: the output must be a folder"),
    ],
)
def test_wrong_requests_are_refused_in_one_line_and_nothing_is_written(
    argv, message, said, runs, dataset, tmp_path
):
    status, out, err = said(*({"RUNS": runs, "DATASET": dataset}.get(word, word) for word in argv))
    assert (status, out) == (WRONG_REQUEST, "")
    assert (
        err.startswith("brownpipe")
        and message in err
        and "delete" not in err
        and err.count("\n") == 1
    )
    assert list(tmp_path.iterdir()) == []


def test_no_character_that_a_terminal_obeys_is_shown(said):
    """Of keys, values and names of files."""
    everything = "".join(map(chr, [*range(0x10000), 0x1D173, 0xE0001, 0xE0100, 0x10FFFF]))
    assert printable(everything).isprintable() and not set(printable(everything)) & set(
        "\x1b\x9b\x00\xad\ud800\u202e"
    )
    for text in ('"\x1b[2J\\r": 1', 'box: "\x1b[2J\u202e"', "\x1b[2J: ]"):
        Path("\x1b[2J\r.yaml").write_text(text)
        _, out, err = said("check", "\x1b[2J\r.yaml")
        assert [char for char in out + err if char != "\n" and not char.isprintable()] == []


def test_more_than_memory_and_disk_can_hold(said, monkeypatch):
    monkeypatch.setattr(exact, "simulate", raises(AssertionError("begins the work")))
    with monkeypatch.context() as patch:
        patch.setattr("shutil.disk_usage", lambda _: argparse.Namespace(free=1e6))
        status, _, err = said("simulate", SCENE, "--seeds", "0-99999", "--output", "a.h5")
        assert status == FAILED and "there is room for 1 MB" in err
    monkeypatch.setattr(os, "sysconf", {"SC_PHYS_PAGES": 1000, "SC_PAGESIZE": 4096}.__getitem__)
    status, _, err = said("simulate", SCENE, "--seeds", "0-9999999")
    assert status == WRONG_REQUEST and "and this machine has 4.1 MB: take fewer" in err


def test_where_the_system_does_not_tell_its_memory_no_request_is_too_large(monkeypatch):
    monkeypatch.setattr(os, "sysconf", raises(ValueError("unrecognized configuration name")))
    assert forecast.machine_memory() == math.inf


def test_inputs_folders_and_files_of_others_are_not_replaced(runs, said):
    Path("scene.yaml").write_bytes(Path(SCENE).read_bytes())
    Path("runs.h5").write_bytes(runs.read_bytes())
    os.link("runs.h5", "same.h5")
    assert said("aggregate", "runs.h5", "--output", "runs.nc")[0] == DONE
    Path("study.yaml").write_text("scenes: scene.yaml\nparticles: 10\ntolerance: 50%\n")
    for name in ("mine.h5", "mine.nc", "runs.csv", "runs.gif", "mine.xyz", "mine.html", "mine.png"):
        h5py.File(name, "w").create_dataset("x", data=1).file.close()
    before = {path: path.read_bytes() for path in Path().iterdir()}
    Path("folder").mkdir()
    for argv in (
        ["simulate", "scene.yaml", "--output", "scene.yaml"],
        ["aggregate", "runs.h5", "--output", "same.h5"],
        ["simulate", "scene.yaml", "--output", "folder"],
        ["simulate", "scene.yaml", "--output", "mine.h5"],
        ["aggregate", "runs.h5", "--output", "mine.nc"],
        ["plan", "study.yaml", "--count", "scene.yaml"],
        ["export", "runs.h5", "--to", "csv"],
        ["export", "runs.h5", "--to", "xyz", "--output", "mine.xyz"],
        ["movie", "runs.h5"],
        ["movie", "runs.h5", "--output", "runs.gif"],
        ["movie", "runs.h5", "--output", "mine.png"],
        ["movie", "runs.h5", "--output", "mine.html"],
        ["figures", "runs.nc", "--output", "folder", "--page", "mine.html"],
    ):
        status, _, err = said(*argv)
        assert status == WRONG_REQUEST and "choose another name for the output" in err
    with pytest.raises(RequestError, match=r"mine\.h5: is no file of brownpipe"):
        bp.save(bp.open("runs.h5"), "mine.h5")
    assert {path: path.read_bytes() for path in Path().iterdir() if path.is_file()} == before


# -- what fails ------------------------------------------------------------------------------------


@pytest.mark.parametrize("output", ["file/x.h5", "/proc/new/x.h5"])
def test_a_place_that_cannot_be_written_to(output, said):
    Path("file").touch()
    status, _, err = said("simulate", SCENE, "--particles", 10, "--output", output)
    assert status == FAILED and f"{output}: its folder cannot be made" in err


@pytest.mark.parametrize(
    "verb", [["aggregate", "x.h5", "--output", "a.nc"], ["figures", "x.h5", "--output", "f"]]
)
@pytest.mark.parametrize(
    ("content", "expected"),
    [(None, WRONG_REQUEST), (b"", FAILED), (b"not HDF5", WRONG_REQUEST), ("flipped", FAILED)],
)
def test_files_that_are_none_or_damaged(verb, content, expected, said, runs):
    if content == "flipped":
        content = bytearray(runs.read_bytes())
        content[len(content) // 2] ^= 1
    if content is not None:
        Path("x.h5").write_bytes(content)
    status, _, err = said(*verb)
    assert status == expected
    assert err.startswith("brownpipe: x.h5: ")
    assert ("delete it" in err) == (expected == FAILED)


def raises(error):
    def simulate(*_, **__):
        raise error

    return simulate


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (
            RunError("seed 3: no progress in time"),
            FAILED,
            "brownpipe: seed 3: no progress in time\n",
        ),
        (MemoryError(), FAILED, "brownpipe: out of memory\n"),
        (
            OSError(errno.EIO, "Input/output error"),
            FAILED,
            "brownpipe: [Errno 5] Input/output error\n",
        ),
        (KeyboardInterrupt(), 130, "brownpipe: interrupted\n"),
    ],
)
def test_a_run_that_ends_early(error, status, message, said, monkeypatch, tmp_path):
    monkeypatch.setattr(exact, "simulate", raises(error))
    assert said("simulate", SCENE) == (status, "", message)
    assert list(tmp_path.iterdir()) == []


def test_a_fault_of_the_program_is_not_hidden(monkeypatch):
    monkeypatch.setattr(exact, "simulate", raises(ZeroDivisionError("a bug")))
    with pytest.raises(ZeroDivisionError, match="a bug"):
        main(["simulate", SCENE])


@pytest.mark.parametrize(("failed", "status"), [([1, 0, 1], DONE), ([1, 1, 1], FAILED)])
def test_runs_that_fail_their_health_check(runs, failed, status, said, monkeypatch):
    ensemble = read_trajectories(runs).ensemble
    marked = ensemble._replace(
        observables=ensemble.observables | {"failed": np.array(failed, np.uint8)}
    )
    monkeypatch.setattr(exact, "simulate", lambda *_, **__: marked)
    found, _, err = said("simulate", SCENE, "--particles", 10, "--seeds", "0-2", "--output", "x.h5")
    assert found == status
    assert f"x.h5: failed their health check: {sum(failed)} of 3 runs: 0" in err
    assert read_trajectories("x.h5").ensemble.observables["failed"].tolist() == failed


# -- what it costs to start ------------------------------------------------------------------------

COMMANDS = "from brownpipe.cli import main; assert [*map(main, {})] == {}"
TEN = ["simulate", SCENE, "--particles", "10", "--output", "x.h5"]
ALL_ENGINES = [[*TEN, *engine] for engine in ([], STEP, [*LANGEVIN, "enskog"])]
READERS = [["inspect", "RUNS"], ["aggregate", "RUNS", "--output", "a.nc"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "absent"),
    [
        (
            "from brownpipe import cli; cli.build_parser([])",
            {"numba", "xarray", "scipy", "matplotlib", "pandas"},
        ),
        ("import brownpipe.cli", {"numpy"}),
        (
            "import brownpipe.study, brownpipe.provenance",
            {"numba", "h5py", "scipy", "xarray", "matplotlib"},
        ),
        (COMMANDS.format(ALL_ENGINES, [0, 0, 0]), {"xarray", "matplotlib", "scipy.stats"}),
        (COMMANDS.format(READERS, [0, 0]), {"numba"}),
    ],
    ids=["parser", "command line", "study", "simulate", "inspect and aggregate"],
)
def test_nothing_is_imported_that_is_not_needed(code, absent, runs):
    code = code.replace("RUNS", str(runs)) + "; import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert absent & set(done.stdout.splitlines()[-1].split()) == set()


COMMAND_OF_ITS_OWN = """
import os, sys
from brownpipe.cli import main
sys.argv = ["brownpipe", "aggregate", "{runs}", "--output", "{dataset}"]
assert main() == 0
print(len(os.listdir("/proc/self/task")))
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted in /proc")
@pytest.mark.skipif(os.cpu_count() == 1, reason="linear algebra has one thread anyway")
def test_a_command_calculates_in_one_thread(runs, tmp_path):
    # OpenBLAS reads the number of its threads when NumPy is imported: a NumPy imported before it
    # is set cost an `aggregate` of 8 cases 1.5 s of CPU
    code = COMMAND_OF_ITS_OWN.format(runs=runs, dataset=tmp_path / "a.nc")
    environment = {name: os.environ[name] for name in os.environ if name != "OPENBLAS_NUM_THREADS"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "1"
