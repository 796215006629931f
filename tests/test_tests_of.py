"""The map from a source file to its tests."""

import subprocess
import sys

import pytest

import tests_of


@pytest.mark.parametrize(
    ("source", "test"),
    [
        ("engines/friction.py", "test_regime.py"),  # imported
        ("interface.py", "test_interface.py"),  # as bp.simulate
        ("verbs/studies.py", "test_run.py"),  # a verb
        ("verbs/files.py", "test_cli.py"),
        ("figures/health.py", "test_figures.py"),  # a figure
        ("engines/exact/events.py", "test_exact.py"),  # kernels behind engines/exact/run.py
    ],
)
def test_a_source_file_has_the_tests_that_cover_it(source, test):
    tests = tests_of.tests_of(tests_of.SOURCE / "brownpipe" / source)
    assert test in [file.name for file in tests]


def test_not_all_tests_cover_a_file():
    theory = tests_of.tests_of(tests_of.SOURCE / "brownpipe" / "theory.py")
    assert len(theory) < len(list(tests_of.TESTS.glob("test_*.py"))) / 2


def test_every_source_file_has_tests():
    """But the one for `python -m brownpipe`, which only calls `main`."""
    without = [file for file in tests_of.sources() if not tests_of.tests_of(file)]
    assert without == [tests_of.SOURCE / "brownpipe" / "__main__.py"]


@pytest.mark.parametrize("path", ["src/brownpipe/nothing.py", ""])
def test_a_file_that_is_none_of_the_source_is_refused(path):
    """So that `make test-of` does not run all tests instead."""
    command = [sys.executable, tests_of.__file__, path]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"'{path}' is no file in src/brownpipe/\n"
