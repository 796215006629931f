"""Measures of the tracer's displacement: pure functions on arrays.

S runs, T sample times, K rings. Lengths and times in the scene's own units.
"""

from typing import NamedTuple

import numpy as np

from brownpipe import theory

FEWEST_EXPECTED = 5.0  # bins with fewer expected counts are pooled before a chi-square


class Line(NamedTuple):
    """A least-squares line through points (t, y) inside a window."""

    slope: float
    intercept: float
    naive_slope_error: float  # what least squares claims for independent points; wrong for an MSD, see `fit_line`


class ChiSquare(NamedTuple):
    statistic: float
    degrees_of_freedom: int
    p: float  # chance of a larger statistic if the expectation is right; NaN without degrees of freedom


def squared_displacement(position, image=None, size=(0.0, 0.0)):
    """Squared distance from the start, (S, T), of tracks `position` (T, S, 2).

    In a periodic box of `size` (width, height), `image` (T, S, 2) counts the boxes crossed: positions are unwrapped.
    The difference of positions and of images is taken first, so that far images cost no digits.
    """
    moved = position - position[0]
    if image is not None:
        moved = moved + (image - image[0]) * np.asarray(size, float)
    return np.ascontiguousarray((moved**2).sum(axis=-1).T)


def line_weights(times, window):
    """Weights (2, T) such that slope, intercept = weights @ y is the least-squares line through y(t) in `window`.

    Points count from the window's start to its end, both included. NaN where the line is not defined: the times end
    before the window does, or fewer than three fall into it.
    """
    inside = _inside(times, window)
    if np.count_nonzero(inside) < 3:
        return np.full((2, len(times)), np.nan)
    middle = times[inside].mean()
    centred = np.where(inside, times - middle, 0.0)
    slope = centred / (centred**2).sum()
    return np.stack([slope, inside / np.count_nonzero(inside) - middle * slope])


def _inside(times, window):
    """Which times (T,) lie in the window, but for round-off; none if they do not reach its end."""
    start, end = window
    slack = 1e-9 * max(abs(start), abs(end))
    return (times >= start - slack) & (times <= end + slack) & (times[-1] >= end - slack)


def fit_line(times, values, window):
    """Least-squares line through `values` (T,) at `times` (T,) inside `window`.

    The points of an MSD curve come from the same runs, so the error least squares claims is far too small (13 times in
    the note's scene). For the slope's true error `resample` the slopes of the single runs, `per_run_lines`.
    """
    slope, intercept = (line_weights(times, window) * values).sum(axis=-1)
    inside = _inside(times, window)
    if np.isnan(slope):
        return Line(np.nan, np.nan, np.nan)
    residual = (values - intercept - slope * times)[inside]
    spread = ((times[inside] - times[inside].mean()) ** 2).sum()
    return Line(slope, intercept, np.sqrt((residual**2).sum() / (residual.size - 2) / spread))


def per_run_lines(squared, times, windows):
    """Slope and intercept of every single run over each window, (S, 2, W). Their means are those of the MSD's line."""
    lines = [(squared[:, None, :] * line_weights(times, window)).sum(axis=-1) for window in windows]
    return np.stack(lines, axis=-1)


def ring_edges(width, rings):
    """Edges (K + 1,) of `rings` rings of equal `width` around the start."""
    return width * np.arange(rings + 1)


def ring_counts(distance, edges):
    """Runs (K + 1,) that ended in each ring [edges[k], edges[k + 1]), and last those beyond the outermost edge."""
    ring = np.searchsorted(edges, distance, side="right") - 1
    return np.bincount(ring, minlength=len(edges))


def expected_ring_counts(runs, edges, t, diffusion):
    """Expected `ring_counts` (K + 1,) of `runs` free diffusers after time t, eq. (18) integrated over each ring."""
    outer = np.append(edges[1:], np.inf)
    return runs * theory.ring_probability(edges, outer, t, diffusion)


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


def _pool(observed, expected):
    """Sum neighbouring bins from the first to the last until each expects enough; the rest joins the last pool."""
    starts, waiting = [0], 0.0
    for k, count in enumerate(expected):
        waiting += count
        if waiting >= FEWEST_EXPECTED and expected[k + 1 :].sum() >= FEWEST_EXPECTED:
            starts.append(k + 1)
            waiting = 0.0
    return np.add.reduceat(observed, starts), np.add.reduceat(expected, starts)
