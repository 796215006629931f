"""Files that other tools look for: continuous integration, citation, hooks of pre-commit."""

import re
import tomllib
from pathlib import Path

import yaml

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
