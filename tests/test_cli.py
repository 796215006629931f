"""The command line: what it does, what it says, and with which status it ends."""

import argparse
import contextlib
import errno
import io
import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from brownpipe import stages
from brownpipe.cli import build_parser, main
from brownpipe.engines import compiler
from brownpipe.engines.exact import simulation as exact
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, RunError
from brownpipe.storage.datasets import read_dataset
from brownpipe.storage.trajectories import read_trajectories
from brownpipe.verbs import VERBS

SCENES = Path(__file__).parent.parent / "config" / "scenes"
SCENE = str(SCENES / "harrison2020.yaml")
STUDY = str(SCENES.parent / "small.yaml")
STEP, LANGEVIN = ["--engine", "timestep", "--time-step", "0.01"], ["--engine", "langevin", "--friction"]


pytestmark = pytest.mark.usefixtures("elsewhere")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A trajectory file of three short runs."""
    path = tmp_path_factory.mktemp("runs") / "runs.h5"
    assert main(["simulate", SCENE, "--particles", "10", "--seeds", "0-2", "--output", str(path)]) == DONE
    return path


@pytest.fixture(scope="module")
def dataset(runs):
    path = runs.with_name("runs.nc")
    assert main(["aggregate", str(runs), "--output", str(path)]) == DONE
    return path


def said(capsys, *argv):
    """Exit status, standard output, and the one line on standard error."""
    try:
        status = main([str(word) for word in argv])
    except SystemExit as left:
        status = left.code
    out, err = capsys.readouterr()
    err = re.sub("^brownpipe: (compiling|waiting) .*\n", "", err, flags=re.MULTILINE)  # once per machine
    assert err.count("\n") <= 1
    assert "Traceback" not in err
    return status, out, err


# -- what it does ---------------------------------------------------------------------------------------------------


def test_simulate_writes_what_was_asked_for(runs):
    trajectories = read_trajectories(runs)
    assert trajectories.ensemble.seeds.tolist() == [0, 1, 2]
    assert trajectories.ensemble.tracer.position.shape == (101, 3, 2)
    assert (trajectories.scene.particles, trajectories.engine.name) == (10, "exact")


def ends_well(found, file="harrison2020.h5", runs="1 run"):
    """Whether `simulate` said nothing but, in one line, what it made."""
    status, out, err = found
    overlap = r"(?:, worst overlap [0-9.e-]+ contact distances)?"
    assert (status, err) == (DONE, "")
    return re.fullmatch(rf"{re.escape(file)}: {runs}{overlap}, [0-9.]+ (?:ms|s|min) of CPU\n", out)


def test_one_seed_again_is_the_same_to_the_bit(runs, capsys):
    assert ends_well(said(capsys, "simulate", SCENE, "--particles", 10, "--seeds", 2, "--record", "all,events"))
    again, before = read_trajectories("harrison2020.h5").ensemble, read_trajectories(runs).ensemble
    assert again.tracer.position[:, 0].tobytes() == before.tracer.position[:, 2].tobytes()
    assert again.whole[2].position[:, 0].tobytes() == again.tracer.position[:, 0].tobytes()
    assert len(again.events[2].time) == sum(again.observables[f"{kind}_collisions"][0] for kind in ("pair", "wall"))


@pytest.mark.parametrize("friction", ["enskog", "boltzmann"])
def test_the_command_in_a_file_names_engine_and_settings(friction, capsys):
    status, out, err = said(capsys, "simulate", SCENE, "--engine", "langevin", "--friction", friction)
    assert status == DONE and re.fullmatch(r"harrison2020\.h5: 1 run, [0-9.]+ m?s of CPU\n", out)
    assert "langevin is rough here: the tracer has only 2.5 times the mass of a bath disk" in err
    found = read_trajectories("harrison2020.h5")
    assert (found.engine.name, dict(found.engine.settings)) == ("langevin", {"friction": friction})
    assert found.header["command"].endswith(f"--engine langevin --friction {friction}")


def test_an_engine_gets_its_settings_and_no_other(capsys, monkeypatch, runs):
    """The engine of time steps stood in for: what it is called with and what the file says."""
    calls = []

    def simulate(scene, seeds, record, **given):
        calls.append((list(seeds), record, given))
        return read_trajectories(runs).ensemble

    monkeypatch.setattr("brownpipe.engines.timestep.simulation.simulate", simulate)
    asked = ["simulate", SCENE, "--particles", 10, "--seeds", "0-2", *STEP, "--output", "x.h5"]
    assert ends_well(said(capsys, *asked), "x.h5", "3 runs")
    nothing_measured = {"observables": (), "average": "runs"}
    settings = {"time_step": 0.01, "collisions": "at_contact"}
    assert calls == [([0, 1, 2], frozenset({"tracer"}), nothing_measured | settings)]
    assert dict(read_trajectories("x.h5").engine.settings) == settings
    command = read_trajectories("x.h5").header["command"]
    assert command.endswith("--engine timestep --time-step 0.01 --collisions at_contact")
    assert "engine       timestep" in said(capsys, "inspect", "x.h5")[1]


def test_a_long_batch_is_counted_on_a_terminal_alone(capsys, monkeypatch):
    """A clock that goes on by a second whenever it is read: every run is shown."""
    asked = ["simulate", SCENE, "--particles", "10", "--seeds", "0-3"]
    assert main(asked) == DONE
    assert "4 runs" not in capsys.readouterr().err
    ticks = itertools.count()
    monkeypatch.setattr("brownpipe.progress.time.monotonic", lambda: next(ticks))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    assert main(asked) == DONE
    shown = [text.strip() for text in capsys.readouterr().err.split("\r")]
    runs = [re.fullmatch(r"simulate: (\d) of 4 runs .*", text) for text in dict.fromkeys(shown) if "runs" in text]
    assert [found[1] for found in runs] == ["2", "3", "4"]  # after DELAY
    assert shown[-1] == ""
    assert stages.listeners == stages.remark_listeners == []


def test_what_is_compiled_is_said(capsys, monkeypatch, runs):
    def simulate(*_, **__):
        stages.remark("compiling the kernels for this kind of scene, once per machine: about 8 s")
        return read_trajectories(runs).ensemble

    monkeypatch.setattr(exact, "simulate", simulate)
    assert main(["simulate", SCENE, "--particles", "10", "--seeds", "0-2"]) == DONE
    line = "brownpipe: compiling the kernels for this kind of scene, once per machine: about 8 s\n"
    assert capsys.readouterr().err == line
    assert stages.remark_listeners == []


def test_record_none_keeps_the_observables(capsys):
    assert said(capsys, "simulate", SCENE, "--particles", 10, "--record", "none")[0] == DONE
    ensemble = read_trajectories("harrison2020.h5").ensemble
    assert ensemble.tracer is None
    assert ensemble.observables["pair_collisions"].shape == (1,)


def test_aggregate_and_figures(dataset, capsys):
    assert read_dataset(dataset).runs.values.tolist() == [[[3]]]
    assert said(capsys, "figures", dataset, "--output", "made/here", "--figures", "health")[::2] == (DONE, "")
    names = {path.name for path in Path("made/here").iterdir()}
    pictures = {f"health.{kind}" for kind in ("png", "svg", "csv")}
    assert names == pictures | {"summary.csv", "summary.txt", "provenance.json"}


def test_inspect(runs, dataset, capsys):
    status, out, err = said(capsys, "inspect", runs)
    assert (status, err) == (DONE, "")
    assert "seeds        0-2 (3 runs)" in out
    assert said(capsys, "inspect", dataset)[0] == DONE
    damaged = bytearray(runs.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    Path("damaged.h5").write_bytes(damaged)
    status, out, err = said(capsys, "inspect", "damaged.h5")
    assert (status, out) == (FAILED, "")
    assert "brownpipe: damaged.h5: was damaged" in err


@pytest.mark.parametrize("verb", VERBS)
def test_help_has_an_example_that_parses(verb, capsys):
    with pytest.raises(SystemExit) as left:
        main([verb, "--help"])
    assert left.value.code == DONE
    shown = " ".join(capsys.readouterr().out.split())
    example = shown.partition("example: brownpipe ")[2].split()
    assert example[0] == verb
    build_parser(example).parse_args(example)


def test_version(capsys):
    status, out, _ = said(capsys, "--version")
    assert status == DONE
    assert re.fullmatch(r"brownpipe \d+\.\d+\.\d+\n", out)


# -- what it refuses ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ([], "required: VERB"),
        (["simulat"], "invalid choice: 'simulat'"),
        (["simulate"], "required: SCENE"),
        (["simulate", "absent.yaml"], "absent.yaml: cannot be read: No such file or directory"),
        (["simulate", "."], ".: cannot be read: Is a directory"),
        (["simulate", SCENE, "--particles", "many"], "--particles: must be an integer, not 'many'"),
        (["simulate", SCENE, "--particles", "-1"], "--particles"),
        (["simulate", SCENE, "--particles", "5000"], "disks: 4999 disks of radius 0.1 (bath) cannot fit"),
        (["simulate", SCENE, "--seeds", "1-"], "seeds: must be seeds like 17, 0-2399 or 3,5,9, not '1-'"),
        (["simulate", SCENE, "--seeds", ""], "seeds: must be seeds"),
        (["simulate", SCENE, "--seeds", "9-3"], "seeds: must be ranges that ascend"),
        (["simulate", SCENE, "--seeds", "0-99999999999"], "seeds: must be at most 10000000 seeds"),
        (["simulate", SCENE, "--seeds", "99999999999999999999"], "seeds: must be seeds"),
        (["simulate", SCENE, "--record", "everything"], "--record everything: must be one or several of tracer, all"),
        (["simulate", SCENE, "--record", "none,all"], "--record none,all: must be one or several of"),
        (
            ["simulate", SCENE, "--engine", "timestp"],
            "--engine: must be 'exact', 'timestep' or 'langevin', not 'timestp'; did you mean",
        ),
        (["simulate", SCENE, "--engine", "timestep"], "--time-step: missing; must be given with --engine timestep"),
        (["simulate", SCENE, "--engine", "langevin"], "--friction: missing; must be given with --engine langevin"),
        (
            ["simulate", SCENE, "--time-step", "1e-3"],
            "--time-step 0.001: the exact engine has no such setting",
        ),
        (["simulate", SCENE, "--time-step", "0"], "--time-step: must be > 0, not 0"),
        (["simulate", SCENE, *STEP, "--collisions", "x"], "--collisions: must be 'at_contact' or 'late', not 'x'"),
        (["simulate", SCENE, *STEP, "--friction", "enskog"], "--friction enskog: the timestep engine has no such"),
        (["simulate", SCENE, *LANGEVIN, "stokes"], "--friction: must be 'enskog', 'boltzmann' or"),
        (["simulate", SCENE, *LANGEVIN, "enskog", "--collisions", "late"], "--collisions late: the langevin engine"),
        (
            ["simulate", SCENE, *LANGEVIN, "enskog", "--record", "all,events"],
            "--record all,events: the langevin",
        ),
        (
            ["simulate", SCENE, *LANGEVIN, "enskog", "--checkpoint-every", "9"],
            "--checkpoint-every 9: the langevin",
        ),
        (["simulate", SCENE, *STEP, "--checkpoint-every", "9"], "keeps no checkpoints; must go with exact"),
        (["simulate", SCENE, "--sed", "1"], "unrecognized arguments: --sed 1"),
        (["aggregate", "x.h5"], "required: --output"),
        (["aggregate", "x.h5", "--output", "a.nc", "--fit-windows", "1:0"], "must be T0:T1 with 0 <= T0 < T1"),
        (["aggregate", "x.h5", "--output", "a.nc", "--ring-width", "nan"], "--ring-width: must be a number, not 'nan'"),
        (["aggregate", "x.h5", "--output", "a.nc", "--displacement-times", "0"], "must be > 0, not 0"),
        (["aggregate", "x.h5", "--output", "a.nc", "--rings", "0"], "must be >= 1, not 0"),
        (["figures", "a.nc", "--output", "f", "--figures", "msds"], "--figures: "),
        (["check", "absent.yaml"], "absent.yaml: cannot be read"),
    ],
)
def test_wrong_requests(argv, message, capsys, tmp_path):
    status, out, err = said(capsys, *argv)
    assert (status, out) == (WRONG_REQUEST, "")
    assert err.startswith("brownpipe")
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_more_than_this_machine_can_hold(capsys, monkeypatch):
    pages = {"SC_PHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(os, "sysconf", pages.__getitem__)
    status, _, err = said(capsys, "simulate", SCENE, "--seeds", "0-9999999")
    assert status == WRONG_REQUEST
    assert "harrison2020: 10000000 runs need some 64.8 GB of memory, and this machine has 0.0041 GB: take fewer" in err


def test_figures_that_there_is_nothing_to_show_in(dataset, capsys):
    status, _, err = said(capsys, "figures", dataset, "--output", "f", "--figures", "scan")
    assert status == WRONG_REQUEST
    assert "scan: cannot be drawn from this dataset" in err
    assert said(capsys, "figures", dataset, "--output", "f", "--particles", 150)[0] == WRONG_REQUEST


def test_the_same_seed_twice(runs, capsys):
    status, _, err = said(capsys, "aggregate", runs, runs, "--output", "a.nc")
    assert status == WRONG_REQUEST
    assert "seed 0 is already in" in err


# -- what fails -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("file/x.h5", "file/x.h5: its folder cannot be made: File exists"),
        ("/proc/new/x.h5", "/proc/new/x.h5: its folder cannot be made"),
    ],
)
def test_a_place_that_cannot_be_written_to(output, message, capsys):
    Path("file").touch()
    status, _, err = said(capsys, "simulate", SCENE, "--particles", 10, "--output", output)
    assert status == FAILED
    assert message in err


@pytest.mark.parametrize("verb", [["aggregate", "x.h5", "--output", "a.nc"], ["figures", "x.h5", "--output", "f"]])
@pytest.mark.parametrize(("content", "expected"), [(None, WRONG_REQUEST), (b"", FAILED), (b"not HDF5", WRONG_REQUEST)])
def test_files_that_are_none(verb, content, expected, capsys):
    if content is not None:
        Path("x.h5").write_bytes(content)
    status, _, err = said(capsys, *verb)
    assert status == expected
    assert err.startswith("brownpipe: x.h5: ")
    assert ("delete it" in err) == (expected == FAILED)


def test_intact_files_of_the_other_kind_are_not_to_be_deleted(runs, dataset, capsys):
    for argv in (["aggregate", dataset, "--output", "a.nc"], ["figures", runs, "--output", "f"]):
        status, _, err = said(capsys, *argv)
        assert (status, "delete" in err) == (WRONG_REQUEST, False)
        assert "is a file of brownpipe, but not a" in err
    Path("dataset").write_bytes(dataset.read_bytes())
    assert "title " in said(capsys, "inspect", "dataset")[1]
    assert said(capsys, "inspect", "absent.nc") == (
        WRONG_REQUEST, "", "brownpipe: absent.nc: cannot be read: No such file or directory\n"
    )  # fmt: skip


def test_inputs_and_devices_are_not_replaced(runs, capsys):
    Path("scene.yaml").write_bytes(Path(SCENE).read_bytes())
    Path("runs.h5").write_bytes(runs.read_bytes())
    os.link("runs.h5", "same.h5")
    Path("folder").mkdir()
    for argv in (
        ["simulate", "scene.yaml", "--output", "scene.yaml"],
        ["aggregate", "runs.h5", "--output", "same.h5"],
        ["simulate", "scene.yaml", "--output", "/dev/null"],
        ["simulate", "scene.yaml", "--output", "folder"],
    ):
        status, _, err = said(capsys, *argv)
        assert status == WRONG_REQUEST
        assert "choose another name for the output" in err
    assert Path("runs.h5").read_bytes() == runs.read_bytes()
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["simulate", SCENE, "--output", "x.nc"], "x.nc: the output must end in .h5 or .hdf5, not '.nc'"),
        (["simulate", SCENE, "--output", "new/x.csv"], "new/x.csv: the output must end in .h5 or .hdf5, not '.csv'"),
        (["aggregate", "RUNS", "--output", "x.h5"], "x.h5: the output must end in .nc, not '.h5'"),
        (["tradeoff", STUDY, "--files", "RUNS", "--output", "x.csv"], "x.csv: the output must end in .nc, not '.csv'"),
        (["movie", "RUNS", "--output", "x.jpg"], "x.jpg: the output must end in .gif, .mp4, .png or .html, not '.jpg'"),
        (["movie", "RUNS", "--output", "x"], "x: the output must end in .gif, .mp4, .png or .html, not ''"),
        (
            ["plan", STUDY, "--tolerance", "2%", "--write", "x.txt"],
            "x.txt: the output must end in .yaml or .yml, not '.txt'",
        ),
        (
            ["figures", "x.nc", "--output", "msd.png"],
            "msd.png: the output must be a folder, not a name that ends in .png",
        ),
    ],
)
def test_an_output_of_another_kind_is_refused_before_anything_is_done(argv, message, capsys, runs, tmp_path):
    argv = [runs if word == "RUNS" else word for word in argv]
    assert said(capsys, *argv) == (WRONG_REQUEST, "", f"brownpipe: {message}\n")
    assert list(tmp_path.iterdir()) == []


def test_a_dot_in_a_name_is_no_suffix(capsys):
    for name in ("mass_0.5", "plain", "T1.5.h5", "LARGE.H5"):
        assert said(capsys, "simulate", SCENE, "--particles", 10, "--output", name)[0] == DONE
        assert Path(name).is_file()


def test_a_link_is_followed(capsys):
    os.symlink("there.h5", "link.h5")
    assert said(capsys, "simulate", SCENE, "--particles", 10, "--output", "link.h5")[0] == DONE
    assert Path("link.h5").is_symlink()
    assert read_trajectories("there.h5").scene.particles == 10


def test_a_list_of_disks_has_one_seed(capsys, tmp_path):
    scene = Path(__file__).parent / "scenes" / "pair_head_on.yaml"
    status, _, err = said(capsys, "simulate", scene, "--seeds", "0-49")
    assert status == WRONG_REQUEST
    assert "seeds: must be one seed, as the disks of pair_head_on are listed one by one" in err
    assert list(tmp_path.iterdir()) == []
    assert said(capsys, "simulate", scene, "--particles", 2, "--seeds", 7)[0] == DONE


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "utf-8:strict"])
def test_any_path_can_be_said(encoding, tmp_path):
    folder = os.fsencode(tmp_path) + b"/caf\xe9"
    os.mkdir(folder)
    Path(os.fsdecode(folder), "one.yaml").write_bytes(Path(SCENE).read_bytes())
    argv = [sys.executable, "-m", "brownpipe", "check", folder + b"/one.yaml"]
    done = subprocess.run(argv, env=os.environ | {"PYTHONIOENCODING": encoding}, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (DONE, b"")


def test_a_scene_can_be_what_a_command_prints(capsys):
    """As in `brownpipe check <(cat scene.yaml)`."""
    reading, writing = os.pipe()
    os.write(writing, Path(SCENE).read_bytes())
    os.close(writing)
    status, out, _ = said(capsys, "check", f"/dev/fd/{reading}")
    os.close(reading)
    assert status == DONE and "valid" in out


def test_main_can_be_called_where_output_is_redirected():
    """In a notebook or under redirect_stdout, sys.stdout is no file."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert main(["schema", "study"]) == DONE
    assert json.loads(printed.getvalue())


def test_a_file_larger_than_the_disk_is_refused_before_the_work(capsys, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: argparse.Namespace(free=1e6))
    monkeypatch.setattr(exact, "simulate", raises(AssertionError("begins the work")))
    status, _, err = said(capsys, "simulate", SCENE, "--seeds", "0-99999", "--output", "a.h5")
    assert status == FAILED and "there is room for 1 MB" in err and err.count("\n") == 1


def raises(error):
    def simulate(*_, **__):
        raise error

    return simulate


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (RunError("seed 3: no progress in time"), FAILED, "brownpipe: seed 3: no progress in time\n"),
        (MemoryError(), FAILED, "brownpipe: out of memory\n"),
        (OSError(errno.EIO, "Input/output error"), FAILED, "brownpipe: [Errno 5] Input/output error\n"),
        (KeyboardInterrupt(), 130, "brownpipe: interrupted\n"),
    ],
)
def test_a_run_that_ends_early(error, status, message, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(exact, "simulate", raises(error))
    assert said(capsys, "simulate", SCENE) == (status, "", message)
    assert list(tmp_path.iterdir()) == []


def test_a_fault_of_the_program_is_not_hidden(monkeypatch):
    monkeypatch.setattr(exact, "simulate", raises(ZeroDivisionError("a bug")))
    with pytest.raises(ZeroDivisionError, match="a bug"):
        main(["simulate", SCENE])


@pytest.mark.parametrize(("failed", "status"), [([1, 0, 1], DONE), ([1, 1, 1], FAILED)])
def test_runs_that_fail_their_health_check(runs, failed, status, capsys, monkeypatch):
    ensemble = read_trajectories(runs).ensemble
    marked = ensemble._replace(observables=ensemble.observables | {"failed": np.array(failed, np.uint8)})
    monkeypatch.setattr(exact, "simulate", lambda *_, **__: marked)
    found, _, err = said(capsys, "simulate", SCENE, "--particles", 10, "--seeds", "0-2", "--output", "x.h5")
    assert found == status
    assert f"x.h5: failed their health check: {sum(failed)} of 3 runs: 0" in err
    assert read_trajectories("x.h5").ensemble.observables["failed"].tolist() == failed


@pytest.mark.slow
@pytest.mark.parametrize(("sent", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_leaves_nothing_behind(sent, status):
    argv = [sys.executable, "-m", "brownpipe", "simulate", SCENE, "--seeds", "0-99999", "--output", "new/x.h5"]
    process = subprocess.Popen(argv, stderr=subprocess.PIPE, text=True)
    while not Path("new").exists():
        time.sleep(0.01)
    time.sleep(1.0)  # somewhere between the imports and the runs
    process.send_signal(sent)
    _, err = process.communicate(timeout=60)
    assert process.returncode == status
    assert re.fullmatch(r"brownpipe: (terminated|interrupted)\n", err)
    assert list(Path("new").iterdir()) == []


@pytest.mark.slow
def test_nobody_reads_on():
    argv = f"{sys.executable} -m brownpipe check {SCENE} | exec 0<&-; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", argv], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (FAILED, "")


# -- what it costs to start -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("from brownpipe import cli; cli.build_parser([])", {"numpy", "yaml", "numba", "h5py"}),
        ("import brownpipe.study, brownpipe.provenance", {"numba", "h5py", "scipy", "xarray", "matplotlib"}),
        (f"from brownpipe.cli import main; main(['simulate', {SCENE!r}])", {"xarray", "matplotlib", "scipy.stats"}),
    ],
)
def test_nothing_is_imported_that_is_not_needed(code, absent):
    assert absent & imported_by(code) == set()


def imported_by(code):
    code += "; import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.slow
@pytest.mark.skipif(not compiler.is_tested(), reason="this version of Numba imports scipy.linalg by itself")
def test_simulate_does_without_linear_algebra():
    """With every engine, all in one process: what is not imported in the end, none of them imports."""
    code = "from brownpipe.cli import main"
    for engine in ([], STEP, [*LANGEVIN, "enskog"]):
        code += f"; assert main({['simulate', SCENE, '--particles', '10', *engine]}) == 0"
    found = imported_by(code)
    assert "numba" in found
    assert "scipy.linalg" not in found


@pytest.mark.slow
@pytest.mark.parametrize("argv", [["inspect", "RUNS"], ["aggregate", "RUNS", "--output", "a.nc"]])
def test_files_are_read_without_numba(runs, argv):
    argv = [str(runs) if word == "RUNS" else word for word in argv]
    found = imported_by(f"from brownpipe.cli import main; assert main({argv}) == 0")
    assert "h5py" in found
    assert "numba" not in found


# -- a scene in place of a study, and the reverse -------------------------------------------------------------------

RUN_IT = f"{STUDY}: is a study, not a scene; run it with brownpipe run {STUDY}"
SIMULATE_IT = f"{SCENE}: is a scene, not a study; run it with brownpipe simulate {SCENE}, or list it in a study"
NO_RESULTS = "is not a trajectory file or dataset of brownpipe"


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["simulate", STUDY], RUN_IT),
        (["plan", SCENE, "--tolerance", "2%"], SIMULATE_IT),
        (["tradeoff", SCENE], SIMULATE_IT),
        (["aggregate", SCENE, "--output", "a.nc"], f"{SCENE}: {NO_RESULTS}"),
        (["figures", STUDY, "--output", "f"], f"{STUDY}: {NO_RESULTS}"),
        (["movie", SCENE], f"{SCENE}: {NO_RESULTS}"),
        (["inspect", STUDY], f"{STUDY}: {NO_RESULTS}"),
    ],
)
def test_a_file_of_the_other_kind_is_said_to_be_one(argv, message, capsys, tmp_path):
    assert said(capsys, *argv) == (WRONG_REQUEST, "", f"brownpipe: {message}\n")
    assert list(tmp_path.iterdir()) == []


def test_parts_of_a_scene_or_study_are_known_for_what_they_are(capsys):
    Path("study.yaml").write_text("seeds: 10\nparticles: 50\n")
    Path("scene.yaml").write_text("disks: []\nduration: 1\n")
    assert "study.yaml: is a study, not a scene" in said(capsys, "simulate", "study.yaml")[2]
    assert "scene.yaml: is a scene, not a study" in said(capsys, "plan", "scene.yaml", "--tolerance", "2%")[2]
    assert "study.yaml: line 1: scenes: missing; must be given" in said(capsys, "check", "study.yaml")[2]
    assert "scene.yaml: line 1: box: missing; must be given" in said(capsys, "check", "scene.yaml")[2]


def test_results_are_no_scene(runs, capsys):
    for verb in ("simulate", "check", "plan", "tradeoff"):
        status, _, err = said(capsys, verb, runs)
        assert (status, f"it is an HDF5 file: brownpipe inspect {runs}" in err) == (WRONG_REQUEST, True)


# -- mistakes in the command itself ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["simulat", SCENE], "invalid choice: 'simulat'; did you mean simulate? (choose from "),
        (
            ["simulate", SCENE, "--sedes", "3"],
            "brownpipe simulate: unrecognized arguments: --sedes 3; did you mean --seeds?",
        ),
        (
            ["simulate", SCENE, "--dt", "3"],
            "brownpipe simulate: unrecognized arguments: --dt 3 (see brownpipe simulate --h",
        ),
        (
            ["simulate", SCENE, "--seeds", "0-9", "17"],
            "arguments: 17; several values of an option are joined by commas",
        ),
        (["simulate", SCENE, "--record", "all", "events"], "events; several values of an option are joined by commas"),
        (["simulate", SCENE, "--time-step", "10ms"], "must be a number, not '10ms'; without quotes, unit or comma"),
        (["simulate", SCENE, "--time-step", "0,01"], "must be a number, not '0,01'; without quotes, unit"),
        (["figures", "a.nc", "--output", "f", "--figures", "msd,MSD"], "--figures: "),
        (["figures", "a.nc", "--output", "f", "--figures", "msd", "health"], "health; several values of an option are"),
        (["aggregate", "x.h5", "--output", "a.nc", "--study", STUDY], "files: must not be given with --study"),
        (
            ["tradeoff", STUDY],
            f"{STUDY}: has no results yet; run it first: brownpipe run {STUDY} (results/runs/harrison2020/N50/exact-",
        ),
        (["plan", STUDY, "--tolerance", "2%", "--write", "my study.yaml"], "--write: must be a name: letters, digits,"),
    ],
)
def test_common_mistakes_in_a_command_are_named(argv, message, capsys, tmp_path):
    status, out, err = said(capsys, *argv)
    assert (status, out) == (WRONG_REQUEST, "")
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_blanks_after_the_commas_of_a_list_do_no_harm(capsys):
    names = "species_energy, square_displacement"
    assert said(capsys, "simulate", SCENE, "--particles", 10, "--observables", names, "--output", "x.h5")[0] == DONE
