"""Distribution of the tracer's displacement at some times: counts in rings, eq. (18), kurtosis,
goodness of fit.

The histogram over rings is the self part of the van Hove function (L. Van Hove, Phys. Rev. 95, 249
(1954)), integrated over directions. K rings, D times, M models, n runs. Lengths and times in the
reduced units of the scene. See docs/theory.md, sections 2 and 5.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe import theory
from brownpipe.analysis import displacement, goodness, resampling
from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.resampling import FEWEST_FOR_INTERVAL, Estimate
from brownpipe.analysis.variables import (
    CASE_DIMS,
    ENDS,
    ERROR,
    RATE,
    SAME_TIME,
    TIME,
    Mean,
    Variable,
    with_intervals,
)
from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.windows import window_labels

WRONG_BY = 0.05  # relative error of D for which the power is stated
# default rings: at most MOST_RINGS, out to REACH rms displacements
MOST_RINGS = 32
REACH = 3.0
# of the runs that default rings are chosen from: the largest share beyond the last ring
BEYOND = 0.02
# runs (tracer alone) for a control variate: with 100 its stated error is 0.8 of the true one
FEWEST_TO_CONTROL = 200
LOG_STEP = 1e-4  # step in ln D for derivatives of the expected counts


def ring_of(distance: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the number k (n,) of the ring [edges[k], edges[k + 1]) at each distance; K beyond the
    outermost edge.
    """
    return np.searchsorted(edges, distance, side="right") - 1


def expected_ring_counts(
    runs: int, edges: np.ndarray, t: float, diffusion: float, half_width: float | None = None
) -> np.ndarray:
    """Return how many of `runs` diffusers eq. (18) expects in each ring and beyond the last, (K +
    1,), after time t.

    With `half_width` they start in the centre of a reflecting square,
    `theory.reflecting_square_within`.
    """
    if half_width is None:
        return runs * theory.ring_probability(edges, np.append(edges[1:], np.inf), t, diffusion)
    within = theory.reflecting_square_within(edges, t, diffusion, half_width)
    return runs * np.diff(np.append(within, 1.0))


# --- the estimator


def chosen_times(case: Case) -> np.ndarray:
    """Return the indices (D,) of the sample times at `displacement_times`; by default of the last
    sample.

    Times at which the case has no sample are left out.
    """
    times = np.array([*case.displacement_times] or case.times[-1:])
    nearest = np.abs(case.times - times[:, None]).argmin(axis=1)
    return nearest[np.abs(case.times[nearest] - times) <= SAME_TIME * times]


def rings_of(case: Case, blocks: Sequence[Ensemble]) -> tuple[np.ndarray, ...]:
    """Return the edges (K + 1,) of the rings at each of the D times: `edges`, else chosen from
    these runs.

    MOST_RINGS/2 to MOST_RINGS rings extend to REACH rms displacements, or further if more than
    BEYOND of the runs end beyond (for a Gaussian in the plane, eq. (18), these are exp(-REACH^2) =
    0.01 %). Their width is a power of two, so that rings of two times or scenes either coincide or
    have different centres.
    """
    samples = chosen_times(case)
    if case.edges is not None:
        return (case.edges,) * len(samples)
    squares = displacement.known_arrays(
        displacement.tracer_square_displacement(case, runs) for runs in blocks
    )
    if not squares:
        return ()
    r2 = np.concatenate([square[:, samples] for square in squares])
    edges = []
    for r2_at_time in r2.T:
        nearly_all = np.sqrt(np.quantile(r2_at_time, 1 - BEYOND, method="higher"))
        reach = max(REACH * np.sqrt(np.mean(r2_at_time)), nearly_all) or 1.0  # nothing moves
        width = 2.0 ** np.ceil(np.log2(reach / MOST_RINGS))
        edges.append(width * np.arange(np.ceil(reach / width) + 1))
    return tuple(edges)


def distribution_columns(case: Case, runs: Ensemble) -> Columns:
    """Return powers of r at the displacement times, counts in the rings, and moments for the
    non-Gaussian parameter.
    """
    samples = chosen_times(case)
    squared = displacement.squared_of(case, runs)
    tracer_squared = displacement.tracer_square_displacement(case, runs)
    moments = _moments_within_runs(case, runs, squared)
    if squared is None or tracer_squared is None or not len(samples):
        return Columns(moments)
    r2 = tracer_squared[:, samples]
    slopes = displacement.per_run_lines(squared, case.times, case.windows)[:, 0]
    size = max(map(len, case.rings))
    counts = []
    shared = []
    for sample, r2_at_time, edges in zip(samples, r2.T, case.rings, strict=True):
        ring = ring_of(np.sqrt(r2_at_time), edges)
        counts.append(np.bincount(ring, minlength=size))
        sources_of_d = [squared[:, sample], *slopes.T]
        shared.append([np.bincount(ring, source, size) for source in sources_of_d])
    sums = {"rings": np.array(counts), "shared": np.array(shared)}
    return Columns({"r2": r2, "r4": r2**2, "r6": r2**3, **moments}, sums)


def _moments_within_runs(
    case: Case, runs: Ensemble, squared: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Return the columns of r^4 and r^2 r^4 if the runs have r^4, averaged as r^2 is, else {}."""
    are_alike = "square_displacement" in runs.observables or case.average == "runs"
    if squared is None or not are_alike or "quartic_displacement" not in runs.observables:
        return {}
    quartic = runs.observables["quartic_displacement"]
    return {"quartic_displacement": quartic, "square_times_quartic": squared * quartic}


def at_each_time(case: Case, averages: Averages) -> Iterator[dict[str, ArrayLike]]:
    """Yield the values of all variables and coordinates at each of the displacement times, which
    have own rings.
    """
    models = ["msd", *(f"slope {label}" for label in window_labels(case.windows))]
    if np.isfinite(displacement.accessible_half_width(case.scene)):
        models.append("square")
    samples = chosen_times(case)
    if "r2" not in averages.places:
        edges = np.arange(2.0) if case.edges is None else case.edges
        yield {"displacement_time": case.times[samples], "model": models} | _rings(edges)
        return
    kurtoses = kurtosis(averages)
    for k, (sample, edges) in enumerate(zip(samples, case.rings, strict=True)):
        counts = averages.totals["rings"][k][: len(edges)]
        p_value = goodness.kurtosis_p_value(kurtoses.mean[k], averages.runs)
        values: dict[str, ArrayLike] = {"displacement_time": [case.times[sample]], "model": models}
        values |= _rings(edges)
        values |= _tests(case, averages, k, p_value)
        values |= _counts_with_intervals(counts, averages.runs)
        values["kurtosis_p_value"] = p_value
        values |= with_intervals({"kurtosis": kurtoses.at(k)})
        yield values


def _counts_with_intervals(counts: np.ndarray, runs: int) -> dict[str, ArrayLike]:
    """Return the counts (K + 1,) in the rings, with their 95 % intervals, and beyond the last."""
    low, high = resampling.wilson_interval(counts[:-1], runs)
    return {
        "displacement_counts": counts[:-1],
        "displacement_counts_low": low,
        "displacement_counts_high": high,
        "displacement_overflow": counts[-1],
    }


def _rings(edges: np.ndarray) -> dict[str, np.ndarray]:
    """Return the middle, inner and outer radius of the rings."""
    inner = edges[:-1]
    outer = edges[1:]
    return {"r": (outer + inner) / 2, "r_inner": inner, "r_outer": outer}


class Model(NamedTuple):
    """A model of the distribution and its D, with what `goodness.chi_square` needs to know of the
    source of D.
    """

    diffusion: float
    half_width: float | None  # of a reflecting square, None for the plane
    shared: np.ndarray  # (K + 1,)
    variance: float


def _tests(case: Case, averages: Averages, k: int, kurtosis_p: float) -> dict[str, np.ndarray]:
    """Return the tests of all models against the counts at the k-th time, by variable."""
    edges = case.rings[k]
    t = case.times[chosen_times(case)[k]]
    counts = averages.totals["rings"][k][: len(edges)]
    tests = [
        _test(counts, edges, t, kurtosis_p, model) for model in _models(case, averages, k, counts)
    ]
    return {name: np.array([test[name] for test in tests]) for name in tests[0]}


def _models(case: Case, averages: Averages, k: int, counts: np.ndarray) -> list[Model]:
    """Return the models at the k-th time, whose `counts` (K + 1,) are to be tested.

    D is the mean of r^2/4t or of a slope over 4, or that which gives the reflecting square this
    mean of r^2; NaN if the mean is not positive, and in channels: their motion along x and y
    differs, so that no model has one D for both.
    """
    sample = chosen_times(case)[k]
    t = case.times[sample]
    msd, msd_variance = resampling.moments(averages.sums_of("msd"), 0)
    slope, slope_variance = resampling.moments(averages.sums_of("slope"), 0)
    means = np.append(msd[0, sample], slope[0])
    is_alike = not case.scene.box.is_channel
    means = np.where((means > 0.0) & is_alike, means, np.nan)
    variances = np.append(msd_variance[0, sample], slope_variance[0]) / means**2
    diffusion = means / 4 / np.append(t, np.ones(len(case.windows)))
    shared = averages.totals["shared"][k][:, : len(counts)] / means[:, None] - counts
    sources_of_d = zip(diffusion, shared, variances, strict=True)
    models = [Model(d, None, shared, variance) for d, shared, variance in sources_of_d]
    half_width = displacement.accessible_half_width(case.scene)
    if np.isfinite(half_width):
        models.append(_model_of_square(means[0], t, half_width, models[0]))
    return models


def _model_of_square(msd: float, t: float, half_width: float, plane: Model) -> Model:
    """Return the model of the reflecting square with this MSD, from that of the plane."""
    larger = msd * (1.0 + LOG_STEP)
    d = theory.reflecting_square_diffusion(msd, t, half_width)
    larger_d = theory.reflecting_square_diffusion(larger, t, half_width)
    elasticity = (larger_d / d - 1.0) / LOG_STEP  # d ln D/d ln MSD
    return Model(d, half_width, elasticity * plane.shared, elasticity**2 * plane.variance)


def _test(
    counts: np.ndarray, edges: np.ndarray, t: float, kurtosis_p: float, model: Model
) -> dict[str, ArrayLike]:
    """Return the test of one model: variable -> value."""

    def counts_at(scale: float) -> np.ndarray:  # expected with this multiple of D
        diffusion = model.diffusion * scale
        return expected_ring_counts(counts.sum(), edges, t, diffusion, model.half_width)

    expected = counts_at(1.0)
    raised = counts_at(float(np.exp(LOG_STEP)))
    lowered = counts_at(float(np.exp(-LOG_STEP)))
    change = (raised - lowered) / (2 * LOG_STEP)
    test = goodness.chi_square(counts, expected, change, model.shared, model.variance)
    shape_p = kurtosis_p if model.half_width is None else np.nan
    level = goodness.LEVEL / (1 + np.isfinite(shape_p))
    powers = [
        goodness.power(expected, counts_at(scale), level) for scale in (1 + WRONG_BY, 1 - WRONG_BY)
    ]
    return {
        "model_diffusion_coefficient": model.diffusion,
        "expected_counts": expected[:-1],
        "expected_overflow": expected[-1],
        "chi_square": test.statistic,
        "degrees_of_freedom": test.degrees_of_freedom,
        "p_value": test.p,
        "p_value_joint": goodness.both(test.p, shape_p),
        "power_5_percent": min(powers),
    }


def kurtosis(averages: Averages, names: Sequence[str] = ("r2", "r4", "r6")) -> Estimate:
    """Return <r^4> / (2 <r^2>^2) of the displacements at each time, (D,): 1 for a normal
    distribution in the plane.

    `names` of the columns: r^2 and r^4 of each run, which may be averages within the run, and their
    product. The bootstrap-t is applied to its inverse cube, studentized by the delta method with
    the moments of each replicate. Of the powers tried this one has the best coverage for a normal
    distribution: 95, 91, 93 and 94 % of 600 ensembles of 20, 50, 100 and 400 runs; the kurtosis
    itself has 90, 88, 91 and 94 %, plain percentiles 83 to 92 %.
    """
    sums = map(averages.sums_of, names)
    cube = resampling.estimate(*sums, function=_inverse_cube)
    with np.errstate(over="ignore", divide="ignore"):  # an interval that reaches 0 has no upper end
        mean = _inverse_cube_root(cube.mean)
        low = _inverse_cube_root(cube.high)
        high = _inverse_cube_root(cube.low)
    return Estimate(mean, mean * cube.standard_error / (3 * cube.mean), low, high)


def _inverse_cube_root(cube: np.ndarray) -> np.ndarray:
    return np.exp(np.log(np.maximum(cube, 0.0)) / -3.0)


def _inverse_cube(
    m2: np.ndarray, m4: np.ndarray, m6: np.ndarray, *variances: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(m4 / (2 m2^2))^-3, and the square of its standard error times n - 1; NaN at t = 0."""
    m2 = np.where(m2 > 0.0, m2, np.nan)
    m4 = np.where(m4 > 0.0, m4, np.nan)
    covariance = (m6 - m2 * m4) / (m2 * m4)
    variance_of_log = 4 * variances[0] / m2**2 + variances[1] / m4**2 - 4 * covariance
    cube = (2 * m2**2 / m4) ** 3
    return cube, 9 * cube**2 * np.maximum(variance_of_log, 0.0)


# --- the non-Gaussian parameter: the kurtosis minus 1 at each sample time, with all averages within
# the runs

# r^2, r^4 and their product; `displacement` has msd
MOMENTS = ("msd", "quartic_displacement", "square_times_quartic")


def distribution_results(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return the non-Gaussian parameter; for the rest see `at_each_time`."""
    if "quartic_displacement" not in averages.places:
        return {}
    mean, error, low, high = kurtosis(averages, MOMENTS)
    parameter = Estimate(mean - 1, error, low - 1, high - 1)
    values: dict[str, ArrayLike] = {"non_gaussian_parameter": parameter}
    fewest = FEWEST_TO_CONTROL if case.average == "runs" else FEWEST_FOR_INTERVAL
    if averages.runs >= fewest:
        values |= _controlled(averages, parameter.mean)
    return values


def _controlled(averages: Averages, value: np.ndarray) -> dict[str, np.ndarray]:
    """Non-Gaussian parameter (T,) with its value at the first sample after t = 0 as control
    variate.

    If that sample is well within the mean free time, its value is that of the initial velocities: 0
    on average for normal ones, and its scatter is subtracted. {} with few samples, or if nothing
    moves. Coefficient and standard error are calculated from the replicates of the bootstrap.
    """
    if len(value) < 2 or not np.isfinite(value[1:]).all():
        return {}
    r2 = _means_of_replicates(averages, "msd")
    r4 = _means_of_replicates(averages, "quartic_displacement")
    change = r4 / (2 * r2**2) - 1 - value[1:]
    first = change[:, :1]
    b = (change * first).mean(axis=0) / (first**2).mean()
    error = np.sqrt(((change - b * first) ** 2).mean(axis=0))
    name = "non_gaussian_parameter_controlled"
    controlled = value[1:] - b * value[1]
    return {name: np.append(np.nan, controlled), f"{name}_standard_error": np.append(np.nan, error)}


def _means_of_replicates(averages: Averages, name: str) -> np.ndarray:
    """Return a mean over runs (B, T - 1) after t = 0 in the replicates that have runs."""
    means, _ = resampling.moments(averages.sums_of(name))
    has_runs = np.isfinite(means).all(axis=1)
    has_runs[0] = False  # all runs, as they are
    return means[has_runs, 1:]


MODELS = (
    "model and source of D: msd = MSD(t)/4t, slope = slope/4 in a window, both with eq. (18) of "
    "the 2020 note; "
    "square = diffusion in a reflecting square, D from MSD(t)"
)
AT = (*CASE_DIMS, "displacement_time")
RING = (*AT, "r")
MODEL = (*AT, "model")

MEANING = (
    "non-Gaussian parameter <r^4>/(2 <r^2>^2) - 1 of the displacement, 0 for a normal distribution"
)

AT_TIMES = {
    "displacement_counts": Variable(RING, "1", "number of runs in the ring", ENDS),
    "displacement_overflow": Variable(AT, "1", "number of runs beyond the outermost ring"),
    "model_diffusion_coefficient": Variable(MODEL, RATE, "diffusion coefficient of the model"),
    "expected_counts": Variable(
        (*MODEL, "r"), "1", "number of runs expected in the ring by the model"
    ),
    "expected_overflow": Variable(
        MODEL, "1", "number of runs expected beyond the outermost ring by the model"
    ),
    "chi_square": Variable(
        MODEL, "1", "chi-square of the counts, overflow included, sparse rings pooled"
    ),
    "degrees_of_freedom": Variable(
        MODEL, "1", "number of pooled bins minus one for the total and one for D"
    ),
    "p_value": Variable(MODEL, "1", "p-value of the chi-square, D estimated from the same runs"),
    "p_value_joint": Variable(
        MODEL, "1", "p-value of rings and kurtosis together; for the square that of the rings"
    ),
    "power_5_percent": Variable(
        MODEL, "1", "power: chance that the test of the rings rejects a D wrong by 5 %"
    ),
    "kurtosis_p_value": Variable(AT, "1", "p-value of the kurtosis for a normal displacement"),
    "kurtosis": Mean(
        AT, "1", "kurtosis <r^4>/(2 <r^2>^2) of the displacement, 1 for a normal distribution"
    ),
}
VARIABLES = AT_TIMES | {
    "non_gaussian_parameter": Mean(TIME, "1", MEANING),
    "non_gaussian_parameter_controlled": Variable(
        TIME, "1", f"{MEANING}; control variate: the first after 0", ERROR
    ),
}
COORDINATES = {
    "displacement_time": Variable(
        ("displacement_time",), "time", "time of the displacement distribution"
    ),
    "r": Variable(("r",), "length", "middle of the ring"),
    "r_inner": Variable(("r",), "length", "inner radius of the ring"),
    "r_outer": Variable(("r",), "length", "outer radius of the ring"),
    "model": Variable(("model",), None, MODELS),
}

ESTIMATOR = Estimator(
    name="distribution",
    variables=VARIABLES,
    columns=distribution_columns,
    results=distribution_results,
    coordinates=COORDINATES,
)
