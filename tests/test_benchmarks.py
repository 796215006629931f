"""Every benchmark runs to its end: a quick pass of each. Hashes of runs change with the numbers and nothing else."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

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
