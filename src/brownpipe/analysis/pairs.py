"""Pairs of disks: the distribution g(r) of their distances, and its value at contact."""

import numpy as np

from brownpipe import theory
from brownpipe.analysis.conditions import accessible
from brownpipe.analysis.measure import Columns, Measure, scaled, with_interval
from brownpipe.analysis.thermodynamics import mean_root, temperature
from brownpipe.analysis.variables import EACH, Variable, estimate_of

NEAR = 1.15  # contact distances up to which g(r) is extrapolated to contact by a parabola


def pairs_of(scene):
    """(a, b, number) of every pair of kinds, a <= b, and of how many pairs of disks there are."""
    from brownpipe.observables.kinds import kinds_of
    from brownpipe.observables.pairs import pairs_of as in_order

    kinds = kinds_of(scene)
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


def contact_weights(edges, contact):
    """Weights (R,) of g(r) in its bins whose sum is a parabola's value at contact, NaN with fewer than four bins."""
    middle, inside = (edges[1:] + edges[:-1]) / 2, edges[:-1] >= contact * (1 - 1e-9)
    inside &= edges[1:] <= contact * NEAR * (1 + 1e-9)
    weights = np.zeros(len(middle))
    if np.count_nonzero(inside) < 4:
        return np.full(len(middle), np.nan)
    powers = ((middle[inside] - contact) / contact)[:, None] ** np.arange(3)
    weights[inside] = np.linalg.pinv(powers)[0]
    return weights


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
    from brownpipe.observables import is_stationary

    scene, seen = case.scene, runs.observables
    if not is_stationary(scene) or not scene.particles:
        return {}
    collisions = collisions_by_pair(scene, seen)
    if collisions is None:
        return {}
    kt = temperature(scene, np.asarray(seen["kinetic_energy"], float))
    return {"contact_value_rate": contact_from_rate(scene, collisions, kt, case.times[-1])}


def _edges(case):
    from brownpipe import observables

    middle = observables.axes(case.scene, "pair_counts")["distance"]
    return np.arange(len(middle) + 1) * (2 * middle[0])


def _sample(case, runs):
    by_rate, seen = _by_rate(case, runs), runs.observables
    if "pair_counts" not in seen:
        return Columns(by_rate)
    edges = _edges(case)
    kinds, pairs = pairs_of(case.scene)
    weights = np.array([contact_weights(edges, kinds.radius[a] + kinds.radius[b]) for a, b, _ in pairs])

    def at_contact(g):
        return np.where(np.isnan(weights), np.nan, g * np.nan_to_num(weights)).sum(axis=-1)

    uniform = ideal(case.scene, edges) * np.asarray(seen["pair_snapshots"], float)[:, None, None]
    g = _over(np.asarray(seen["pair_counts"], float), uniform)
    means = {"pair_distribution": g, "contact_value": at_contact(g)} | by_rate
    if "pair_expected" not in seen:
        return Columns(means)
    around = _over(np.asarray(seen["pair_expected"], float), uniform)
    return Columns(means, {"pair_distribution_ideal": around, "contact_value_ideal": at_contact(around)})


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


def _estimate(case, found):
    values = {}
    for name in (name for name in ("pair_distribution", "contact_value") if name in found):
        values |= with_interval(name, _of_ideal(found, name))
    if "contact_value_rate" in found:
        values |= with_interval("contact_value_rate", found.estimate("contact_value_rate"))
    if values:
        kinds, pairs = pairs_of(case.scene)
        values["contact_distance"] = [kinds.radius[a] + kinds.radius[b] for a, b, _ in pairs]
    return values


def _axes(case, found):
    from brownpipe import observables

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
        **estimate_of("contact_value", PAIR, "1", "pair distribution at contact, by a parabola through the next bins"),
        **estimate_of("contact_value_rate", PAIR, "1", "pair distribution at contact, from the rate of collisions"),
    },
    _axes,
    {
        "species_pair": {"long_name": "species of the two disks"},
        "distance": {"units": "length", "long_name": "distance of the two disks, middle of the bin"},
    },
)
