"""Files that other tools look for: continuous integration, citation, hooks of pre-commit. The page of the promises."""

import ast
import re
import tomllib
from pathlib import Path

import yaml

from reliability import HEAD, sentences

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def read(name):
    return yaml.safe_load((ROOT / name).read_text())


def test_continuous_integration_runs_the_two_commands_on_the_oldest_python():
    job = read(".github/workflows/ci.yml")["jobs"]["test"]
    commands = [step["run"] for step in job["steps"] if "run" in step]
    assert [re.match(r"make \w+", command)[0] for command in commands] == ["make study", "make test"]
    assert job["strategy"]["matrix"]["python"][0] == PROJECT["requires-python"].removeprefix(">=")


def test_the_citation_is_of_this_version_and_invents_no_address():
    citation = read("CITATION.cff")
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert citation["version"] == PROJECT["version"]
    assert citation["authors"] == [{"name": "brownpipe developers"}]
    (note,) = citation["references"]
    assert (note["title"], note["year"]) == ("Brownian motion simulation", 2020)
    assert not {"doi", "url", "license", "repository-code"} & (citation.keys() | note.keys())


def test_hooks_are_the_linters_of_make_lint():
    (repository,) = read(".pre-commit-config.yaml")["repos"]
    assert repository["repo"] == "local"  # from the environment, so with the pinned versions
    recipe = (ROOT / "Makefile").read_text().partition("\nlint:")[2].partition("\n\n")[0]
    linters = re.findall(r"^\t(ruff \w+|snakefmt|mypy)", recipe, re.MULTILINE)
    assert [re.match(r"ruff \w+|\w+", hook["entry"])[0] for hook in repository["hooks"]] == linters
    assert {hook["language"] for hook in repository["hooks"]} == {"system"}


def promises_in(path):
    """Return hazard and promise of each marker `promise` in a file of tests."""
    calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    markers = [call.args for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "promise"]
    return {sentences(*map(ast.literal_eval, arguments)) for arguments in markers}


def test_the_page_of_reliability_has_every_promise_and_each_is_kept():
    lines = (ROOT / "docs/reliability.md").read_text().splitlines()[len(HEAD.splitlines()) :]
    rows = [line.strip("|").split(" | ") for line in lines]
    on_the_page = {(hazard.strip(), promise) for hazard, promise, *_ in rows}
    assert on_the_page == set().union(*(promises_in(path) for path in (ROOT / "tests").glob("test_*.py")))
    assert not [row for row in rows if not re.fullmatch(r"\d+ passed(; [\d,]+ random faults)? ", row[3])]
