"""Pairs of disks: the distribution g(r) of their distances, and its value at contact."""

import numpy as np

from brownpipe import observables, theory
from brownpipe.analysis.conditions import accessible
from brownpipe.analysis.measure import Columns, Measure, scaled, with_interval
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.thermodynamics import mean_root, temperature
from brownpipe.analysis.variables import EACH, Variable, estimate_of
from brownpipe.engines.friction import DENSEST
from brownpipe.observables import is_stationary
from brownpipe.observables.pairs import species_pairs as in_order
from brownpipe.observables.species import species_table

NEAR = 1.2  # contact distances up to which g(r) is extrapolated to contact
ORDER = 2  # of the polynomial that multiplies the decay there
DECAY = 1.6  # times phi chi is -d ln g/dr up to NEAR, in contact distances; simulated at phi = 0.5 and 0.65
NORMAL = 1.96  # standard errors in half a 95 % interval


def pairs_of(scene):
    """(a, b, number) of every pair of kinds, a <= b, and of how many pairs of disks there are."""
    kinds = species_table(scene)
    number = kinds.number
    pairs = [(a, b, number[a] * (number[a] - 1) / 2 if a == b else number[a] * number[b]) for a, b in in_order(kinds)]
    return kinds, pairs


def ideal(scene, edges):
    """Pairs (P, R) of every pair of kinds expected between `edges` (R + 1,) [length] in an ideal gas in this box.

    Periodic: the area of the ring over that of the box. Walls: two uniform points, each in the rectangle accessible to
    its kind, so that g(r) = 1 for a gas of points and nothing is lost at the walls. A lone disk need not be uniform:
    see `_of_ideal`.
    """
    kinds, pairs = pairs_of(scene)
    if scene.box.periodic:
        share = np.pi * np.diff(edges**2) / scene.box.area
        return np.array([number * share for _, _, number in pairs])
    rooms = [accessible(scene, radius) for radius in kinds.radius]
    return np.array([number * theory.pair_distance_probability(edges, rooms[a], rooms[b]) for a, b, number in pairs])


def decays(scene):
    """Approximate -d ln g/dr (P,) [1/contact distance] just beyond contact, for every pair of kinds."""
    kinds, pairs = pairs_of(scene)
    phi = min(scene.packing_fraction, DENSEST)
    density = kinds.number / scene.box.area * (phi / scene.packing_fraction)
    chi = theory.mixture_contact_values(density, 2 * kinds.radius)
    return np.array([DECAY * phi * chi[a, b] for a, b, _ in pairs])


def contact_weights(edges, contact, decay):
    """Weights (2, R) of g(r) in its bins: of the value at contact, and of the change of it by the next order.

    With x = r/contact - 1, a polynomial of degree ORDER in x times (1 + decay x/16)^-16, nearly exponential, is fitted
    to the averages of g over the areas of the bins up to NEAR, by least squares with the areas as weights. NaN where
    the bins are too few for the next degree.
    """
    inside = (edges[:-1] >= contact * (1 - 1e-9)) & (edges[1:] <= contact * NEAR * (1 + 1e-9))
    weights = np.zeros((2, len(inside)))
    if np.count_nonzero(inside) < ORDER + 2:
        return np.full(weights.shape, np.nan)
    low, high = edges[:-1][inside] / contact, edges[1:][inside] / contact
    area, found = high**2 - low**2, []
    for degree in range(ORDER + 2):
        column, at_contact = _bin_averages(low, high, degree, decay), float(degree == 0)
        for other, value in found:  # Gram-Schmidt, sums in a fixed order: the same bits on every processor
            along = (area * column * other).sum()
            column, at_contact = column - along * other, at_contact - along * value
        norm = np.sqrt((area * column**2).sum())
        found.append((column / norm, at_contact / norm))
        weights[int(degree > ORDER), inside] += area * found[-1][0] * found[-1][1]
    return weights


def _bin_averages(low, high, degree, decay):
    """Averages over the areas of bins of x^degree (1 + decay x/16)^-16, by three points of Gauss-Legendre each."""
    total = np.zeros(len(low))
    for node, weight in ((-np.sqrt(0.6), 5 / 18), (0.0, 8 / 18), (np.sqrt(0.6), 5 / 18)):
        r = (low + high) / 2 + node * (high - low) / 2
        f = 1.0 / (1.0 + decay * (r - 1.0) / 16)
        for _ in range(4):
            f = f * f
        for _ in range(degree):
            f = f * (r - 1.0)
        total = total + weight * r * f
    return total / ((low + high) / 2)


def truncation(following):
    """Truncation error: the root of the mean square of the next order, an Estimate, less its variance."""
    return np.sqrt(np.maximum(following.mean**2 - following.standard_error**2, 0.0))


def widened(estimate, error):
    """The Estimate with another, systematic `error` added in quadrature to its standard error and interval."""
    reach = [np.sqrt((end - estimate.mean) ** 2 + (NORMAL * error) ** 2) for end in (estimate.low, estimate.high)]
    total = np.sqrt(estimate.standard_error**2 + error**2)
    return Estimate(estimate.mean, total, estimate.mean - reach[0], estimate.mean + reach[1])


def collisions_by_pair(scene, seen):
    """Collisions (n, P) of every pair of kinds, from those of all disks and of the tracer; None for other mixtures."""
    kinds, _ = pairs_of(scene)
    number = kinds.number
    if not {"pair_collisions", "tracer_collisions", "kinetic_energy"} <= seen.keys():
        return None
    every, tracers = (np.asarray(seen[name], float) for name in ("pair_collisions", "tracer_collisions"))
    if len(number) == 1 and number[0] > 1:
        return every[:, None]
    if len(number) == 2 and number[0] == 1:
        return np.stack([np.full_like(every, np.nan), tracers, every - tracers], axis=1)
    return None


def contact_from_rate(scene, collisions, kt, duration):
    """Contact values (n, P) from `collisions` (n, P) of runs of temperature `kt` (n,), in equilibrium.

    A pair meets at the rate p(sigma) chi sqrt(kT/(2 pi mu)), p the density of its distance in an ideal gas: the flux
    through contact of a normal distribution of relative velocities (S. Chapman and T. G. Cowling, ch. 5, in the plane).
    A run keeps its energy, at which the mean speed is larger by 1/`thermodynamics.mean_root`.
    """
    kinds, pairs = pairs_of(scene)
    chi = np.full(collisions.shape, np.nan)
    for k, (a, b, number) in enumerate(pairs):
        contact, mu = kinds.radius[a] + kinds.radius[b], theory.reduced_mass(kinds.mass[a], kinds.mass[b])
        rooms = [accessible(scene, kinds.radius[one]) for one in (a, b)]
        near = 2 * np.pi * contact / scene.box.area
        p = near if scene.box.periodic else float(theory.pair_distance_density_between(contact, *rooms))
        if number > 0 and p > 0:
            expected = duration * number * p * np.sqrt(kt / (2 * np.pi * mu)) / mean_root(scene)
            chi[:, k] = collisions[:, k] / expected
    return chi


def _by_rate(case, runs):
    """Columns of contact values from collisions; none if the runs are not in equilibrium from t = 0."""
    scene, seen = case.scene, runs.observables
    if not is_stationary(scene) or not scene.particles:
        return {}
    collisions = collisions_by_pair(scene, seen)
    if collisions is None:
        return {}
    kt = temperature(scene, np.asarray(seen["kinetic_energy"], float))
    return {"contact_value_rate": contact_from_rate(scene, collisions, kt, case.times[-1])}


def _edges(case):
    middle = observables.axes(case.scene, "pair_counts")["distance"]
    return np.arange(len(middle) + 1) * (2 * middle[0])


def _sample(case, runs):
    by_rate, seen = _by_rate(case, runs), runs.observables
    if "pair_counts" not in seen:
        return Columns(by_rate)
    edges = _edges(case)
    kinds, pairs = pairs_of(case.scene)
    contacts = [kinds.radius[a] + kinds.radius[b] for a, b, _ in pairs]
    each = [contact_weights(edges, *one) for one in zip(contacts, decays(case.scene), strict=True)]

    def at_contact(g, suffix=""):
        values = {}
        for name, weights in zip(("contact_value", "contact_value_following"), np.swapaxes(each, 0, 1), strict=True):
            product = np.where(np.isnan(weights), np.nan, g * np.nan_to_num(weights))
            values[name + suffix] = product.sum(axis=-1)
        return values

    uniform = ideal(case.scene, edges) * np.asarray(seen["pair_snapshots"], float)[:, None, None]
    g = _over(np.asarray(seen["pair_counts"], float), uniform)
    means = {"pair_distribution": g} | at_contact(g) | by_rate
    if "pair_expected" not in seen:
        return Columns(means)
    around = _over(np.asarray(seen["pair_expected"], float), uniform)
    return Columns(means, {"pair_distribution_ideal": around} | at_contact(around, "_ideal"))


def _over(number, expected):
    return np.divide(number, expected, out=np.full(number.shape, np.nan), where=expected > 0)


def _of_ideal(found, name):
    """Estimate of the mean, over that of an ideal gas around the lone disks where they were.

    Both are relative to uniform points. The error is that of the counts alone, the ideal gas being taken as known. It
    is not too small: what the place of the lone disk does to the counts of a run it does to the ideal gas, too, and
    would cancel in part.
    """
    estimate = found.estimate(name)
    if f"{name}_ideal" not in found:
        return estimate
    of_ideal = found.mean(f"{name}_ideal")
    lone = np.isfinite(of_ideal)
    return scaled(estimate, np.where(lone, _over(np.ones_like(of_ideal), of_ideal), 1.0))


def _at_contact(found):
    """Estimate of the contact values with the error of the extrapolation, relative to the ideal gas as `_of_ideal`."""
    estimate, following = _of_ideal(found, "contact_value"), found.estimate("contact_value_following")
    if "contact_value_ideal" in found:
        of_ideal, more = found.mean("contact_value_ideal"), found.mean("contact_value_following_ideal")
        lone = np.isfinite(of_ideal)
        following = following._replace(mean=following.mean - np.where(lone, estimate.mean * more, 0.0))
        following = scaled(following, np.where(lone, _over(np.ones_like(of_ideal), of_ideal), 1.0))
    return widened(estimate, truncation(following))


def _estimate(case, found):
    values = {}
    if "pair_distribution" in found:
        values |= with_interval("pair_distribution", _of_ideal(found, "pair_distribution"))
        values |= with_interval("contact_value", _at_contact(found))
    if "contact_value_rate" in found:
        values |= with_interval("contact_value_rate", found.estimate("contact_value_rate"))
    if values:
        kinds, pairs = pairs_of(case.scene)
        values["contact_distance"] = [kinds.radius[a] + kinds.radius[b] for a, b, _ in pairs]
    return values


def _axes(case, found):
    if "pair_distribution" in found:
        return {dim: (dim, values) for dim, values in observables.axes(case.scene, "pair_counts").items()}
    kinds, pairs = pairs_of(case.scene)
    return {"species_pair": ("species_pair", [f"{kinds.name[a]}:{kinds.name[b]}" for a, b, _ in pairs])}


PAIR = (*EACH, "species_pair")

MEASURE = Measure(
    _sample,
    _estimate,
    {
        **estimate_of("pair_distribution", (*PAIR, "distance"), "1", "pair distribution g(r); 1 for an ideal gas here"),
        "contact_distance": Variable(PAIR, "length", "distance of the two disks in contact"),
        **estimate_of(
            "contact_value", PAIR, "1", "pair distribution at contact, extrapolated from distances up to 1.2 times that"
        ),
        **estimate_of("contact_value_rate", PAIR, "1", "pair distribution at contact, from the rate of collisions"),
    },
    _axes,
    {
        "species_pair": {"long_name": "species of the two disks"},
        "distance": {"units": "length", "long_name": "distance of the two disks, middle of the bin"},
    },
)
