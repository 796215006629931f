"""The tutorial runs as it is printed, and prints what it says."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "docs" / "_ext"))
from session import executed  # noqa: E402

PAGE = (ROOT / "docs" / "tutorial.md").read_text()


@pytest.mark.slow
def test_the_tutorial_prints_what_it_says(tmp_path):
    shown = executed(PAGE, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"msd.png", "own.png", "heavy_disk.h5", "heavy_disk.nc"}
    assert "(msd.png)" in shown
