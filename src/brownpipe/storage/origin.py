"""What a dataset was made from, as text in its attributes: scenes, engines, seeds, and the installation.

The attribute `made_from` (JSON) has an entry for each scene, number of disks and engine, with all that is needed to
make its runs again. Nothing in it depends on batches, folders, machines or users.
"""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from brownpipe.engines import RECORDS, Engine, recorded
from brownpipe.errors import RequestError, StorageError
from brownpipe.observables import problem
from brownpipe.provenance import NAME, PACKAGE
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.seeds import parse_seeds, seed_text
from brownpipe.storage.rerun import simulate_command
from brownpipe.storage.trajectories import Outline

MOST_SCENE_TEXT = 100_000  # characters; a longer scene, of thousands of listed disks, is in the trajectory files only
UNSAID = "does not say what it was made from; make it again with this brownpipe"
LONGEST_GIT = 10.0  # seconds
COMMIT = re.compile(r"^# branch\.oid ([0-9a-f]{40,64})$", re.MULTILINE)


class Origin(NamedTuple):
    """The runs of one scene, number of disks and engine."""

    scene: Scene | None  # None if its text was too long
    name: str  # of the scene
    digest: str  # of the scene's physics
    engine: Engine
    seeds: Sequence[int]
    record: frozenset[str]
    observables: tuple[str, ...]
    average: str
    source: str  # digest of the source code that made the runs


def origin_attributes(groups: Iterable[tuple[Outline, np.ndarray]], options: dict) -> dict[str, str]:
    """Return attributes of a dataset that say how it is made again: runs (`made_from`), `options` and command.

    A group of runs is the outline of one of its files, and all seeds (S,).
    """
    runs = [runs_record(outline, seeds) for outline, seeds in groups]
    return {
        "rerun": "`brownpipe inspect FILE --reproduce` makes this file again and compares; FILE is this file",
        "options": json.dumps(options, sort_keys=True, allow_nan=False),
        "made_from": json.dumps(runs, sort_keys=True, allow_nan=False),
    }


def runs_record(outline: Outline, seeds: Sequence[int] | np.ndarray, record: str = "") -> dict:
    """Return all that is needed to make runs (S,) of one scene and engine again, and the command.

    record: what `--record` must be given; by default `tracer`, or `none` if its track was not recorded.
    """
    scene, engine, record = outline.scene, outline.engine, record or ("tracer" if outline.tracer else "none")
    options = {"record": record, "observables": ",".join(outline.observables or ()), "average": outline.average}
    return {
        "command": simulate_command(scene, engine, seeds, options),
        "scene_name": scene.name,
        "scene_digest": scene.digest,
        "scene": json.loads(scene.text) if len(scene.text) <= MOST_SCENE_TEXT else None,
        "engine": {"name": engine.name, **dict(engine.settings)},
        "seeds": seed_text(seeds),
        **options,
        "source_digest": outline.source,
    }


def read_origins(path: str | Path, attributes: Mapping) -> list[Origin]:
    """Return the runs named by the attributes of a dataset, or of a figure or table of one; all values are checked.

    Raises StorageError, naming the file at `path`, if they name none that this version understands.
    """
    try:
        return [_origin(entry) for entry in json.loads(attributes["made_from"])]
    except RequestError as error:
        raise StorageError(f"{path}: its runs cannot be made by this version of brownpipe: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise StorageError(f"{path}: {UNSAID}") from error


def read_options(path: str | Path, attributes: Mapping) -> dict:
    """Return the options that a dataset was made with, by name; errors as of `read_origins`."""
    try:
        options = json.loads(attributes["options"])
        if not all(OPTIONS[name](value) for name, value in options.items()):
            raise ValueError("an option of another kind")
        return options
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise StorageError(f"{path}: {UNSAID}") from error


def _is_number(value: object) -> bool:
    return type(value) in (int, float)


def _are_numbers(value: object) -> bool:
    return isinstance(value, list) and all(map(_is_number, value))


def _is_window(value: object) -> bool:
    return _are_numbers(value) and len(value) == 2  # type: ignore[arg-type]  # a list


OPTIONS: dict[str, Callable[[Any], bool]] = {  # of aggregate and tradeoff: whether a value is of the right kind
    "fit_windows": lambda value: value is None or (isinstance(value, list) and all(map(_is_window, value))),
    "ring_width": lambda value: value is None or _is_number(value),
    "rings": lambda value: value is None or type(value) is int,
    "displacement_times": _are_numbers,
    "fit_window": lambda value: value is None or _is_window(value),
    "instead_of": lambda value: all(isinstance(others, list) for others in value.values()),
}


def _origin(entry: dict) -> Origin:
    name, digest, source = (str(entry[key]) for key in ("scene_name", "scene_digest", "source_digest"))
    if not re.fullmatch(r"[\w.-]{1,64}", name, re.ASCII):
        raise ValueError("no name of a scene")
    scene = None if entry["scene"] is None else parse_scene(entry["scene"], f"{name}.yaml")
    if scene is not None and scene.digest != digest:
        raise ValueError("the scene is not that of the digest")
    observables = tuple(filter(None, entry["observables"].split(",")))
    if scene is not None and (wrong := problem(scene, observables, entry["average"])):
        raise ValueError(": ".join(wrong))
    record = frozenset(entry["record"].split(","))
    if not record <= {*RECORDS} or not re.fullmatch("[0-9a-f]{64}", source):
        raise ValueError("no such record or source")
    seeds = parse_seeds(entry["seeds"])
    return Origin(scene, name, digest, recorded(entry["engine"]), seeds, record, observables, entry["average"], source)


# -- the installation -----------------------------------------------------------------------------------------------


@cache
def installation() -> dict[str, str]:
    """Return the version of Python and, if brownpipe runs from a git checkout, its commit: `git_commit`.

    The commit of a checkout whose source was modified ends with `, modified`.
    """
    commit = _commit(PACKAGE)
    return {"python": sys.version.partition(" ")[0]} | ({"git_commit": commit} if commit else {})


def _commit(package: Path) -> str | None:
    """Return the commit of the checkout that a package lies in; None if it is installed, or if git does not answer."""
    checkout = package.parents[1]
    if package != checkout / "src" / NAME or not (checkout / ".git").exists():
        return None
    command = ["git", "--no-optional-locks", "-C", str(checkout), "status", "--porcelain=v2", "--branch", "--", "src"]
    env = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    try:
        done = subprocess.run(command, env=env, timeout=LONGEST_GIT, stdin=subprocess.DEVNULL, capture_output=True)
    except (FileNotFoundError, PermissionError, subprocess.SubprocessError):  # others, as too many open files, are told
        return None
    said = done.stdout.decode(errors="replace")
    commit = COMMIT.search(said)
    if done.returncode or commit is None:
        return None
    modified = any(not line.startswith("#") for line in said.splitlines())
    return f"{commit[1]}, modified" if modified else commit[1]
