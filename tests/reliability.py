"""Write docs/reliability.md: the hazards, what is promised, the tests marked `promise` that show it, and their results.

A plugin of pytest, active with --reliability FILE.
"""

from collections import defaultdict
from pathlib import Path

import pytest

HEAD = """\
# What can go wrong, and what is promised

Each promise is tested; the last column says by how many random faults. `make soak` runs the tests with many of them
from a new seed and writes this page; `make test` runs the same tests with fewer. A failing test prints the seed of its
faults, and `pytest TEST --fault-seed SEED` repeats them.

| Hazard | Promise | Tests | Result |
|---|---|---|---|
"""


class Page:
    """Collects the results of the tests by hazard and promise, in the process that distributes them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.results: dict[tuple[str, str], list[tuple[str, str, int]]] = defaultdict(list)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note the result of a test, or of a set-up that did not succeed."""
        if report.when != "call" and report.passed:
            return
        properties = report.user_properties
        tries = sum(value for name, value in properties if name == "tries")
        for name, value in properties:
            if name == "promise":
                self.results[tuple(value)].append((report.nodeid, report.outcome, tries))

    def pytest_sessionfinish(self) -> None:
        """Write the page."""
        rows = [_row(*key, results) for key, results in sorted(self.results.items())]
        self.path.write_text(HEAD + "".join(rows), encoding="utf-8")


def promises(item: pytest.Item) -> list[tuple[str, str]]:
    """Return hazard and promise of a test's markers, in the order of the source."""
    return [sentences(*marker.args) for marker in reversed(list(item.iter_markers("promise")))]


def sentences(hazard: str, promise: str) -> tuple[str, str]:
    """Return both with a capital, and the promise with a full stop."""
    return hazard[:1].upper() + hazard[1:], promise[:1].upper() + promise[1:].removesuffix(".") + "."


def _row(hazard: str, promise: str, results: list[tuple[str, str, int]]) -> str:
    names = {nodeid.partition("[")[0] for nodeid, _, _ in results}
    tests = "<br>".join(f"`{name.removeprefix('tests/')}`" for name in sorted(names))
    return f"| {hazard} | {promise} | {tests} | {_result(results)} |\n"


def _result(results: list[tuple[str, str, int]]) -> str:
    """Return how many tests passed, and from how many random faults; those that did not pass stand first."""
    counts = {outcome: sum(result[1] == outcome for result in results) for outcome in ("failed", "skipped", "passed")}
    text = ", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count)
    tries = sum(result[2] for result in results)
    return f"{text}; {tries:,} random faults" if tries else text
