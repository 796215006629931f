"""`brownpipe verify`: every damaged or missing file is named."""

import os
import random
import shutil
from pathlib import Path

import pytest

from brownpipe.cli import main
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST
from brownpipe.study import read_study
from brownpipe.study.run_sets import files_of
from brownpipe.study.verification import verify_results

SCENE = """\
box: {x: [-3.0, 3.0], y: [-3.0, 3.0]}
particles: 6
disks:
  tracer: {radius: 0.3, mass: 1.0}
  species: [{name: bath, count: rest, radius: 0.1, mass: 0.4}]
velocities: {temperature: 1.6}
duration: 0.4
sample_interval: 0.1
"""
RESULTS = Path("results/mine")


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A folder with a finished study, made by the commands of the rules of the workflow."""
    folder = tmp_path_factory.mktemp("verified")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("hot.yaml").write_text(SCENE)
        Path("mine.yaml").write_text("scenes: hot.yaml\nseeds: 4\nbatch: 2\nfigures: [health]\n")
        for file in files_of(read_study("mine.yaml")):
            words = ["--seeds", f"{file.first}-{file.last}", "--output", str(file.path), "--planned", file.digest]
            assert main(["simulate", "hot.yaml", "--particles", "6", *words]) == DONE
        dataset, listed = f"{RESULTS}/aggregate/mine.nc", f"{RESULTS}/aggregate/made_from_0.txt"
        assert main(["aggregate", "--study", "mine.yaml", "--output", dataset, "--list-runs", listed]) == DONE
        page = ["--figures", "health", "--page", f"{RESULTS}/report.html"]
        assert main(["figures", dataset, "--output", f"{RESULTS}/figures", *page]) == DONE
    return folder


def sealed():
    return [str(RESULTS / "aggregate/mine.nc"), *map(str, sorted(Path("results/runs").rglob("*.h5")))]


@pytest.fixture
def study(original, tmp_path, monkeypatch):
    """A copy of the original, which is the working directory."""
    folder = shutil.copytree(original, tmp_path / "copy")
    monkeypatch.chdir(folder)
    return folder


def flip(path, chance):
    data = bytearray(path.read_bytes())
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


def cut(path, chance):
    os.truncate(path, chance.randrange(path.stat().st_size))


def append(path, chance):
    with open(path, "ab") as file:
        file.write(chance.randbytes(chance.choice([1, 7, 4096])))


def test_any_damage_is_found_and_nothing_else(study, faults):
    assert verify_results(RESULTS) == (sealed(), [], [])
    for _ in faults.tries(30):
        file = faults.random.choice(sealed())
        before = Path(file).read_bytes()
        faults.random.choice((flip, cut, append))(Path(file), faults.random)
        assert verify_results(RESULTS)[1] == [file], faults.seed
        Path(file).write_bytes(before)


def test_what_is_wrong_is_said(study, capsys):
    _, first, second = sealed()
    (RESULTS / "figures/health.png").unlink()
    Path(second).unlink()
    Path(first).write_bytes(b"")
    assert main(["verify", str(RESULTS)]) == FAILED
    assert capsys.readouterr().out.splitlines() == [
        f"{first}: is damaged; delete it and run the study again",
        f"{RESULTS}/figures/health.png: is missing; run the study again",
        f"{Path(first).parent}: seeds 2-3: is missing; run the study again",
        f"{RESULTS}: 1 intact, 1 damaged, 2 missing",
    ]


def test_files_that_were_exchanged_are_damaged(study):
    first, second = sorted(Path("results/runs").rglob("*.h5"))
    contents = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(contents)
    assert verify_results(RESULTS)[1] == [str(first), str(second)]


def test_single_files_can_be_verified(study, capsys):
    dataset, first, _ = sealed()
    assert main(["verify", dataset, first]) == DONE
    assert capsys.readouterr().out.splitlines() == [f"{dataset}: intact", f"{first}: intact"]
    flip(Path(first), random.Random(1))
    assert main(["verify", dataset, first]) == FAILED
    assert f"{first}: " in capsys.readouterr().err


@pytest.mark.parametrize("folder", ["absent", "."])
def test_what_is_no_folder_of_results_is_refused(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["verify", folder]) == WRONG_REQUEST
