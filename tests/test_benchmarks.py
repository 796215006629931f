"""Every benchmark runs to its end: a quick pass of each."""

import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BENCHMARKS = sorted((ROOT / "benchmarks").glob("bench_*.py"))
pytestmark = pytest.mark.slow


def docs():
    """When each file of docs/ was last written."""
    return {path: path.stat().st_mtime_ns for path in (ROOT / "docs").rglob("*") if path.is_file()}


def test_there_are_benchmarks():
    assert BENCHMARKS


@pytest.mark.parametrize("path", BENCHMARKS, ids=lambda path: path.stem)
def test_a_quick_pass_reports_and_leaves_the_tables_of_docs_alone(path, monkeypatch, capfd):
    """As `python benchmarks/bench_x.py --quick` does, in the process of the tests, which has imported what it takes."""
    before = docs()
    monkeypatch.setattr(sys, "argv", [str(path), "--quick"])
    monkeypatch.syspath_prepend(path.parent)
    monkeypatch.chdir(ROOT)
    runpy.run_path(str(path), run_name="__main__")
    assert any(character.isdigit() for character in capfd.readouterr().out)
    assert docs() == before
