"""Bias, scatter and cost of each engine in each case of a study, from stored trade-offs or else from pilot runs."""

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brownpipe.engines import DEFINITIONS, Engine, configured, recorded
from brownpipe.errors import FigureError, RequestError
from brownpipe.figures.cases import of_file, of_whole_dataset
from brownpipe.scene import Scene
from brownpipe.stages import tracked
from brownpipe.storage import read_dataset
from brownpipe.study.pilot import average_of_msd, pilot_runs, run_pilot
from brownpipe.study.study import REFERENCE, Study
from brownpipe.tradeoff import compare, timing

if TYPE_CHECKING:
    import xarray

TIMING_REPEATS = 3
LARGEST = 1e100  # of relative errors and of CPU times [s] in a stored trade-off
PREFIX = {"msd": "msd", "d": "d", "displacement_distribution": "displacement"}  # of the variables of a trade-off


class EnginePerformance(NamedTuple):
    """Errors of one target quantity by an engine in a case, relative to the exact mean, and the cost of a run."""

    engine: Engine
    bias: float  # 0 for the exact engine; NaN if it was not compared
    bias_error: float  # standard error of the bias
    scatter: float  # standard deviation over runs
    seconds: float  # of CPU for one run
    share_sound: float = 1.0  # of runs that do not fail

    @property
    def bias_square(self) -> float:
        """The squared bias that enters the total error: at least the square of its standard error; NaN if unknown."""
        return float(np.maximum(self.bias**2, self.bias_error**2))


class CasePerformance(NamedTuple):
    """The performance of the engines in one case."""

    scene: Scene
    source: str  # the file it is read from, or the pilot
    engines: dict[Engine, EnginePerformance]


def performance_of(study: Study, target: str, results: str | Path = "results") -> list[CasePerformance]:
    """Return the performance of the engines in each case of a study, for one of study_file.TARGETS.

    Taken from a trade-off stored below `results` if it has the same scene, otherwise, and for an average within runs,
    from pilot runs.
    """
    window = study.fit_windows[0]
    average = "runs" if target == "displacement_distribution" else average_of_msd(study)
    return [
        (stored_performance(scene, target, window, results) if average == "runs" else None)
        or pilot_performance(scene, target, window, average)
        for scene in tracked(study.cases, "cases")
    ]


def stored_performance(
    scene: Scene, target: str, window: tuple[float, float], results: str | Path
) -> CasePerformance | None:
    """Return the performance in the first stored trade-off that has this scene (for D: and fit window), or None.

    Raises FigureError, which names the file, for a trade-off that is not as it was made.
    """
    for path in sorted(Path(results).glob("*/tradeoff/*.nc")):
        dataset = read_dataset(path)
        if not {"digest", "engine", f"{PREFIX[target]}_bias_careful"} <= set(dataset.data_vars):
            continue  # written by another version
        with of_file(path):
            performances = _in_scene(dataset, scene, target, window)
        if performances:
            return _case(scene, str(path), performances)
    return None


@of_whole_dataset
def _in_scene(
    dataset: "xarray.Dataset", scene: Scene, target: str, window: tuple[float, float]
) -> list[EnginePerformance]:
    """Return the performance of each setting of a trade-off in a scene, the exact engine first; none without the scene.

    For D, a trade-off with another fit window counts as one without the scene.
    """
    index = np.flatnonzero(dataset.digest.values == scene.digest)
    if not index.size:
        return []
    of_scene = dataset.isel(scene=index[0])
    if target == "d" and not np.allclose([of_scene.window_start, of_scene.window_end], window):
        return []
    performances = []
    for label in of_scene.setting.values:
        setting = of_scene.sel(setting=label)
        engine = recorded(json.loads(setting.engine.item()), str(label)) if setting.runs > 0 else None
        if engine is not None and engine.label == label:  # otherwise exact runs of a scene in place of this one
            values = {str(name): setting[name].item() for name in setting.data_vars if setting[name].ndim == 0}
            performances.append(_performance(engine, values, target))
    performances.sort(key=lambda performance: performance.engine != REFERENCE)
    if not performances or performances[0].engine != REFERENCE:
        raise FigureError("setting: must have exact runs in the dataset; make it again")
    for name, field in ((f"{PREFIX[target]}_spread", "scatter"), ("seconds", "seconds")):
        if not all(0.0 < getattr(performance, field) < LARGEST for performance in performances):
            raise FigureError(
                f"{name}: must be between 0 and {LARGEST:g} for every engine in the dataset; make it again"
            )
    if any(abs(value) >= LARGEST for each in performances for value in (each.bias, each.bias_error)):
        raise FigureError(
            f"{PREFIX[target]}_bias: must be below {LARGEST:g} for every engine in the dataset; make it again"
        )
    if not all(0.0 < performance.share_sound <= 1.0 for performance in performances):
        raise FigureError("failed_runs: must be a number of runs for every engine in the dataset; make it again")
    return performances


def pilot_performance(scene: Scene, target: str, window: tuple[float, float], average: str = "runs") -> CasePerformance:
    """Measure the exact engine and the candidates by pilot runs; a candidate that costs more is not compared."""
    performances: list[EnginePerformance] = []
    for engine in tracked([REFERENCE, *candidates(scene)], "engines"):
        seconds = timing.seconds_per_run(engine, scene, repeats=TIMING_REPEATS)
        if engine == REFERENCE:
            exact, exact_seconds = run_pilot(scene, engine, average), seconds
            performances.append(_performance(engine, compare(exact, exact, window, seconds), target))
        elif seconds < exact_seconds:
            values = compare(run_pilot(scene, engine, average), exact, window, seconds)
            performances.append(_performance(engine, values, target))
        else:
            performances.append(EnginePerformance(engine, np.nan, np.nan, performances[0].scatter, seconds))
    return _case(scene, f"a pilot of {pilot_runs(scene, average)} runs", performances)


def _case(scene: Scene, source: str, performances: list[EnginePerformance]) -> CasePerformance:
    return CasePerformance(scene, source, {performance.engine: performance for performance in performances})


def _performance(engine: Engine, values: Mapping[str, str | float | np.ndarray], target: str) -> EnginePerformance:
    """Return the performance that the variables of a trade-off (`tradeoff.compare`) give."""
    name = PREFIX[target]
    error = f"{name}_bias_noise" if target == "displacement_distribution" else f"{name}_bias_standard_error"
    numbers = (values[f"{name}_bias"], values[error], values[f"{name}_spread"], values["seconds"])
    bias, bias_error, scatter, seconds = map(float, numbers)
    sound, failed = float(values["runs"]), float(values["failed_runs"])
    share_sound = sound / (sound + failed) if sound + failed > 0.0 else np.nan
    return EnginePerformance(engine, bias, bias_error, scatter, seconds, share_sound)


def candidates(scene: Scene) -> list[Engine]:
    """Return the approximate engines, with settings, that are worth a pilot and fit for the scene."""
    engines = []
    for definition in DEFINITIONS.values():
        if definition is REFERENCE.definition:
            continue
        for settings in definition.candidates(scene):
            with suppress(RequestError):
                engine = configured(definition.name, **settings)
                engine.refuse_unfit(scene)
                engines.append(engine)
    return engines
