"""Trajectory files together with the runs that they are to hold: exchanged files are recognised by what is in them."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.engines.request import Request
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.storage.trajectories import Outline


class Expected(NamedTuple):
    """A trajectory file and the runs that it is to hold."""

    path: str | Path
    request: Request


def difference(outline: Outline, request: Request) -> str | None:
    """Return in what a trajectory file departs from the runs requested, in words; None if it holds exactly these."""
    found, wanted = outline.scene, request.scene
    if found.name != wanted.name:
        return f"holds runs of the scene {found.name}, not of {wanted.name}"
    if found.particles != wanted.particles:
        return f"holds runs with N = {found.particles}, not {wanted.particles}"
    if found.digest != wanted.digest:
        return f"holds runs of another scene that is called {wanted.name}, too"
    if outline.engine != request.engine:
        return f"holds runs of the engine {outline.engine.options}, not of {request.engine.options}"
    if not np.array_equal(outline.seeds, request.seeds):
        return f"holds the seeds {brief_seed_text(outline.seeds)}, not {brief_seed_text(request.seeds)}"
    record = request.record - {"none"} if wanted.particles else frozenset()
    if outline.record != record and outline.observables is not None:  # without a finished run there is no record
        return f"holds runs with --record {_words(outline.record)}, not {_words(record)}"
    if outline.observables is not None and set(outline.observables) != set(request.observables):
        return f"holds runs with --observables {_words(outline.observables)}, not {_words(request.observables)}"
    if outline.average != request.average:
        return f"holds runs with --average {outline.average}, not {request.average}"
    return None


def _words(names: frozenset[str] | tuple[str, ...]) -> str:
    return ",".join(sorted(names)) or "none"
