"""What a file meets: a full disk, a writer that is killed, flipped bits, cut and exchanged files.
None is silent.
"""

import os
import random
import resource
import shutil
import signal
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from brownpipe.cli import main
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST
from brownpipe.storage.files import write_file
from brownpipe.study import read_study
from brownpipe.study.run_sets import commands, files_of
from brownpipe.study.verification import verify_results
from pipeline import SCENE

RESULTS = Path("results/mine")
DATASET = f"{RESULTS}/aggregate/mine.nc"
FIGURES = f"{RESULTS}/figures"


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A folder with a finished study, made by the commands of the rules of the workflow."""
    folder = tmp_path_factory.mktemp("original")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("hot.yaml").write_text(SCENE)
        Path("mine.yaml").write_text("scenes: hot.yaml\nseeds: 4\nbatch: 2\nfigures: [health]\n")
        (command,) = commands(read_study("mine.yaml")).values()
        for file in files_of(read_study("mine.yaml")):
            words = ["--seeds", file.path.stem, "--output", str(file.path)]
            assert main(["simulate", *command.split(), *words]) == DONE
        listed = f"{RESULTS}/aggregate/made_from_0.txt"
        assert (
            main(["aggregate", "--study", "mine.yaml", "--output", DATASET, "--list-runs", listed])
            == DONE
        )
        page = ["--figures", "health", "--page", f"{RESULTS}/report.html"]
        assert main(["figures", DATASET, "--output", FIGURES, *page]) == DONE
        drawn = subprocess.run(
            ["sha256sum", DATASET, *Path(FIGURES).iterdir()], stdout=subprocess.PIPE, check=True
        )
        Path(FIGURES, "drawn_from_0.txt").write_bytes(drawn.stdout)
    return folder


@pytest.fixture
def study(original, tmp_path, monkeypatch):
    """A copy of the original, which is the working directory."""
    folder = shutil.copytree(original, tmp_path / "copy")
    monkeypatch.chdir(folder)
    return folder


# -- a full disk -----------------------------------------------------------------------------------


@contextmanager
def limited(size):
    """No file may be larger than `size` bytes, which to a program is as a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.slow
def test_without_space_there_is_one_line_and_no_half_a_file(study, faults, said):
    words = ["simulate", "hot.yaml", "--seeds", "0-1", "--output", "out/0-1.h5"]
    written = Path("out/0-1.h5")
    assert main(words) == DONE
    expected = written.read_bytes()
    shutil.rmtree("out")
    with limited(faults.random.randint(0, int(1.2 * len(expected)))):
        status, _, err = said(*words)
    assert not list(Path().rglob("*.part"))
    assert status == DONE or "not written: File too large" in err.splitlines()[-1], err
    assert written.read_bytes() == expected if written.exists() else status == FAILED


@pytest.mark.slow
def test_figures_that_cannot_all_be_written_replace_none(study, said):
    """They would be of another dataset than the rest of the folder."""

    def there():
        return {
            path: (path.stat().st_mtime_ns, path.read_bytes()) for path in Path(FIGURES).iterdir()
        }

    before = there()
    least = max(len(contents) for _, contents in before.values())
    with limited(least - 1):
        status, _, err = said("figures", DATASET, "--output", FIGURES, "--figures", "health,msd")
    assert status != DONE and "not written: File too large" in err
    assert before == there()


# -- writers ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_killed_writers_leave_the_old_file_and_the_next_one_no_litter(faults, tmp_path):
    contents = [bytes([k]) * 300_000 for k in range(2)]
    write_file(tmp_path / "x", contents[0])
    for _ in range(20):
        child = os.fork()
        if child == 0:
            while True:
                for each in contents:
                    write_file(tmp_path / "x", each)
        time.sleep(faults.random.uniform(0.0, 0.02))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        assert (tmp_path / "x").read_bytes() in contents
        write_file(tmp_path / "x", contents[0])
        assert os.listdir(tmp_path) == ["x"]


def test_a_file_is_on_disk_before_it_has_its_name(monkeypatch, tmp_path):
    """Else a power cut may leave an empty file under the name of a whole one."""
    calls = []
    replace = os.replace
    monkeypatch.setattr(os, "fsync", lambda number: calls.append(os.fstat(number).st_ino))
    monkeypatch.setattr(
        os, "replace", lambda old, new: (calls.append("renamed"), replace(old, new))
    )
    write_file(tmp_path / "x", b"contents")
    assert "renamed" in calls[1:] and calls[0] == (tmp_path / "x").stat().st_ino


# -- damage, as `brownpipe verify` finds it --------------------------------------------------------


def sealed():
    return [DATASET, *map(str, sorted(Path("results/runs").rglob("*.h5")))]


def flip(path, chance):
    data = bytearray(path.read_bytes())
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


def cut(path, chance):
    os.truncate(path, chance.randrange(path.stat().st_size))


def append(path, chance):
    with open(path, "ab") as file:
        file.write(chance.randbytes(chance.choice([1, 7, 4096])))


@pytest.mark.slow
def test_any_damage_is_found_and_nothing_else(study, faults):
    drawn = [str(path) for path in Path(FIGURES).iterdir() if path.name != "drawn_from_0.txt"]
    assert verify_results(RESULTS) == (sorted([*sealed(), *drawn]), [], [])
    for harm in (flip, cut, append) * 4:
        file = faults.random.choice(sealed())
        before = Path(file).read_bytes()
        harm(Path(file), faults.random)
        assert verify_results(RESULTS)[1] == [file], faults.seed
        Path(file).write_bytes(before)
    first, second = map(Path, sealed()[1:])
    contents = first.read_bytes()
    first.write_bytes(second.read_bytes())  # exchanged
    second.write_bytes(contents)
    assert verify_results(RESULTS)[1] == [str(first), str(second)]


@pytest.mark.slow
def test_what_is_wrong_is_said(study, capsys):
    _, first, second = sealed()
    made_from = next((RESULTS / "aggregate").glob("made_from_*.txt"))
    drawn_from, summary = (
        RESULTS / "figures" / name for name in ("drawn_from_0.txt", "summary.txt")
    )
    for damaged, contents in (
        (summary, "0.1"),
        (made_from, "runs/no seeds\n"),
        (made_from, ""),
        (drawn_from, "a"),
    ):
        before = damaged.read_text()
        damaged.write_text(contents)
        assert verify_results(RESULTS)[1] == [str(damaged)]
        damaged.write_text(before)
    assert main(["verify", DATASET, first]) == DONE
    assert capsys.readouterr().out.splitlines() == [f"{DATASET}: intact", f"{first}: intact"]
    flip(Path(first), random.Random(1))
    assert main(["verify", DATASET, first]) == FAILED
    assert f"{first}: " in capsys.readouterr().err
    for absent in (DATASET, RESULTS / "figures/health.png", second):
        Path(absent).unlink()
    for folder in (str(RESULTS), f"../{study.name}/results"):
        assert main(["verify", folder]) == FAILED
        assert capsys.readouterr().out.splitlines() == [
            f"{first}: is damaged; delete it and run the study again",
            f"{DATASET}: is missing; run the study again",
            f"{RESULTS}/figures/health.png: is missing; run the study again",
            f"{Path(first).parent}: seeds 2-3: is missing; run the study again",
            f"{folder}: {len([*Path(FIGURES).iterdir()]) - 1} intact, 1 damaged, 3 missing",
        ]


@pytest.mark.parametrize("folder", ["absent", "."])
def test_what_is_no_folder_of_results_is_refused(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["verify", folder]) == WRONG_REQUEST
