"""All engines and settings of a study compared with its exact runs, as one dataset."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis import variables
from brownpipe.analysis.dataset import Values, outer_join
from brownpipe.analysis.runs import Source, group_by_case
from brownpipe.analysis.variables import CASE_DIMS, ENDS, Mean, Variable, with_uncertainties
from brownpipe.engines import Engine
from brownpipe.engines.definition import REFERENCE_NAME
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.storage.datasets import origin_attributes
from brownpipe.tradeoff import timing
from brownpipe.tradeoff.compare import DIFFUSION_ALONG, EngineRuns, Numbers, compare, read_runs
from brownpipe.tradeoff.front import front_spans, measured_setting

if TYPE_CHECKING:
    import xarray


# --- the variables: biases, spreads and distances are relative to the exact result, 0.01 is 1 %

ATTRIBUTES = {
    "Conventions": "CF-1.11",
    "title": "Cost-accuracy trade-off of engines",
    "comment": (
        "CPU times, and therefore the Pareto front, are measured anew whenever this dataset is "
        "made; they differ "
        "between machines and from one measurement to the next. All other variables are "
        "reproducible to the bit. "
        "Biases are relative to exact runs of the same scene; where an interval contains 0, the "
        "bias is not resolved."
    ),
}
BEST = "no setting has a smaller total error of the MSD"
MSD = "MSD at the end"
D = "D in the window"
DISTRIBUTION = (
    "total variation distance of the distribution of displacements at the end, in ten rings"
)

COORDINATES = {
    "scene": variables.COORDINATES["scene"],
    "particles": variables.COORDINATES["particles"],
    "engine": Variable(
        ("engine",),
        None,
        "engine and its settings; `exact in X_N250`: exact runs of X with 250 disks in place of "
        "the scene",
    ),
}
_TABLE = {
    "duration": Variable(CASE_DIMS, "time", "duration of a run"),
    "window_start": Variable(CASE_DIMS, "time", "start of the window of time in which D is fitted"),
    "window_end": Variable(CASE_DIMS, "time", "end of the window of time in which D is fitted"),
    "runs": Variable(CASE_DIMS, "1", "number of runs that did not fail", (), np.int64, 0),
    "failed_runs": Variable(
        CASE_DIMS, "1", "number of runs that failed and were left out", (), np.int64, 0
    ),
    "paired_runs": Variable(
        CASE_DIMS, "1", "number of runs that start like an exact run", (), np.int64, 0
    ),
    "seconds": Variable(
        CASE_DIMS, "s", "CPU time of a run on this machine, start-up and files not counted"
    ),
    "cost_ratio": Variable(
        CASE_DIMS, "1", "CPU time of a run over that of an exact run, median of pairs taken in turn"
    ),
    "cost_ratio_low": Variable(CASE_DIMS, "1", "smallest of these ratios"),
    "cost_ratio_high": Variable(CASE_DIMS, "1", "largest of these ratios"),
    "pays_from": Variable(
        CASE_DIMS,
        "s",
        f"CPU time from which on {BEST}, unresolved biases at their 95 % upper bounds",
    ),
    "pays_to": Variable(
        CASE_DIMS, "s", f"CPU time up to which {BEST}, unresolved biases at their 95 % upper bounds"
    ),
    "may_pay_from": Variable(
        CASE_DIMS, "s", f"CPU time from which on {BEST}, estimated biases and lowest cost ratio"
    ),
    "may_pay_to": Variable(
        CASE_DIMS, "s", f"CPU time up to which {BEST}, estimated biases and lowest cost ratio"
    ),
    "msd_bias": Mean(CASE_DIMS, "1", f"relative bias of the {MSD}"),
    "msd_spread": Variable(CASE_DIMS, "1", f"relative standard deviation of the {MSD} in one run"),
    "d_bias": Mean(CASE_DIMS, "1", f"relative bias of {D}"),
    "d_spread": Variable(CASE_DIMS, "1", f"relative standard deviation of {D} in one run"),
    "displacement_bias": Variable(CASE_DIMS, "1", f"{DISTRIBUTION}, noise subtracted", ENDS),
    "displacement_spread": Variable(
        CASE_DIMS, "1", "mean distance due to noise in the distribution of one run"
    ),
    "contact_bias": Mean(
        CASE_DIMS, "1", "most significant relative deviation of g(r) near contact"
    ),
    "worst_overlap": Variable(CASE_DIMS, "1", "deepest overlap in a run, in contact distances"),
    "departure_time": Variable(
        CASE_DIMS, "time", "median time until the tracer is 0.001 R off its exact path; or inf"
    ),
}
VARIABLES = with_uncertainties(_TABLE)


def _variables_along_axes() -> dict[str, Variable]:
    """Return the variables of D along x and along y."""
    table = {}
    for name, axis in zip(DIFFUSION_ALONG, "xy", strict=True):
        diffusion = f"D along {axis} in the window"
        spread = f"relative standard deviation of {diffusion} in one run"
        table[f"{name}_bias"] = Mean(CASE_DIMS, "1", f"relative bias of {diffusion}")
        table[f"{name}_spread"] = Variable(CASE_DIMS, "1", spread)
    return with_uncertainties(table)


# In datasets with scenes whose walls make the motion along x and y differ
ALONG_AXES = _variables_along_axes()


def measure(
    paths: Iterable[Source],
    instead_of: Mapping[str, Sequence[str]] | None = None,
    window: tuple[float, float] | None = None,
    seconds_per_run: Callable[[Engine, Scene], float] | None = None,
) -> "xarray.Dataset":
    """Compare all engines of the trajectory files `paths` with the exact runs of the same scenes.

    instead_of: cheaper scenes that may replace another, {scene: [others]}; their exact runs are
    settings of that scene.
    window: (start, end) in which D is fitted [time], by default from a tenth of each scene's
    duration to its end.
    seconds_per_run: CPU seconds of a run of an engine in a scene; by default measured, in turn with
    the exact engine (`timing.ratio_to`).

    Scenes that have exact runs only are left out. `Study.refuse_tradeoff` refuses what cannot be
    compared. Raises what `group_by_case` raises.
    """
    groups = group_by_case(paths)
    all_runs = read_runs(groups)
    references = [runs for runs in all_runs if runs.is_reference]
    instead_of = instead_of or {}
    comparisons = []
    for exact in references:
        settings = _settings(exact, all_runs, instead_of.get(exact.scene.name, ()))
        if len(settings) > 1:
            comparisons.append((exact, settings))
    pieces: list[Values] = []
    for exact, settings in tracked(comparisons, "cases"):
        numbers = _with_front(_compared(exact, settings, window, seconds_per_run))
        for label, values in numbers.items():
            labels_of_case: Values = {
                "scene": [exact.scene.name],
                "particles": [exact.scene.particles],
                "engine": [label],
            }
            pieces.append(labels_of_case | values)
    replaced = {scene: [*stand_ins] for scene, stand_ins in instead_of.items()}
    options = {"instead_of": replaced, "fit_window": window}
    sources = ((group.pattern.contents, group.seeds) for group in groups)
    attributes = ATTRIBUTES | origin_attributes("tradeoff", sources, options)
    names = set().union(*pieces)
    along_axes = {name: variable for name, variable in ALONG_AXES.items() if name in names}
    return outer_join(pieces, VARIABLES | along_axes, COORDINATES, attributes)


def is_tradeoff(dataset: "xarray.Dataset") -> bool:
    """Return whether a dataset, or a case of one, is of `measure`; otherwise it is of
    `analysis.aggregate`.
    """
    return "cost_ratio" in dataset


def _settings(
    exact: EngineRuns, all_runs: Sequence[EngineRuns], stand_ins: Sequence[str]
) -> dict[str, EngineRuns]:
    """Return by label the exact runs, first, those of all other engines in the scene, and exact
    runs of scenes that may stand in for it.
    """
    settings = {exact.engine.label: exact}
    for runs in all_runs:
        if runs.scene.label == exact.scene.label:
            settings[runs.engine.label] = runs
    for name in stand_ins:
        for runs in all_runs:
            if runs.scene.name == name and runs.is_reference:
                settings[f"{REFERENCE_NAME} in {runs.scene.label}"] = runs
    return settings


def _compared(
    exact: EngineRuns,
    settings: Mapping[str, EngineRuns],
    window: tuple[float, float] | None,
    seconds_per_run: Callable[[Engine, Scene], float] | None,
) -> dict[str, Numbers]:
    """Return the variables of each setting of one scene by its label, but for the Pareto front."""
    start, end = window or (exact.times[-1] / 10, exact.times[-1])
    times = {"duration": exact.times[-1], "window_start": start, "window_end": end}
    exact_seconds = (seconds_per_run or timing.seconds_per_run)(exact.engine, exact.scene)
    numbers = {}
    for label, runs in tracked(settings.items(), "settings"):
        cost = _cost(runs, exact, exact_seconds, seconds_per_run)
        seconds = exact_seconds * cost.ratio
        is_same_scene = runs.scene.label == exact.scene.label
        biases = compare(runs, exact, (start, end), seconds, paired=is_same_scene)
        costs = {
            "cost_ratio": cost.ratio,
            "cost_ratio_low": cost.low,
            "cost_ratio_high": cost.high,
        }
        numbers[label] = times | biases | costs
    return numbers


def _cost(
    runs: EngineRuns, exact: EngineRuns, exact_seconds: float, seconds_per_run: Callable | None
) -> timing.Ratio:
    """CPU time of a run over that of an exact run, which is `exact_seconds`."""
    if runs is exact:
        return timing.Ratio(1.0, 1.0, 1.0)
    if seconds_per_run is not None:
        ratio = seconds_per_run(runs.engine, runs.scene) / exact_seconds
        return timing.Ratio(ratio, ratio, ratio)
    return timing.ratio_to((exact.engine, exact.scene), runs.engine, runs.scene)


def _with_front(numbers: Mapping[str, Numbers]) -> dict[str, Numbers]:
    """Return the variables of the settings of one scene with the CPU times [s] between which each
    is on the Pareto front of the MSD.

    `pays`: unresolved biases at their 95 % upper bound, the cost at its median. `may_pay`: biases
    at their estimates, the cost at the lower end of its range.
    """
    careful = []
    hopeful = []
    for label, values in numbers.items():
        least_seconds = values["seconds"] * values["cost_ratio_low"] / values["cost_ratio"]
        careful.append(measured_setting(label, values, careful=True))
        hopeful.append(measured_setting(label, values | {"seconds": least_seconds}))
    fronts = {"pays": front_spans(careful), "may_pay": front_spans(hopeful)}
    numbers_with_front = {}
    for label, values in numbers.items():
        times = {}
        for name, spans in fronts.items():
            start, end = spans.get(label, (np.nan, np.nan))
            times[f"{name}_from"] = start
            times[f"{name}_to"] = end
        numbers_with_front[label] = values | times
    return numbers_with_front
