"""`brownpipe plan`: a table of engines for a tolerance, from pilot runs.

The squared error of n runs is bias^2 + se^2 + spread^2/n, with the standard error se of the bias and the standard
deviation `spread` over runs. An engine that costs more than the exact one is not compared.
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from brownpipe.engines import DEFINITIONS, Engine, configured
from brownpipe.errors import RequestError
from brownpipe.formatting import in_time
from brownpipe.quoting import in_lines
from brownpipe.scene import Scene
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.scene.yaml_file import read_yaml, yaml_text
from brownpipe.stages import tracked
from brownpipe.storage.files import write_file
from brownpipe.study.run_count import DISTRIBUTION, case_title, run_pilot
from brownpipe.study.study import REFERENCE, Study
from brownpipe.tradeoff import compare, runs_for, timing

VARIABLES = {  # of `tradeoff.compare`: bias, its standard error or noise, spread of a run
    "msd": ("msd_bias", "msd_bias_standard_error", "msd_spread"),
    "d": ("d_bias", "d_bias_standard_error", "d_spread"),
    DISTRIBUTION: ("displacement_bias", "displacement_bias_noise", "displacement_spread"),
}
NOT_INHERITED = ("batch", "tolerance", "target", "instead_of", "figures", "record")  # keys of a study that is planned
TIMING_REPEATS = 3
EQUAL = 0.1  # relative difference of costs within which the exact engine is preferred


class Performance(NamedTuple):
    """Errors of the target by an engine in a case, relative to the exact mean, and the cost of a run."""

    scene: Scene
    engine: Engine
    bias: float  # 0 for the exact engine; NaN if it was not compared, as it costs more
    bias_error: float  # standard error of the bias
    spread: float  # standard deviation over runs
    seconds: float  # of CPU for one run
    share_sound: float = 1.0  # of runs that do not fail

    def runs_for(self, tolerance: float) -> int | None:
        """Return the runs, failing ones included, that a tolerance needs; None for a bias too large or not compared."""
        if np.isnan(self.bias):
            return None
        return runs_for(tolerance, self.bias**2 + self.bias_error**2, self.spread, self.share_sound)


class Offer(NamedTuple):
    """A number of runs of one engine in each case."""

    engine: Engine
    runs: int  # of each case
    seconds: float  # of CPU, of the runs of all cases


def performance_of(study: Study, target: str) -> list[list[Performance]]:
    """Return, for each case, the exact engine and the candidates by pilot runs; one that costs more is not compared."""
    return [_by_pilots(study, scene, target) for scene in tracked(study.cases, "cases")]


def _by_pilots(study: Study, scene: Scene, target: str) -> list[Performance]:
    found: list[Performance] = []
    for engine in tracked([REFERENCE, *candidates(scene)], "engines"):
        seconds = timing.seconds_per_run(engine, scene, TIMING_REPEATS)
        if found and seconds >= found[0].seconds:
            found.append(Performance(scene, engine, np.nan, np.nan, np.nan, seconds))
            continue
        runs = run_pilot(study, scene, engine, target)
        if engine == REFERENCE:  # the first
            exact = runs
        values = compare(runs, exact, study.fit_windows[0], seconds)
        bias, error, spread = (float(values[name]) for name in VARIABLES[target])
        found.append(Performance(scene, engine, bias, error, spread, seconds, runs.share_sound))
    return found


def candidates(scene: Scene) -> list[Engine]:
    """Return the approximate engines, with settings, that are worth a pilot and fit for the scene."""
    engines = []
    for name, definition in DEFINITIONS.items():
        for settings in definition.candidates(scene) if definition is not REFERENCE.definition else ():
            with suppress(RequestError):
                engine = configured(name, **settings)
                engine.refuse_unfit(scene)
                engines.append(engine)
    return engines


def offers(cases: Sequence[Sequence[Performance]], tolerance: float) -> list[Offer]:
    """Return the offers that meet the tolerance in all cases, the cheapest first.

    An engine that was not compared in a case offers nothing.
    """
    made = []
    for engine in [performance.engine for performance in cases[0]]:
        needed = [each.runs_for(tolerance) for case in cases for each in case if each.engine == engine]
        if None not in needed and len(needed) == len(cases) and max(needed) <= MOST_SEEDS:
            seconds = sum(each.seconds for case in cases for each in case if each.engine == engine)
            made.append(Offer(engine, max(needed), max(needed) * seconds))
    return sorted(made, key=lambda offer: offer.seconds * (1.0 - EQUAL if offer.engine == REFERENCE else 1.0))


def recommendation(cases: Sequence[Sequence[Performance]], target: str, tolerance: float) -> str:
    """Return a table of the engines in each case, and the best two offers for all cases."""
    rows = [
        {
            "case": case_title(each.scene),
            "engine": each.engine.label,
            "CPU of a run": in_time(each.seconds),
            f"bias of {target}": "" if np.isnan(each.bias) else f"{_percent(each.bias)} +- {_percent(each.bias_error)}",
            "runs": each.runs_for(tolerance) or ("costs more than exact" if np.isnan(each.bias) else "bias too large"),
        }
        for case in cases
        for each in case
    ]
    lines = [*pd.DataFrame(rows).to_string(index=False).splitlines(), f"{target} to {_percent(tolerance)}:"]
    made = offers(cases, tolerance)
    for word, offer in zip(("use", "or"), made, strict=False):
        runs = f"{offer.engine.label}: {offer.runs:,} runs in each case"
        lines.append(f"{word:<4}{runs}; {in_time(offer.seconds)} of CPU")
    return in_lines(lines if made else [*lines, "no engine can"])


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def write_study(study_file: str | Path, path: str | Path, offer: Offer, comment: str) -> None:
    """Write a study below a line of comment, all or nothing: the scenes of another study, with the runs of an offer."""
    mapping: dict[str, Any] = {key: value for key, value in read_yaml(study_file).items() if key not in NOT_INHERITED}
    scenes = mapping["scenes"] if isinstance(mapping["scenes"], list) else [mapping["scenes"]]
    folder = Path(path).resolve().parent
    mapping["scenes"] = [os.path.relpath(Path(study_file).resolve().parent / scene, folder) for scene in scenes]
    mapping |= {"engines": [{"name": offer.engine.name, **dict(offer.engine.settings)}], "seeds": offer.runs}
    folder.mkdir(parents=True, exist_ok=True)
    write_file(path, f"# {comment}\n\n{yaml_text(mapping)}".encode())
