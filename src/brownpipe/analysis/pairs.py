"""Pair distribution function g(r), its value at contact from g(r) and from collision rates; the density at the walls.

P pairs of species, R bins of distance, K species, B bins of distance from a wall, n runs. See docs/theory.md,
section 3.
"""

import numpy as np
from numpy.typing import ArrayLike

from brownpipe import theory
from brownpipe.analysis import resampling
from brownpipe.analysis.estimator import Averages, Case, Columns
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.thermodynamics import mean_root, temperature
from brownpipe.analysis.variables import EACH, Mean, Variable
from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.friction import DENSEST
from brownpipe.observables import profile
from brownpipe.observables.pairs import bins, species_pairs
from brownpipe.observables.species import species_table
from brownpipe.observables.time_origins import is_stationary
from brownpipe.scene import Scene

NEAR = 1.2  # upper end, in contact distances, of the fit of g(r) that is extrapolated to contact
ORDER = 2  # of the polynomial that multiplies the decay there
DECAY_AT_WALL = 2.2  # -d ln n/dz over phi chi near a wall, in diameters; theory has 8/pi at phi = 0
DECAY = 1.6  # -d ln g/dr over phi chi up to NEAR, in contact distances; from simulations at phi = 0.5 and 0.65
COUNTED = ("pair_collisions", "tracer_collisions", "kinetic_energy")  # numbers of a run
FEW = 20  # pairs in a bin, of all runs together
NORMAL = 1.96  # standard errors in half a 95 % interval


def numbers_of_pairs(scene: Scene) -> tuple:
    """Return the table of species, and for every pair of them, a <= b, (a, b, number of pairs of disks)."""
    table = species_table(scene)
    every = np.triu(np.outer(table.number, table.number)) - np.diag(table.number * (table.number + 1) / 2)
    return table, [(a, b, every[a, b]) for a, b in species_pairs(table)]


def contact_distances(scene: Scene) -> list[float]:
    """Return the distance [length] of the two disks at contact for every pair of species."""
    kinds, pairs = numbers_of_pairs(scene)
    return [kinds.radius[a] + kinds.radius[b] for a, b, _ in pairs]


def ideal(scene: Scene, edges: np.ndarray) -> np.ndarray:
    """Return the number of pairs (P, R) between `edges` (R + 1,) [length] expected for an ideal gas in this box.

    Periodic box: the area of the ring over that of the box. Walls: two uniform points, each in the rectangle accessible
    to its species, so that g(r) = 1 for an ideal gas at all distances. A lone disk need not be distributed uniformly:
    see `_of_ideal`.
    """
    kinds, pairs = numbers_of_pairs(scene)
    if scene.box.periodic:
        share = np.pi * np.diff(edges**2) / scene.box.area
        return np.array([number * share for _, _, number in pairs])
    areas = [scene.box.accessible(radius)[1] for radius in kinds.radius]
    return np.array([number * theory.pair_distance_probability(edges, areas[a], areas[b]) for a, b, number in pairs])


def decays(scene: Scene) -> np.ndarray:
    """Return -d ln g/dr (P,) [1/contact distance] just beyond contact, approximately."""
    kinds, pairs = numbers_of_pairs(scene)
    phi = min(scene.packing_fraction, DENSEST)
    density = kinds.number / scene.box.area * (phi / scene.packing_fraction)
    chi = theory.mixture_contact_values(density, 2 * kinds.radius)
    return np.array([DECAY * phi * chi[a, b] for a, b, _ in pairs])


def contact_weights(edges: np.ndarray, contact: float, decay: float, flat: bool = False) -> np.ndarray:
    """Return weights (2, R) of g(r) in its bins: for the value at contact, and for its change by the next order.

    With x = r/contact - 1, a polynomial of degree ORDER in x times (1 + decay x/16)^-16, nearly exponential, is fitted
    to the averages of g over the areas of the bins up to NEAR, by least squares with the areas as weights. The bins are
    rings, or strips along a wall if `flat`. NaN if there are too few bins for the next degree.
    """
    inside = (edges[:-1] >= contact * (1 - 1e-9)) & (edges[1:] <= contact * NEAR * (1 + 1e-9))
    weights = np.zeros((2, len(inside)))
    if np.count_nonzero(inside) < ORDER + 2:
        return np.full(weights.shape, np.nan)
    low, high = edges[:-1][inside] / contact, edges[1:][inside] / contact
    area = high - low if flat else high**2 - low**2
    basis: list[tuple[np.ndarray, float]] = []  # orthonormal columns, and the value of each at contact
    for degree in range(ORDER + 2):
        column, at_contact = _bin_averages(low, high, degree, decay, flat), float(degree == 0)
        for other, value in basis:  # Gram-Schmidt
            along = (area * column * other).sum()
            column, at_contact = column - along * other, at_contact - along * value
        norm = np.sqrt((area * column**2).sum())
        basis.append((column / norm, at_contact / norm))
        weights[int(degree > ORDER), inside] += area * basis[-1][0] * basis[-1][1]
    return weights


def _bin_averages(low: np.ndarray, high: np.ndarray, degree: int, decay: float, flat: bool) -> np.ndarray:
    """Averages over the areas of bins of x^degree (1 + decay x/16)^-16, by three-point Gauss-Legendre quadrature."""
    total = np.zeros(len(low))
    for node, weight in ((-np.sqrt(0.6), 5 / 18), (0.0, 8 / 18), (np.sqrt(0.6), 5 / 18)):
        r = (low + high) / 2 + node * (high - low) / 2
        f = 1.0 / (1.0 + decay * (r - 1.0) / 16)
        for _ in range(4):
            f = f * f
        for _ in range(degree):
            f = f * (r - 1.0)
        total = total + weight * (f if flat else r * f)
    return total if flat else total / ((low + high) / 2)


def wall_weights(scene: Scene) -> np.ndarray:
    """Return weights (2, K, B) of the profiles: for the density at contact, and for its change by the next order.

    `contact_weights` for a flat wall, up to a fifth of a diameter from it.
    """
    phi = min(scene.packing_fraction, DENSEST)
    number, width = profile.bins(scene)
    edges, diameters = np.arange(number + 1) * width, 2 * species_table(scene).radius
    decay = DECAY_AT_WALL * phi * float(theory.contact_value(phi))
    return np.stack([contact_weights(edges + one, one, decay, flat=True) for one in diameters], axis=1)


def truncation(following: Estimate) -> np.ndarray:
    """Return the truncation error from the next order: sqrt(mean^2 - standard error^2), or 0."""
    return np.sqrt(np.maximum(following.mean**2 - following.standard_error**2, 0.0))


def widened(estimate: Estimate, error: np.ndarray) -> Estimate:
    """Return the Estimate with a systematic `error` added in quadrature to its standard error and interval."""
    reach = [np.sqrt((end - estimate.mean) ** 2 + (NORMAL * error) ** 2) for end in (estimate.low, estimate.high)]
    total = np.sqrt(estimate.standard_error**2 + error**2)
    return Estimate(estimate.mean, total, estimate.mean - reach[0], estimate.mean + reach[1])


def contact_from_rate(scene: Scene, collisions: np.ndarray, kt: np.ndarray, duration: float) -> np.ndarray:
    """Return contact values (n, P) from `collisions` (n, P) of runs of temperature `kt` (n,), in equilibrium.

    A pair collides at the rate p(sigma) chi sqrt(kT/(2 pi mu)), p the density of its distance in an ideal gas: the flux
    through contact of a Maxwell-Boltzmann distribution of relative velocities (S. Chapman and T. G. Cowling, The
    Mathematical Theory of Non-Uniform Gases, ch. 5, in two dimensions). At the constant energy of a run the mean speed
    is larger by 1/`thermodynamics.mean_root`.
    """
    kinds, pairs = numbers_of_pairs(scene)
    areas = [scene.box.accessible(radius)[1] for radius in kinds.radius]
    chi = np.full(collisions.shape, np.nan)
    for k, (a, b, number) in enumerate(pairs):
        contact, mu = kinds.radius[a] + kinds.radius[b], theory.reduced_mass(kinds.mass[a], kinds.mass[b])
        near = 2 * np.pi * contact / scene.box.area
        p = near if scene.box.periodic else float(theory.pair_distance_density_between(contact, areas[a], areas[b]))
        if number > 0 and p > 0:
            expected = duration * number * p * np.sqrt(kt / (2 * np.pi * mu)) / mean_root(scene)
            chi[:, k] = collisions[:, k] / expected
    return chi


def _by_rate(case: Case, runs: Ensemble) -> dict[str, np.ndarray]:
    """Columns of contact values from collisions; none if the runs are not in equilibrium from t = 0.

    The collisions of each pair of species are known for one species, and for one beside a single tracer.
    """
    scene, seen = case.scene, runs.observables
    if not is_stationary(scene) or not seen.keys() >= {*COUNTED}:
        return {}
    every, tracers, energy = (np.asarray(seen[name], float) for name in COUNTED)
    number = species_table(scene).number
    if len(number) == 1 and number[0] > 1:
        collisions = every[:, None]
    elif len(number) == 2 and number[0] == 1:
        collisions = np.stack([np.full_like(every, np.nan), tracers, every - tracers], axis=1)
    else:
        return {}
    kt = temperature(scene, energy)
    return {"contact_value_rate": contact_from_rate(scene, collisions, kt, case.times[-1])}


def bin_edges(scene: Scene) -> np.ndarray:
    """Return the edges (R + 1,) [length] of the bins of distance."""
    number, width = bins(scene)
    return np.arange(number + 1) * width


def weights_of(scene: Scene) -> np.ndarray:
    """Return the `contact_weights` (2, P, R) of every pair of species."""
    edges, pairs = bin_edges(scene), zip(contact_distances(scene), decays(scene), strict=True)
    return np.stack([contact_weights(edges, *pair) for pair in pairs], axis=1)


def columns(case: Case, runs: Ensemble) -> Columns:
    """Return g(r), contact values, and the density at the walls; in the totals numbers of pairs."""
    by_rate, seen = _by_rate(case, runs) | _wall_columns(case, runs), runs.observables
    if "pair_counts" not in seen:
        return Columns(by_rate)
    uniform = ideal(case.scene, bin_edges(case.scene)) * np.asarray(seen["pair_snapshots"], float)[:, None, None]
    counts = np.asarray(seen["pair_counts"], float)
    g, around_lone = _over(counts, uniform), _over(seen.get("pair_expected", np.full_like(counts, np.nan)), uniform)
    value, following = ((g * of_order).sum(axis=-1) for of_order in weights_of(case.scene))
    means = {"pair_distribution": g, "contact_value": value, "contact_value_following": following}
    totals = {"pairs": counts, "one_pair": _over(np.ones_like(uniform), uniform), "around_lone": around_lone}
    return Columns(means | by_rate, {name: values.sum(axis=0) for name, values in totals.items()})


def _wall_columns(case: Case, runs: Ensemble) -> dict[str, np.ndarray]:
    """Columns of the density at the walls and of its change by the next order, (n, K)."""
    if "density_profile" not in runs.observables:
        return {}
    density = np.asarray(runs.observables["density_profile"], float)
    contact, following = ((density * weights).sum(axis=-1) for weights in wall_weights(case.scene))
    return {"contact_density": contact, "contact_density_following": following}


def _over(number: np.ndarray, expected: np.ndarray) -> np.ndarray:
    return np.divide(number, expected, out=np.full(number.shape, np.nan), where=expected > 0)


def _per_lone(around_lone: np.ndarray) -> np.ndarray:
    """One over the ideal gas around the lone disks at their recorded positions; 1 for other pairs, where it is NaN.

    Both it and g(r) are relative to uniform points. It is taken as known. This does not underestimate the error of
    their ratio: the position of the lone disk shifts the counts of a run and the ideal gas alike, so that part of the
    spread would cancel.
    """
    return np.where(np.isfinite(around_lone), _over(np.ones_like(around_lone), around_lone), 1.0)


def _of_few(case: Case, averages: Averages, around_lone: np.ndarray) -> Estimate:
    """Estimate of g(r); beyond contact the interval of fewer than FEW pairs in a bin is at least that of Poisson.

    Without it, that of three pairs in ten runs has the expected number in 78 % of ensembles.
    """
    estimate = averages.estimate("pair_distribution").scaled(_per_lone(around_lone))
    pairs, one = averages.totals["pairs"], averages.totals["one_pair"] / averages.runs**2 * _per_lone(around_lone)
    beyond = bin_edges(case.scene)[1:] > np.array(contact_distances(case.scene))[:, None]
    few = (pairs < FEW) & beyond & np.isfinite(estimate.low)
    low, high = (np.where(few, end * one, np.nan) for end in resampling.wilson_interval(pairs))
    return estimate._replace(low=np.fmin(estimate.low, low), high=np.fmax(estimate.high, high))


def _at_contact(case: Case, averages: Averages, around_lone: np.ndarray) -> Estimate:
    """Estimate of the contact values, with the error of the extrapolation."""
    of_lone, following_of_lone = (np.sum(around_lone * of_order, axis=-1) for of_order in weights_of(case.scene))
    estimate = averages.estimate("contact_value").scaled(_per_lone(of_lone))
    following = averages.estimate("contact_value_following")
    of_ideal = np.where(np.isfinite(of_lone), estimate.mean * following_of_lone, 0.0)
    following = following._replace(mean=following.mean - of_ideal).scaled(_per_lone(of_lone))
    return widened(estimate, truncation(following))


def results(case: Case, averages: Averages) -> dict[str, ArrayLike | Estimate]:
    """Return g(r), the contact values and the density at the walls with the errors of extrapolation."""
    values: dict[str, ArrayLike | Estimate] = {}
    if "contact_density" in averages:
        error = truncation(averages.estimate("contact_density_following"))
        values["contact_density"] = widened(averages.estimate("contact_density"), error)
    if {"pair_distribution", "contact_value_rate"} & averages.places.keys():
        values["contact_distance"] = contact_distances(case.scene)
    if "pair_distribution" in averages:
        around_lone = averages.totals["around_lone"] / averages.runs
        values["pair_distribution"] = _of_few(case, averages, around_lone)
        values["contact_value"] = _at_contact(case, averages, around_lone)
    return values


PAIR = (*EACH, "species_pair")

VARIABLES = {
    "pair_distribution": Mean((*PAIR, "distance"), "1", "pair distribution g(r); 1 for an ideal gas in this box"),
    "contact_distance": Variable(PAIR, "length", "distance of the two disks at contact"),
    "contact_value": Mean(PAIR, "1", "g(r) at contact, extrapolated from up to 1.2 contact distances"),
    "contact_value_rate": Mean(PAIR, "1", "g(r) at contact, from the collision rate"),
    "contact_density": Mean(
        (*EACH, "species"), "1/length^2", "number density at the walls, extrapolated from up to 0.2 diameters"
    ),
}
