"""Distribution of the tracer's displacement at some times: rings, what eq. (18) expects in them, kurtosis, verdict.

The histogram over rings is the self part of the van Hove function, integrated over the directions. K rings, D times,
M models. Lengths and times in the scene's own units.
"""

import numpy as np

from brownpipe import theory
from brownpipe.analysis import goodness, resampling
from brownpipe.analysis.conditions import accessible_half_width
from brownpipe.analysis.displacement import SAME_TIME, from_start, labels, per_run_lines, squared_of
from brownpipe.analysis.measure import Columns, Measure, with_interval
from brownpipe.analysis.variables import EACH, RATE, Variable, estimate_of, kept_always

WRONG_BY = 0.05  # of the D whose discovery the power is about
RINGS, REACH = 32, 3.0  # where none are asked for: at most so many rings, that reach to so many rms displacements
STEP = 1e-4  # of ln D, for the derivative of what is expected


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


# --- the measure


def chosen_times(case):
    """Which sample times (D,) the distribution is taken at: those asked for that the runs have, else the last."""
    asked = np.array(case.asked.displacement_times)
    if not asked.size:
        return np.array([len(case.times) - 1])
    nearest = np.abs(case.times - asked[:, None]).argmin(axis=1)
    return nearest[np.abs(case.times[nearest] - asked) <= SAME_TIME * asked]


def rings_of(case, runs):
    """Edges (K + 1,) of the rings at each time: those asked for, else such as suit these runs, the first of a study.

    Their width is a power of two, so that the rings of two times or scenes are the same or have different middles. They
    reach to REACH rms displacements; half of RINGS of them or more.
    """
    at = chosen_times(case)
    if case.asked.edges is not None:
        return (case.asked.edges,) * len(at)
    squared = from_start(case, runs)
    if squared is None:
        return ()
    size = max(case.scene.box.width, case.scene.box.height)
    reach = [REACH * np.sqrt(np.mean(column)) or size for column in squared[:, at].T]
    widths = [np.ldexp(1.0, int(np.ceil(np.log2(far / RINGS)))) for far in reach]
    return tuple(ring_edges(width, int(np.ceil(far / width))) for width, far in zip(widths, reach, strict=True))


def _sample(case, runs):
    squared, distance2, at = squared_of(case, runs), from_start(case, runs), chosen_times(case)
    if squared is None or distance2 is None or not len(at):
        return Columns()
    r2, slopes = distance2[:, at], per_run_lines(squared, case.times, case.asked.windows)[:, 0]
    size = max(map(len, case.edges))
    counts, shared = [], []
    for k, column, edges in zip(at, r2.T, case.edges, strict=True):
        ring = np.searchsorted(edges, np.sqrt(column), side="right") - 1
        counts.append(np.bincount(ring, minlength=size))
        shared.append([np.bincount(ring, one, size) for one in (squared[:, k], *slopes.T)])
    return Columns({"r2": r2, "r4": r2**2}, {"r6": r2**3}, {"rings": np.array(counts), "shared": np.array(shared)})


def _estimate(case, found):
    if "r2" not in found:
        return {}
    edges, counts = case.edges, found.counts["rings"]
    low, high = resampling.wilson_interval(counts, found.runs)
    spread = kurtosis(found)
    chances = [goodness.kurtosis_p_value(value, found.runs) for value in spread.mean]
    values = {
        "displacement_counts": _on_axis(edges, counts),
        "displacement_counts_low": _on_axis(edges, low),
        "displacement_counts_high": _on_axis(edges, high),
        "displacement_overflow": [row[len(own) - 1] for row, own in zip(counts, edges, strict=True)],
        "kurtosis_p_value": chances,
        **with_interval("kurtosis", spread),
    }
    tests = [_tests(case, found, k, chance) for k, chance in enumerate(chances)]
    values |= {name: [test[name] for test in tests] for name in tests[0]}
    return values | {"expected_counts": _on_axis(edges, values["expected_counts"])}


def _on_axis(edges, values):
    """Values (..., >= K) of each time on the axis (R,) of the rings of all times, (D, ..., R); NaN for other rings."""
    axis, rows = _axis(edges)[0], []
    for own, row in zip(edges, map(np.asarray, values), strict=True):
        full = np.full((*row.shape[:-1], len(axis)), np.nan)
        full[..., np.searchsorted(axis, (own[1:] + own[:-1]) / 2)] = row[..., : len(own) - 1]
        rows.append(full)
    return np.array(rows)


def _axis(edges):
    """Middle, inner and outer radius (R,) of all rings of any time."""
    rings = np.unique(np.concatenate([np.stack([(e[1:] + e[:-1]) / 2, e[:-1], e[1:]], axis=1) for e in edges]), axis=0)
    return rings.T


def _models(case, found, k):
    """D, half-width of the reflecting square or None, and where D comes from, of every model at the k-th time.

    D is NaN where it is not positive. The sources, `goodness.Estimated`, are without the change of what is expected.
    """
    at = chosen_times(case)[k]
    t, rings, half_width = case.times[at], len(case.edges[k]), accessible_half_width(case.scene)
    means = np.array([found.mean("msd")[at], *found.mean("lines")[0]])
    variances = np.array([found.variance("msd")[at], *found.variance("lines")[0]])
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = (found.counts["shared"][k] / means[:, None] - found.counts["rings"][k])[:, :rings]
        sources = [goodness.Estimated(None, *one) for one in zip(shares, variances / means**2, strict=True)]
        diffusion = means / np.array([4 * t, *np.full(len(means) - 1, 4.0)])
    known = np.where((diffusion > 0.0) & (t > 0.0), diffusion, np.nan)
    models = [(d, None, source) for d, source in zip(known, sources, strict=True)]
    if np.isfinite(half_width):
        own, more = (
            theory.reflecting_square_diffusion(means[0] * scale, t, half_width) if t > 0.0 else np.nan
            for scale in (1.0, 1.0 + STEP)
        )
        models.append((own, half_width, sources[0]._replace(elasticity=(more / own - 1.0) / STEP)))
    return models


def _tests(case, found, k, kurtosis_chance):
    """Every model (M,) against the counts (K + 1,) at one time."""
    edges, counts = case.edges[k], found.counts["rings"][k][: len(case.edges[k])]
    t, runs, tests = case.times[chosen_times(case)[k]], counts.sum(), []
    for d, half_width, source in _models(case, found, k):
        expected, more, less, *wrong = (
            expected_ring_counts(runs, edges, t or 1.0, d * scale, half_width)
            for scale in (1.0, np.exp(STEP), np.exp(-STEP), 1 + WRONG_BY, 1 - WRONG_BY)
        )
        source = source._replace(change=(more - less) / (2 * STEP))
        test = goodness.chi_square(counts, expected, source)
        of_shape = np.nan if half_width is not None else kurtosis_chance
        alone = goodness.LEVEL / (1 if np.isnan(of_shape) else 2)
        powers = (
            [goodness.power(expected, other, source, alone) for other in wrong] if np.isfinite(test.p) else [np.nan]
        )
        tests.append(
            {
                "model_diffusion_coefficient": d,
                "expected_counts": expected[:-1],
                "expected_overflow": expected[-1],
                "chi_square": test.statistic,
                "degrees_of_freedom": test.degrees_of_freedom,
                "p_value": test.p,
                "p_value_joint": goodness.both(test.p, of_shape) if np.isfinite(test.p) else np.nan,
                "power_5_percent": min(powers),
                "verdict": verdict(test.p, of_shape, min(powers)),
            }
        )
    return {name: [test[name] for test in tests] for name in tests[0]}


def verdict(p, kurtosis_p, chance):
    """What the tests of a model say, in words: by rings, by kurtosis, and what the rings could have shown."""
    if np.isnan(p):
        return "not tested: too few runs, too few rings with runs, or no diffusion coefficient"
    said = "rejected" if goodness.both(p, kurtosis_p) < goodness.LEVEL else "not rejected"
    shape = "" if np.isnan(kurtosis_p) else f", kurtosis {goodness.in_words(kurtosis_p)}"
    seen = f"power: a D wrong by {WRONG_BY:.0%} is rejected with probability {chance:.0%}"
    return f"{said} at {goodness.LEVEL:.0%}: rings {goodness.in_words(p)}{shape}; {seen}"


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
    square = ["square"] if np.isfinite(accessible_half_width(case.scene)) else []
    r, inner, outer = _axis(case.edges or (ring_edges(1.0, 1) if case.asked.edges is None else case.asked.edges,))
    return {
        "displacement_time": ("displacement_time", case.times[chosen_times(case)]),
        "r": ("r", r),
        "r_inner": ("r", inner),
        "r_outer": ("r", outer),
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
            "degrees_of_freedom": Variable(MODEL, "1", "pooled bins less one for the total and one for D"),
            "p_value": Variable(MODEL, "1", "chance of a larger chi-square if the model holds, D being estimated"),
            "p_value_joint": Variable(
                MODEL, "1", "p-value of rings and kurtosis together; of the square, of rings alone"
            ),
            "power_5_percent": Variable(
                MODEL, "1", "chance that the verdict's test of the rings rejects a D wrong by 5 %"
            ),
            "verdict": Variable(MODEL, "1", "what the tests say at the 1 % level, in words", object, ""),
            "kurtosis_p_value": Variable(AT, "1", "chance of a kurtosis as far from 1 if the displacement is normal"),
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
