"""The cost-accuracy trade-off: how far every engine and setting is from the exact one, and what a run of it costs.

`runs` reads trajectory files, `bias` compares, `cost` measures CPU times, `front` finds the Pareto front; `variables`
says what is in the dataset.
"""

import json
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.departure import SHARE, departure_time
from brownpipe.analysis.displacement import per_run_lines
from brownpipe.errors import AnalysisError
from brownpipe.tradeoff import bias, timing
from brownpipe.tradeoff.front import Setting, Stretch, pareto_front, runs_for, settings_of, total_error
from brownpipe.tradeoff.runs import Runs, read_runs, runs_of
from brownpipe.tradeoff.variables import ATTRIBUTES, VARIABLES

__all__ = [
    "Setting",
    "Stretch",
    "compare",
    "measure",
    "pareto_front",
    "read_runs",
    "runs_for",
    "runs_of",
    "settings_of",
    "spread_of",
    "total_error",
]
CURVE = 20  # times of the curve of the MSD's bias, at equal steps of the logarithm
SAME_TIME = 1e-9


class Case(NamedTuple):
    """What is compared with the exact runs of a scene, and what it is called."""

    label: str
    runs: Runs
    paired: bool


def measure(paths, instead_of=None, window=None, seconds_per_run=None):
    """All engines of the trajectory files `paths` against the exact runs of the same scenes: an `xarray.Dataset`.

    `instead_of` names scenes that may be run instead of another, {scene: [others]}; exact runs of these are settings of
    that scene. D is that of the `window` (start, end), or from a tenth of each scene's duration to its end.
    CPU times are measured in turn with the exact engine's (`timing.ratio_to`), or are `seconds_per_run(engine, scene)`.
    Raises AnalysisError for a scene without exact runs, for stand-ins without runs or with other sample times, and what
    `read_runs` raises.
    """
    groups = read_runs(paths)
    several = {one.scene.name for one in groups if one.scene.particles != _first_of(groups, one.scene.name)}
    measured = {}
    for exact in (one for one in groups if one.engine.name == "exact"):
        name = _scene_label(exact, several)
        between = window or (exact.times[-1] / 10, exact.times[-1])
        cases = _cases(exact, groups, (instead_of or {}).get(exact.scene.name, ()))
        unit, settings = (seconds_per_run or timing.seconds_per_run)(exact.engine, exact.scene), {}
        for case in cases:
            taken = _ratio(case, exact, unit, seconds_per_run)
            settings[case.label] = compare(case.runs, exact, between, unit * taken.ratio, case.paired) | {
                "cost_ratio": taken.ratio,
                "cost_ratio_low": taken.low,
                "cost_ratio_high": taken.high,
            }
        measured[name] = _scene(exact, between) | {"settings": settings}
        _note_what_pays(measured[name]["settings"])
    lacking = {_scene_label(one, several) for one in groups} - measured.keys()
    if lacking:
        raise AnalysisError(f"{min(lacking)}: no runs of the exact engine to compare with; add it to the study")
    return _dataset(measured)


def _ratio(case, exact, unit, seconds_per_run):
    """CPU time of a run of a case over that of an exact run, `unit` seconds."""
    runs = case.runs
    if runs is exact:
        return timing.Ratio(1.0, 1.0, 1.0)
    if seconds_per_run is not None:
        return timing.Ratio(*[seconds_per_run(runs.engine, runs.scene) / unit] * 3)
    return timing.ratio_to((exact.engine, exact.scene), runs.engine, runs.scene)


def _first_of(groups, name):
    return next(one.scene.particles for one in groups if one.scene.name == name)


def _scene_label(runs, several):
    name = runs.scene.name
    return f"{name}_N{runs.scene.particles}" if name in several else name


def _cases(exact, groups, others):
    """The exact runs themselves, other engines of the scene, and exact runs of the scenes that may stand in for it."""
    mine = [one for one in groups if one.key[:2] == exact.key[:2]]
    cases = [Case(one.engine.label, one, True) for one in mine]
    for other in others:
        found = [one for one in groups if (one.scene.name, one.engine.name) == (other, "exact")]
        if not found:
            raise AnalysisError(
                f"{other}: no runs of the exact engine, and so it cannot stand in for {exact.scene.name}"
            )
        for one in found:
            if not np.allclose(one.times[[0, -1]], exact.times[[0, -1]], rtol=SAME_TIME) or len(one.times) != len(
                exact.times
            ):
                raise AnalysisError(f"{other}: has other sample times than {exact.scene.name}; must have the same")
            cases.append(Case(f"exact in {other}", one, False))
    return cases


# --- one case


def _scene(exact, window):
    curve = _curve(exact.times)
    times = np.append(exact.times[curve], np.full(CURVE - len(curve), np.nan))
    known = {"digest": exact.scene.digest, "particles": exact.scene.particles, "duration": exact.times[-1]}
    return known | {"window_start": window[0], "window_end": window[1], "sample_time": times}


def _curve(times):
    """Indices of at most CURVE sample times, at equal steps of the logarithm, 0 left out."""
    return np.unique(np.rint(np.geomspace(1, len(times) - 1, CURVE)).astype(int))


def compare(runs, exact, window, seconds, paired=True):
    """Every variable of one setting: name -> value. `seconds` is what a run costs; `window` that of D.

    `paired`: runs of equal seeds begin from the same states. Raises AnalysisError for fewer than two runs.
    """
    same = bias.same_seeds(runs.seeds, exact.seeds) if paired else None
    if min(len(runs.seeds), len(exact.seeds)) < 2:
        raise AnalysisError(f"{runs.scene.name}, {runs.engine.label}: fewer than two runs that did not fail")
    same = same if same is not None and len(same[0]) > 1 else None
    drift, overlap = (runs.outcomes[name] for name in ("energy_drift", "worst_overlap"))
    return {
        "engine": json.dumps({"name": runs.engine.name, **dict(runs.engine.settings)}),
        "runs": len(runs.seeds),
        "failed_runs": runs.failed,
        "paired_runs": 0 if same is None else len(same[0]),
        "seconds": seconds,
        "study_seconds": seconds * (len(runs.seeds) + runs.failed),
        "worst_energy_drift": np.abs(drift).max(),
        "worst_overlap": overlap.max(),
        "departure_time": np.nan if same is None else _departure(runs, exact, same),
        **_biases(runs, exact, same, window),
        **_distances(runs, exact, same),
        **_contact(runs, exact, same),
    }


def spread_of(runs, observable, window):
    """Relative scatter of `msd` (at the end) or `d` (in the window) in one run: standard deviation over mean."""
    column = {"msd": 0, "d": 1}[observable]
    values = _per_run(runs, [], window)[:, column]
    return float(values.std(ddof=1) / abs(values.mean()))


def _biases(runs, exact, same, window):
    """MSD at the end, D in the window and the curve of the MSD, all in one resampling."""
    curve = _curve(exact.times)
    samples = [_per_run(one, curve, window) for one in (runs, exact)]
    found = bias.none_of(samples[1]) if runs is exact else bias.relative_bias(*samples, same)
    values = {}
    for name, column in (("msd", 0), ("d", 1)):
        one = bias.Bias(*(part[column] for part in found))
        spread = samples[0][:, column].std(ddof=1) / abs(samples[1][:, column].mean())
        values |= _with_interval(f"{name}_bias", one) | {f"{name}_spread": spread}
        values |= {f"{name}_bias_square": one.square, f"{name}_bias_careful": one.careful}
    room = CURVE - len(curve)
    curves = bias.Bias(*(np.append(part[2:], np.full(room, np.nan)) for part in found))
    return values | _with_interval("msd_curve_bias", curves)


def _per_run(runs, curve, window):
    """(S, 2 + times of the curve): r^2 at the end, slope of r^2 over the window, r^2 along the curve."""
    slope = per_run_lines(runs.squared, runs.times, [window])[:, 0]
    return np.concatenate([runs.squared[:, -1:], slope, runs.squared[:, curve]], axis=1)


def _with_interval(name, one):
    error = {f"{name}_standard_error": one.standard_error}
    return {name: one.value, **error, f"{name}_low": one.low, f"{name}_high": one.high}


def _distances(runs, exact, same):
    """The displacement distribution at the end."""
    ends = [np.sqrt(one.squared[:, -1]) for one in (runs, exact)]
    found = bias.NO_DISTANCE if runs is exact else bias.total_variation(*ends, same)
    name, careful = "displacement_bias", found.value**2 if found.low > 0.0 else found.high**2
    values = {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high, f"{name}_noise": found.noise}
    return values | {
        f"{name}_square": found.value**2,
        f"{name}_careful": careful,
        "displacement_spread": bias.spread_of_shares(),
    }


def _contact(runs, exact, same):
    """g(r) near contact, where pair counts are in the files."""
    if runs.pair_counts is None or exact.pair_counts is None:
        return {}
    shape = exact.pair_counts.shape[1:]
    if runs.pair_counts.shape[1:] != shape:  # another box, in which other distances are counted
        return {}
    counts = (runs.pair_counts, exact.pair_counts)
    found = bias.none_of(np.zeros((1,))) if runs is exact else bias.contact_deviation(*counts, same)
    return {} if found is None else _with_interval("contact_bias", found)


def _departure(runs, exact, same):
    """Median over common seeds of the time at which the tracer's track departs from the exact one; inf for never."""
    tracks = (runs.moved[same[0]].transpose(1, 0, 2), exact.moved[same[1]].transpose(1, 0, 2))
    each = np.sort(departure_time(exact.times, *tracks, SHARE * exact.scene.radius[0]))
    return float(each[len(each) // 2])


def _note_what_pays(settings):
    """Enter for each setting of a scene between which CPU times it is the best for the MSD; NaN for never.

    `pays`: a bias that is not resolved counts at its 95 % upper bound, and the cost is the median. `may_pay`: the bias
    is as found, and the cost at the lower end of its range.
    """
    unit = settings["exact"]["seconds"]
    for name, kind, ratio in (("pays", "careful", "cost_ratio"), ("may_pay", "square", "cost_ratio_low")):
        for values in settings.values():
            values |= {f"{name}_from": np.nan, f"{name}_to": np.nan}
        known = [
            Setting(key, one[f"msd_bias_{kind}"], one["msd_spread"], unit * one[ratio]) for key, one in settings.items()
        ]
        for stretch in pareto_front(sorted(known, key=lambda one: one.label != "exact")):
            one = settings[stretch.label]
            one[f"{name}_from"], one[f"{name}_to"] = np.fmin(one[f"{name}_from"], stretch.start), stretch.end


# --- the dataset


def _dataset(measured):
    import xarray

    scenes = sorted(measured)
    labels = sorted({label for one in measured.values() for label in one["settings"]})
    axes = {"scene": scenes, "setting": labels, "sample": range(CURVE)}
    data = {}
    for name, variable in VARIABLES.items():
        full = np.full([len(axes[dim]) for dim in variable.dims], variable.absent, variable.dtype)
        for i, scene in enumerate(scenes):
            if "setting" not in variable.dims:
                full[i] = measured[scene][name]
                continue
            for label, values in measured[scene]["settings"].items():
                full[i, labels.index(label)] = values.get(name, variable.absent)
        data[name] = (variable.dims, full, variable.attributes)
    coordinates = {
        "scene": ("scene", scenes, {"long_name": "scene, that exact runs stand for"}),
        "setting": (
            "setting",
            labels,
            {"long_name": "engine with its settings, and the scene it is run in if another"},
        ),
    }
    return xarray.Dataset(data, coordinates, ATTRIBUTES)
