"""Every benchmark runs to its end: a quick pass of each. Hashes of runs change with the numbers and nothing else."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import forked
from brownpipe.tradeoff import timing

ROOT = Path(__file__).parent.parent
BENCHMARKS = sorted((ROOT / "benchmarks").glob("*.py"))
pytestmark = pytest.mark.slow


def docs():
    """When each file of docs/ was last written."""
    return {path: path.stat().st_mtime_ns for path in (ROOT / "docs").rglob("*") if path.is_file()}




@pytest.mark.parametrize("path", BENCHMARKS, ids=lambda path: path.stem)
def test_a_quick_pass_reports_and_leaves_the_tables_of_docs_alone(path, monkeypatch, capfd):
    """As `python benchmarks/bench_x.py --quick` does, in the process of the tests, which has imported what it takes.

    Plans time their engines for a tenth of the usual time. The commands of a whole study are forked processes.
    """
    before, run = docs(), subprocess.run

    def forked_run(words, env=os.environ, **more):
        return run(words, env=env | {"PATH": f"{forked.programs()}:{env['PATH']}"}, **more)

    monkeypatch.setattr(subprocess, "run", forked_run)
    monkeypatch.setattr(timing, "LEAST", timing.LEAST / 10)
    monkeypatch.setattr(sys, "argv", [str(path), "--quick"])
    monkeypatch.syspath_prepend(path.parent)
    monkeypatch.chdir(ROOT)
    runpy.run_path(str(path), run_name="__main__")
    assert any(character.isdigit() for character in capfd.readouterr().out)
    assert docs() == before


@pytest.fixture(scope="module")
def hash_runs():
    """The names of benchmarks/hash_runs.py."""
    return runpy.run_path(str(ROOT / "benchmarks" / "hash_runs.py"))


def hashes(hash_runs, path, **datasets):
    """Hashes of a trajectory file with these variables, and with what is not hashed."""
    with h5py.File(path, "w") as file:
        file.attrs["runs_digest"] = str(path)
        for name, value in {"seed": [0], "stopped": np.array([""], h5py.string_dtype()), **datasets}.items():
            file[name] = value
            file[name].attrs["made"] = str(path)
        file["seed"].make_scale("seed")
    return hash_runs["hashes_of"](path)


def test_hashes_are_of_values_types_and_shapes_alone(hash_runs, tmp_path):
    values = np.array([[0.0, 1.0], [2.0, np.nan]])
    first = hashes(hash_runs, tmp_path / "first.h5", image=values, position=values)
    assert first == hashes(hash_runs, tmp_path / "second.h5", image=values, position=values)
    assert first.keys() == {"image", "position", "stopped"}
    others = [np.nextafter(values, 3.0), values.astype(np.float32), values.ravel(), np.where(values == 0, -0.0, values)]
    others += [np.array(["0", "1"], h5py.string_dtype()), np.array(["0", "2"], h5py.string_dtype())]
    found = [hashes(hash_runs, tmp_path / "other.h5", image=values, position=other) for other in others]
    assert len({one["position"] for one in (first, *found)}) == 1 + len(others)
    assert {one["image"] for one in found} == {first["image"]}






def test_a_comparison_that_finds_differences_ends_with_status_1(hash_runs, tmp_path, monkeypatch, capsys):
    path, now = tmp_path / "before.json", {"a, exact": {"exit status": 0, "x": "1"}}
    monkeypatch.setitem(hash_runs["main"].__globals__, "run", lambda cases: now)
    monkeypatch.setattr(sys, "argv", ["hash_runs.py", "--write", str(path)])
    hash_runs["main"]()
    monkeypatch.setattr(sys, "argv", ["hash_runs.py", "--compare", str(path)])
    hash_runs["main"]()
    now["a, exact"]["x"] = "2"
    with pytest.raises(SystemExit) as stop:
        hash_runs["main"]()
    assert stop.value.code == 1
    assert "a, exact: x: differs\n1 differences" in capsys.readouterr().out
