"""Every benchmark runs to its end: a quick pass of each. Hashes of runs change with the numbers and
nothing else.
"""

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
    """As `python benchmarks/bench_x.py --quick` does, in the process of the tests, which has
    imported what it takes.

    Plans time their engines for a tenth of the usual time. The commands of a whole study are forked
    processes.
    """
    before = docs()
    run = subprocess.run

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
