"""Distribution of the tracer's displacement at some times: rings, chi-square and its power, kurtosis.

K rings, D times, M models. Lengths and times in the scene's own units.
"""

from typing import NamedTuple

import numpy as np

from brownpipe import theory
from brownpipe.analysis import resampling
from brownpipe.analysis.conditions import accessible_half_width
from brownpipe.analysis.displacement import SAME_TIME, from_start, labels, squared_of
from brownpipe.analysis.measure import Columns, Measure, with_interval
from brownpipe.analysis.variables import EACH, RATE, Variable, estimate_of, kept_always

FEWEST_EXPECTED = 5.0  # bins with fewer expected counts are pooled before a chi-square
WRONG_BY = 0.05  # of the D whose discovery the power is about
REFUSED = 0.01  # a model with a smaller p is ruled out


class ChiSquare(NamedTuple):
    statistic: float
    degrees_of_freedom: int
    p: float  # chance of a larger statistic if the expectation is right; NaN without degrees of freedom


def ring_edges(width, rings):
    """Edges (K + 1,) of `rings` rings of equal `width` around the start."""
    return width * np.arange(rings + 1)


def ring_counts(distance, edges):
    """Runs (K + 1,) that ended in each ring [edges[k], edges[k + 1]), and last those beyond the outermost edge."""
    ring = np.searchsorted(edges, distance, side="right") - 1
    return np.bincount(ring, minlength=len(edges))


def expected_ring_counts(runs, edges, t, diffusion, half_width=None):
    """Expected `ring_counts` (K + 1,) of `runs` diffusers after time t, eq. (18) integrated over each ring.

    With `half_width` they start in the centre of a reflecting square, `theory.reflecting_square_within`.
    """
    if half_width is None:
        return runs * theory.ring_probability(edges, np.append(edges[1:], np.inf), t, diffusion)
    within = theory.reflecting_square_within(edges, t, diffusion, half_width)
    return runs * np.diff(np.append(within, 1.0))


def chi_square(observed, expected, fitted=1):
    """Pearson's test of counts (K,) against expected counts of the same total.

    Neighbouring bins are pooled until each expects FEWEST_EXPECTED; one degree of freedom is lost to the total and one
    to each parameter `fitted` to the same runs.
    """
    observed, expected = _pool(np.asarray(observed, float), np.asarray(expected, float))
    freedom = len(expected) - 1 - fitted
    if freedom < 1 or not np.all(np.isfinite(expected)):
        return ChiSquare(np.nan, max(freedom, 0), np.nan)
    from scipy.special import gammaincc

    statistic = ((observed - expected) ** 2 / expected).sum()
    return ChiSquare(statistic, freedom, float(gammaincc(freedom / 2, statistic / 2)))


def power(expected, others, fitted=1):
    """Chance that `chi_square` at the 5 % level refuses `expected` (K,) if the counts come from `others` (K,)."""
    others, expected = _pool(np.asarray(others, float), np.asarray(expected, float))
    freedom = len(expected) - 1 - fitted
    if freedom < 1 or not np.all(np.isfinite(expected + others)):
        return np.nan
    return theory.chi_square_power(((others - expected) ** 2 / expected).sum(), freedom)


def _pool(observed, expected):
    """Sum neighbouring bins from the first to the last until each expects enough; the rest joins the last pool."""
    starts, waiting = [0], 0.0
    for k, count in enumerate(expected):
        waiting += count
        if waiting >= FEWEST_EXPECTED and expected[k + 1 :].sum() >= FEWEST_EXPECTED:
            starts.append(k + 1)
            waiting = 0.0
    return np.add.reduceat(observed, starts), np.add.reduceat(expected, starts)


# --- the measure


def chosen_times(case):
    """Which sample times (D,) the distribution is taken at: those asked for that the runs have, else the last."""
    asked = np.array(case.asked.displacement_times)
    if not asked.size:
        return np.array([len(case.times) - 1])
    nearest = np.abs(case.times - asked[:, None]).argmin(axis=1)
    return nearest[np.abs(case.times[nearest] - asked) <= SAME_TIME * asked]


def _sample(case, runs):
    squared, distance2, at = squared_of(case, runs), from_start(case, runs), chosen_times(case)
    if squared is None or distance2 is None or not len(at):
        return Columns()
    r2 = distance2[:, at]
    counts = [ring_counts(np.sqrt(column), case.asked.edges) for column in r2.T]
    return Columns({"r2": r2, "r4": r2**2}, {"r6": r2**3}, {"rings": np.stack(counts)})


def _estimate(case, found):
    if "r2" not in found:
        return {}
    counts, at = found.counts["rings"], chosen_times(case)
    low, high = resampling.wilson_interval(counts, found.runs)
    values = {
        "displacement_counts": counts[:, :-1],
        "displacement_counts_low": low[:, :-1],
        "displacement_counts_high": high[:, :-1],
        "displacement_overflow": counts[:, -1],
        **with_interval("kurtosis", kurtosis(found)),
    }
    slopes = found.mean("lines")[0] / 4
    tests = [_tests(case, t, row, _models(case, t, msd, slopes)) for t, row, msd in _each(case, found, at, counts)]
    return values | {name: [test[name] for test in tests] for name in tests[0]}


def _each(case, found, at, counts):
    return zip(case.times[at], counts, found.mean("msd")[at], strict=True)


def _models(case, t, msd, slopes):
    """(D, half-width of the reflecting square or None) of every model; a D that is not positive is NaN."""
    over_4t = msd / (4 * t) if t > 0.0 else np.nan
    models = [(d if d > 0.0 and t > 0.0 else np.nan, None) for d in (over_4t, *slopes)]
    half_width = accessible_half_width(case.scene)
    if np.isfinite(half_width):
        d = theory.reflecting_square_diffusion(msd, t, half_width) if t > 0.0 else np.nan
        models.append((d, half_width))
    return models


def _tests(case, t, counts, models):
    """Every model (M,) against the counts (K + 1,) at one time."""
    edges, runs = case.asked.edges, counts.sum()
    expected = np.stack([expected_ring_counts(runs, edges, t or 1.0, *model) for model in models])
    wrong = [expected_ring_counts(runs, edges, t or 1.0, d * (1 + WRONG_BY), half) for d, half in models]
    tests = [chi_square(counts, row) for row in expected]
    powers = [power(row, other) for row, other in zip(expected, wrong, strict=True)]
    return {
        "model_diffusion_coefficient": [d for d, _ in models],
        "expected_counts": expected[:, :-1],
        "expected_overflow": expected[:, -1],
        "chi_square": [test.statistic for test in tests],
        "degrees_of_freedom": [test.degrees_of_freedom for test in tests],
        "p_value": [test.p for test in tests],
        "power_5_percent": powers,
        "verdict": [verdict(test.p, chance) for test, chance in zip(tests, powers, strict=True)],
    }


def verdict(p, chance):
    """What a test says, in words: a test that could hardly fail says little."""
    if np.isnan(p):
        return "not tested: too few runs or no diffusion coefficient"
    seen = f"a diffusion coefficient wrong by {WRONG_BY:.0%} would be seen with a chance of {chance:.0%}"
    return f"{'ruled out' if p < REFUSED else 'not ruled out'}, p = {p:.2g}; {seen}"


def kurtosis(found):
    """<r^4> / (2 <r^2>^2) of the displacements at each time, (D,), an Estimate: 1 for a normal law in the plane.

    Its inverse cube is studentized by the delta method, in every replicate with that replicate's own moments. Of the
    powers tried it comes nearest to 95 % for a normal law: 95, 91, 93, 94 % of 600 ensembles of 20, 50, 100, 400 runs;
    the kurtosis itself 90, 88, 91, 94 %, plain percentiles 83 to 92 %.
    """
    names, squared = ("r2", "r4", "r6"), ("r2", "r4")
    cube, variance = _inverse_cube(*map(found.mean, names), *map(found.variance, squared))
    drawn, drawn_variance = _inverse_cube(*map(found.drawn, names), *map(found.drawn_variance, squared))
    error = np.sqrt(variance / (found.runs - 1)) if found.runs > 1 else np.full_like(cube, np.nan)
    degrees = resampling.degrees(found.sums)
    of_cube = resampling.studentized(found.runs, cube, error, drawn - cube, drawn_variance / degrees)
    with np.errstate(divide="ignore"):  # an interval that reaches 0 has no upper end
        low, high = (np.maximum(end, 0.0) ** (-1 / 3) for end in (of_cube.high, of_cube.low))
    mean = cube ** (-1 / 3)
    return resampling.Estimate(mean, mean * error / (3 * cube), low, high)


def _inverse_cube(m2, m4, m6, variance2, variance4):
    """(m4 / (2 m2^2))^-3 and the variance, times the number of runs, of its error; NaN at the start."""
    m2, m4 = np.where(m2 > 0.0, m2, np.nan), np.where(m4 > 0.0, m4, np.nan)
    covariance = (m6 - m2 * m4) / (m2 * m4)
    of_logarithm = 4 * variance2 / m2**2 + variance4 / m4**2 - 4 * covariance
    cube = (2 * m2**2 / m4) ** 3
    return cube, 9 * cube**2 * np.maximum(of_logarithm, 0.0)


def _axes(case, found):
    edges = case.asked.edges
    square = ["square"] if np.isfinite(accessible_half_width(case.scene)) else []
    return {
        "displacement_time": ("displacement_time", case.times[chosen_times(case)]),
        "r": ("r", (edges[1:] + edges[:-1]) / 2),
        "r_inner": ("r", edges[:-1]),
        "r_outer": ("r", edges[1:]),
        "model": ("model", ["msd", *(f"slope {label}" for label in labels(case.asked.windows)), *square]),
    }


AT = (*EACH, "displacement_time")
RING, MODEL = (*AT, "r"), (*AT, "model")

MEASURE = Measure(
    _sample,
    _estimate,
    kept_always(
        {
            "displacement_counts": Variable(RING, "1", "number of runs that are in the ring"),
            "displacement_counts_low": Variable(RING, "1", "lower end of the 95 % (Wilson) interval of the count"),
            "displacement_counts_high": Variable(RING, "1", "upper end of the 95 % (Wilson) interval of the count"),
            "displacement_overflow": Variable(AT, "1", "number of runs that are beyond the outermost ring"),
            "model_diffusion_coefficient": Variable(MODEL, RATE, "diffusion coefficient put into the model"),
            "expected_counts": Variable((*MODEL, "r"), "1", "number of runs expected in the ring, model integrated"),
            "expected_overflow": Variable(MODEL, "1", "number of runs expected beyond the outermost ring"),
            "chi_square": Variable(MODEL, "1", "chi-square of the counts, overflow included, sparse rings pooled"),
            "degrees_of_freedom": Variable(MODEL, "1", "pooled bins less one for the total and one for the fitted D"),
            "p_value": Variable(MODEL, "1", "chance of a larger chi-square if the model is right"),
            "power_5_percent": Variable(MODEL, "1", "chance that the test at the 5 % level sees a D wrong by 5 %"),
            "verdict": Variable(MODEL, "1", "what the test says, in words", object, ""),
        }
    )
    | estimate_of("kurtosis", AT, "1", "kurtosis <r^4>/(2 <r^2>^2) of the displacement, 1 for a normal law"),
    _axes,
    {
        "displacement_time": {"units": "time", "long_name": "time since the start, of the displacement distribution"},
        "r": {"units": "length", "long_name": "middle of the ring"},
        "r_inner": {"units": "length", "long_name": "inner radius of the ring"},
        "r_outer": {"units": "length", "long_name": "outer radius of the ring"},
        "model": {
            "long_name": "where the D is taken from: msd = MSD(t)/4t, slope = slope/4 of a window, both in eq. (18) of "
            "the 2020 note; square = diffusion in the reflecting square, D from MSD(t)"
        },
    },
)
