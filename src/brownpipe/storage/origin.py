"""What a dataset was made from, as text in its attributes: scenes, engines, seeds, and the installation.

The attribute `made_from` (JSON) has an entry for each scene, number of disks and engine, with all that is needed to
make its runs again. Nothing in it depends on batches, folders, machines or users.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from brownpipe.provenance import NAME, PACKAGE, made_with
from brownpipe.storage.trajectories import Outline, simulate_command

MOST_SCENE_TEXT = 100_000  # characters; a longer scene, of thousands of listed disks, is in the trajectory files only
LONGEST_GIT = 10.0  # seconds


def origin_attributes(groups: Iterable[tuple[Outline, np.ndarray]], options: dict) -> dict[str, str]:
    """Return attributes of a dataset that say how it is made again: runs (`made_from`) and `options`.

    A group of runs is the outline of one of its files, and all seeds (S,).
    """
    runs = [runs_record(outline, seeds) for outline, seeds in groups]
    return {
        "options": json.dumps(options, sort_keys=True, allow_nan=False),
        "made_from": json.dumps(runs, sort_keys=True, allow_nan=False),
    }


def runs_record(outline: Outline, seeds: Sequence[int] | np.ndarray, record: str = "") -> dict:
    """Return the command that makes runs (S,) of one scene and engine again, their scene and the source that made them.

    record: what `--record` must be given; by default what was recorded of the tracer.
    """
    scene = outline.scene
    return {
        "command": simulate_command(outline, seeds, record),
        "scene_digest": scene.digest,
        "scene": json.loads(scene.text) if len(scene.text) <= MOST_SCENE_TEXT else None,
        "source_digest": outline.source,
    }


# -- the installation -----------------------------------------------------------------------------------------------


def made_by(step: str) -> dict[str, str]:
    """Return the attributes that say with which source, versions and commit a step of the pipeline makes its output."""
    return made_with(step) | installation()


@cache
def installation() -> dict[str, str]:
    """Return the version of Python and, if brownpipe runs from a git checkout, its commit: `git_commit`.

    The commit of a checkout with modified files ends with `, modified`.
    """
    commit = _commit(PACKAGE)
    return {"python": sys.version.partition(" ")[0]} | ({"git_commit": commit} if commit else {})


def _commit(package: Path) -> str | None:
    """Return the commit of the checkout that a package lies in; None if it is installed, or if git does not answer."""
    checkout = package.parents[1]
    if package != checkout / "src" / NAME or not (checkout / ".git").exists():
        return None
    command = ["git", "-C", str(checkout), "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=, modified"]
    env = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    try:
        done = subprocess.run(command, env=env, timeout=LONGEST_GIT, capture_output=True, text=True, check=True)
        return done.stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
