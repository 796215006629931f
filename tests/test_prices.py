"""The price list as a user starts it: a study with a tolerance instead of seeds, from scenes to figures."""

import csv
import os
import re
import shutil
import sys

import numpy as np
import pytest
import yaml

import forked
from brownpipe.storage.datasets import read_dataset
from test_workflow import PROGRAM, SCENE, SNAKEMAKE, environment

STUDY = """\
scenes: [scenes/full.yaml, scenes/half.yaml]
tolerance: 20%
instead_of: {full: half}
engines:
  - exact
  - {name: timestep, time_step: 0.03, scenes: full}
  - {name: langevin, friction: boltzmann, scenes: full, seeds: 300}
"""
TRADEOFF = """
import sys
from brownpipe.cli import main
from brownpipe.tradeoff import timing
timing.LEAST /= 10
sys.exit(main())
"""
BROWNPIPE = """\
#!/bin/bash
if [ $1 = tradeoff ]; then exec {} -c '{}' "$@"; fi
exec {} "$@"
"""
pytestmark = pytest.mark.slow


def snakemake(folder, *words, study="prices"):
    """What snakemake printed. Runs are timed for a tenth of the usual time: how precisely is not tested here."""
    program = folder / "bin" / "brownpipe"
    program.parent.mkdir(exist_ok=True)
    program.write_text(BROWNPIPE.format(sys.executable, TRADEOFF, f"{forked.programs()}/brownpipe"))
    program.chmod(0o755)
    words = [*SNAKEMAKE[len(PROGRAM) :], *words, "--directory", folder, "--configfile", folder / f"{study}.yaml"]
    path = f"{program.parent}{os.pathsep}{environment()['PATH']}"
    done = forked.snakemake(*words, cwd=folder, env=environment(PATH=path))
    assert done.returncode == 0, done.printed
    return done.printed


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of a study with its price list, and what was printed meanwhile."""
    folder = tmp_path_factory.mktemp("prices")
    (folder / "scenes").mkdir()
    (folder / "prices.yaml").write_text(STUDY)
    scene = SCENE.replace("particles: 10", "particles: 12")
    (folder / "scenes" / "full.yaml").write_text(scene)
    (folder / "scenes" / "half.yaml").write_text(scene.replace("particles: 12", "particles: 6"))
    return folder, snakemake(folder, "tradeoff_figures", "--cores", "1")


def test_every_engine_has_a_price_in_its_scenes(finished):
    folder, printed = finished
    made = folder / "results" / "prices"
    text = (made / "tradeoff" / "tradeoff.txt").read_text()
    assert text in printed and "not on the Pareto front" in text
    names = {path.name for path in (made / "tradeoff").iterdir()}
    pictures = {f"tradeoff_full_N12.{kind}" for kind in ("png", "svg")}
    texts = {"prices.nc", "tradeoff.csv", "tradeoff.txt", "provenance.json", "report.html"}
    assert {name for name in names if "_from_" not in name} == pictures | texts
    rows = list(csv.DictReader((made / "tradeoff" / "tradeoff.csv").read_text().splitlines()))
    settings = {(row["scene"], row["setting"]) for row in rows}
    engines = ("exact", "timestep-0.03", "langevin-boltzmann", "exact in half_N6")
    assert settings == {("full_N12", engine) for engine in engines}
    assert all(float(row["seconds"]) > 0 for row in rows)


def test_seeds_are_as_many_as_the_tolerance_needs(finished):
    folder, _ = finished
    made = folder / "results" / "prices"
    (file,) = (made / "plan").iterdir()
    plan = yaml.safe_load(file.read_text())
    assert plan["runs"] == max(plan["needed"].values()) and set(plan["needed"]) == {"full, N = 12", "half, N = 6"}
    prices = read_dataset(made / "tradeoff" / "prices.nc").sel(scene="full_N12")
    assert [int(n) for n in prices.runs.sel(setting=["exact", "langevin-boltzmann"])] == [plan["runs"], 300]
    # r^2 of one run scatters by s, and 20 % were asked for; the pilot's s and this one are known to some 20 % together
    achieved = float(prices.msd_spread.sel(setting="exact")) / np.sqrt(plan["runs"])
    assert achieved == pytest.approx(0.2, rel=0.6)


def test_nothing_is_run_again_until_the_tolerance_changes(finished, tmp_path):
    folder = shutil.copytree(finished[0], tmp_path / "copy")
    assert planned(folder) == {"tradeoff_figures": "1", "total": "1"}  # only the table is shown again
    (folder / "prices.yaml").write_text(STUDY.replace("20%", "15%"))
    counts = planned(folder)
    assert counts["plan"] == counts["tradeoff"] == "1"


def planned(folder):
    """How many jobs of each rule a dry run would start."""
    table = snakemake(folder, "tradeoff_figures", "--dry-run").partition("Job stats:")[2]
    return dict(re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE))
