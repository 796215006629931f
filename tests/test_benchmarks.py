"""Every benchmark runs to its end: a quick pass of each, in a process of its own."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
BENCHMARKS = sorted((ROOT / "benchmarks").glob("bench_*.py"))
LIMIT = 600.0  # seconds: a pass takes some, its kernels, where they are not compiled yet, up to some minutes


def docs():
    """When each file of docs/ was last written."""
    return {path: path.stat().st_mtime_ns for path in (ROOT / "docs").rglob("*") if path.is_file()}


def test_there_are_benchmarks():
    assert BENCHMARKS


@pytest.mark.parametrize("path", BENCHMARKS, ids=lambda path: path.stem)
def test_a_quick_pass_reports_and_leaves_the_tables_of_docs_alone(path):
    before = docs()
    done = subprocess.run(
        [sys.executable, str(path), "--quick"], cwd=ROOT, capture_output=True, text=True, timeout=LIMIT, check=False
    )
    assert done.returncode == 0, done.stderr
    assert any(character.isdigit() for character in done.stdout)
    assert docs() == before
