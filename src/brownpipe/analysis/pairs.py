"""Pair distribution function g(r), its value at contact from g(r) and from collision rates; the
density at the walls.

P pairs of species, R bins of distance, K species, B bins of distance from a wall, n runs. See
docs/theory.md, section 3.
"""

import numpy as np
from numpy.typing import ArrayLike

from brownpipe import theory
from brownpipe.analysis import resampling
from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.thermodynamics import temperature
from brownpipe.analysis.variables import CASE_DIMS, Mean, Variable
from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.friction import DENSEST, mean_root
from brownpipe.observables import profile
from brownpipe.observables.equilibrium import is_stationary
from brownpipe.observables.pairs import bins, species_pairs
from brownpipe.scene import Scene
from brownpipe.scene.species import species_table

NEAR = 1.2  # upper end, in contact distances, of the fit of g(r) that is extrapolated to contact
ORDER = 2  # of the polynomial that multiplies the decay there
DECAY_AT_WALL = 2.2  # -d ln n/dz over phi chi near a wall, in diameters; theory has 8/pi at phi = 0
# -d ln g/dr over phi chi up to NEAR, in contact distances; from simulations at phi = 0.5 and 0.65
DECAY = 1.6
FEW = 20  # pairs in a bin, of all runs together
NORMAL = 1.96  # standard errors in half a 95 % interval


def pairs_in(scene: Scene) -> tuple[np.ndarray, ...]:
    """Return the P pairs of species in a scene, each (P,): index of a species and of the other, a
    <= b, number of pairs of disks, distance of two disks at contact [length]; for species of
    several radii the smallest.
    """
    species = species_table(scene)
    a, b = np.array(species_pairs(species), int).reshape(-1, 2).T
    is_same = a == b
    partners = species.number[b] - is_same  # of a disk; none is its own
    pairs = species.number[a] * partners / (1.0 + is_same)  # those of one species counted once
    return a, b, pairs, species.smallest_radius[a] + species.smallest_radius[b]


def ideal(scene: Scene, edges: np.ndarray) -> np.ndarray:
    """Return the number of pairs (P, R) between `edges` (R + 1,) [length] expected for an ideal gas
    in this box.

    Periodic box: the area of the ring over that of the box. Walls: two uniform points, each in the
    rectangle accessible to its species, so that g(r) = 1 for an ideal gas at all distances. A lone
    disk need not be distributed uniformly: see `_per_lone`.
    """
    a, b, number, _ = pairs_in(scene)
    box = scene.box
    if not box.has_walls:
        return number[:, None] * np.pi * np.diff(edges**2) / box.area
    areas = [box.accessible(radius)[1] for radius in species_table(scene).radius]
    shares = []
    for k, m in zip(a, b, strict=True):
        if box.is_channel:
            cumulative = theory.pair_distance_in_channel(
                edges, *_channel(scene, areas[k], areas[m])
            )
            shares.append(np.diff(cumulative))
        else:
            shares.append(theory.pair_distance_probability(edges, areas[k], areas[m]))
    return number[:, None] * shares


def ideal_density(scene: Scene) -> np.ndarray:
    """Return the density (P,) [1/length] of the distance of a pair at contact, for the same ideal
    gas.
    """
    a, b, _, contact = pairs_in(scene)
    box = scene.box
    if not box.has_walls:
        return 2 * np.pi * contact / box.area
    areas = [box.accessible(radius)[1] for radius in species_table(scene).radius]
    densities = []
    for distance, k, m in zip(contact, a, b, strict=True):
        if box.is_channel:
            strips = _channel(scene, areas[k], areas[m])
            density = theory.pair_distance_density_in_channel(distance, *strips)
        else:
            density = theory.pair_distance_density_between(distance, areas[k], areas[m])
        densities.append(density)
    return np.array(densities, float)


def _channel(scene: Scene, first: np.ndarray, second: np.ndarray) -> tuple[float, float, float]:
    """Return the length of a channel, and the heights of the strips in it that are accessible to
    two disks: `first` and `second` (2,) are the sizes of their rectangles.
    """
    along, across = (0, 1) if scene.box.periodic_x else (1, 0)
    return float(first[along]), float(first[across]), float(second[across])


def contact_weights(
    edges: np.ndarray, contact: float, decay: float, flat: bool = False
) -> np.ndarray:
    """Return weights (2, R) of g(r) in its bins: for the value at contact, and for its change by
    the next order.

    With x = r/contact - 1, a polynomial of degree ORDER in x times (1 + decay x/16)^-16, nearly
    exponential, is fitted to the averages of g over the areas of the bins up to NEAR, by least
    squares with the areas as weights. The bins are rings, or strips along a wall if `flat`.
    Averages are taken by three-point Gauss-Legendre quadrature. NaN if there are too few bins for
    the next degree.
    """
    is_beyond_contact = edges[:-1] >= contact * (1 - 1e-9)
    is_near = edges[1:] <= contact * NEAR * (1 + 1e-9)
    inside = is_beyond_contact & is_near
    weights = np.zeros((2, len(inside)))
    if np.count_nonzero(inside) < ORDER + 2:
        return np.full(weights.shape, np.nan)
    low = edges[:-1][inside, None] / contact - 1
    high = edges[1:][inside, None] / contact - 1
    node, share = np.polynomial.legendre.leggauss(3)
    x = ((1 - node) * low + (1 + node) * high) / 2  # (bins, nodes)
    area = (high - low) * share * (1 if flat else 1 + x)
    powers = (x[..., None] / (NEAR - 1)) ** np.arange(ORDER + 2)
    decayed = area / (1 + decay * x / 16) ** 16
    area_of_bin = area.sum(axis=1, keepdims=True)
    averages = (decayed[..., None] * powers).sum(axis=1) / area_of_bin  # (bins, orders)
    root = np.sqrt(area.sum(axis=1))
    fit = np.linalg.pinv(root[:, None] * averages[:, : ORDER + 1])[0] * root
    next_fit = np.linalg.pinv(root[:, None] * averages)[0] * root
    weights[0, inside] = fit
    weights[1, inside] = next_fit - fit
    return weights


def wall_weights(scene: Scene) -> np.ndarray:
    """Return weights (2, K, B) of the profiles: for the density at contact, and for its change by
    the next order.

    `contact_weights` for a flat wall, up to a fifth of a diameter from it.
    """
    phi = min(scene.packing_fraction, DENSEST)
    number, width = profile.bins(scene)
    edges = np.arange(number + 1) * width
    decay = DECAY_AT_WALL * phi * float(theory.contact_value(phi))
    diameters = 2 * species_table(scene).radius  # of several radii the mean
    weights = [
        contact_weights(edges + diameter, diameter, decay, flat=True) for diameter in diameters
    ]
    return np.stack(weights, axis=1)


def widened(estimate: Estimate, following: Estimate) -> Estimate:
    """Return the Estimate with the truncation error added in quadrature to its standard error and
    interval.

    This error is that of the next order, whose own noise is subtracted: sqrt(mean^2 - standard
    error^2), or 0.
    """
    square = np.maximum(following.mean**2 - following.standard_error**2, 0.0)
    error = np.sqrt(estimate.standard_error**2 + square)
    below = np.sqrt((estimate.low - estimate.mean) ** 2 + NORMAL**2 * square)
    above = np.sqrt((estimate.high - estimate.mean) ** 2 + NORMAL**2 * square)
    mean = estimate.mean
    return Estimate(mean, error, mean - below, mean + above).unless_alike()


def contact_from_rate(
    scene: Scene, collisions: np.ndarray, kt: np.ndarray, duration: float
) -> np.ndarray:
    """Return contact values (n, P) from `collisions` (n, P) of runs of temperature `kt` (n,), in
    equilibrium.

    A pair collides at the rate p(sigma) chi sqrt(kT/(2 pi mu)), p the density of its distance in an
    ideal gas: the flux through contact of a Maxwell-Boltzmann distribution of relative velocities
    (S. Chapman and T. G. Cowling, The Mathematical Theory of Non-Uniform Gases, ch. 5, in two
    dimensions). At the constant energy of a run the mean speed is larger by 1/`friction.mean_root`.
    """
    a, b, number, _ = pairs_in(scene)
    species = species_table(scene)
    mass = theory.reduced_mass(species.mass[a], species.mass[b])
    speed = np.sqrt(kt[:, None] / (2 * np.pi * mass))  # of approach, at distances near contact
    rate = ideal_density(scene) * speed / mean_root(scene)
    return _over(collisions, duration * number * rate)


def _by_rate(case: Case, runs: Ensemble) -> dict[str, np.ndarray]:
    """Return the contact values from collisions; {} if the runs are not in equilibrium from t = 0.

    The collisions of each pair of species are known for one species, and for one beside a single
    tracer. Between walls its contact value needs the ideal gas around it.
    """
    scene = case.scene
    measured = runs.observables
    names = ("pair_collisions", "tracer_collisions", "kinetic_energy")
    if not is_stationary(scene) or not measured.keys() >= {*names}:
        return {}
    pair_collisions, tracer_collisions, energy = (
        np.asarray(measured[name], float) for name in names
    )
    number = species_table(scene).number
    if not species_table(scene).has_one_kind.all():
        return {}
    is_ideal_known = not scene.box.has_walls or "pair_expected" in measured
    if len(number) == 1 and number[0] > 1:
        collisions = pair_collisions[:, None]
    elif len(number) == 2 and number[0] == 1 and is_ideal_known:
        none = np.full_like(pair_collisions, np.nan)  # of the tracer with its own species
        bath_collisions = pair_collisions - tracer_collisions
        collisions = np.stack([none, tracer_collisions, bath_collisions], axis=1)
    else:
        return {}
    kt = temperature(scene, energy)
    contact_values = contact_from_rate(scene, collisions, kt, case.times[-1])
    return {"contact_value_rate": contact_values}


def bin_edges(scene: Scene) -> np.ndarray:
    """Return the edges (R + 1,) [length] of the bins of distance."""
    number, width = bins(scene)
    return np.arange(number + 1) * width


def weights_of(scene: Scene) -> np.ndarray:
    """Return the `contact_weights` (2, P, R) of every pair of species; NaN for species of several
    radii, which touch at many distances.
    """
    a, b, _, contact = pairs_in(scene)
    species = species_table(scene)
    phi = min(scene.packing_fraction, DENSEST)
    density = species.number / scene.box.area * (phi / scene.packing_fraction)
    contact_values = theory.mixture_contact_values(density, 2 * species.radius)
    decays = DECAY * phi * contact_values[a, b]
    edges = bin_edges(scene)
    weights = [
        contact_weights(edges, distance, decay)
        for distance, decay in zip(contact, decays, strict=True)
    ]
    stacked = np.stack(weights, axis=1)
    stacked[:, ~(species.has_one_kind[a] & species.has_one_kind[b])] = np.nan
    return stacked


def pair_columns(case: Case, runs: Ensemble) -> Columns:
    """Return g(r), contact values, and the density at the walls; in the totals numbers of pairs."""
    measured = runs.observables
    means = _by_rate(case, runs)
    if "density_profile" in measured and case.scene.box.has_walls:
        means |= _extrapolated(
            "contact_density", measured["density_profile"], wall_weights(case.scene)
        )
    if "pair_counts" not in measured:
        return Columns(means)
    uniform = ideal(case.scene, bin_edges(case.scene)) * measured["pair_snapshots"][:, None, None]
    counts = np.asarray(measured["pair_counts"], float)
    g = _over(counts, uniform)
    means |= {"pair_distribution": g} | _extrapolated("contact_value", g, weights_of(case.scene))
    expected = measured.get("pair_expected", np.full_like(counts, np.nan))
    totals = {
        "pairs": counts,
        "one_pair": _over(np.ones_like(uniform), uniform),
        "around_lone": _over(expected, uniform),
    }
    return Columns(means, {name: values.sum(axis=0) for name, values in totals.items()})


def _extrapolated(name: str, values: np.ndarray, weights: np.ndarray) -> dict[str, np.ndarray]:
    """Return the value at contact and its change by the next order, from `weights` (2, ...)."""
    value, following = ((values * weights_of_order).sum(axis=-1) for weights_of_order in weights)
    return {name: value, f"{name}_following": following}


def _over(number: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return the ratio of two numbers of pairs, NaN where none is expected.

    >>> _over(np.array([3.0, 0.0]), np.array([2.0, 0.0]))
    array([1.5, nan])
    """
    return np.divide(number, expected, out=np.full(number.shape, np.nan), where=expected > 0)


def _per_lone(around_lone: np.ndarray) -> np.ndarray:
    """Return one over g(r) of an ideal gas around the lone disks where they were recorded,
    `around_lone`; 1 for other pairs.

    `around_lone`, which like g(r) is relative to uniform points, is taken as known. This does not
    underestimate the error of their ratio: the position of the lone disk shifts the counts of a run
    and the ideal gas alike, so that part of the spread would cancel.
    """
    return np.where(np.isfinite(around_lone), _over(np.ones_like(around_lone), around_lone), 1.0)


def _distribution(case: Case, averages: Averages, around_lone: np.ndarray) -> Estimate:
    """Return g(r); beyond contact the interval of fewer than FEW pairs in a bin is at least
    Poisson's.

    The bootstrap has no interval for up to three pairs, and too short ones for a few more.
    """
    per_lone = _per_lone(around_lone)
    estimate = averages.estimate("pair_distribution").scaled(per_lone)
    pairs = averages.totals["pairs"]
    g_of_one_pair = averages.totals["one_pair"] / averages.runs**2 * per_lone
    *_, contact = pairs_in(case.scene)
    is_beyond = bin_edges(case.scene)[1:] > contact[:, None]
    is_few = (pairs < FEW) & is_beyond & (averages.runs >= resampling.FEWEST_FOR_INTERVAL)
    fewest, most = resampling.wilson_interval(pairs)
    low = np.where(is_few, fewest * g_of_one_pair, np.nan)
    high = np.where(is_few, most * g_of_one_pair, np.nan)
    return estimate._replace(low=np.fmin(estimate.low, low), high=np.fmax(estimate.high, high))


def _at_contact(case: Case, averages: Averages, around_lone: np.ndarray) -> dict[str, Estimate]:
    """Return the contact values relative to the ideal gas around lone disks; those from g(r) with
    the error of extrapolation.
    """
    lone, following_lone = (
        np.sum(around_lone * weights, axis=-1) for weights in weights_of(case.scene)
    )
    # NaN where the ideal gas around a lone disk is not known at contact.
    is_recorded = np.isfinite(around_lone).any(axis=-1)
    per_lone = np.where(is_recorded, _over(np.ones_like(lone), lone), 1.0)
    values = {}
    for name in ("contact_value", "contact_value_rate"):
        if name in averages.places:
            values[name] = averages.estimate(name).unless_alike().scaled(per_lone)
    following = averages.estimate("contact_value_following")
    # Of the change by the next order, that of the ideal gas is no error.
    change_lone = values["contact_value"].mean * following_lone
    change_lone = np.where(np.isfinite(lone), change_lone, 0.0)
    following = following._replace(mean=following.mean - change_lone).scaled(per_lone)
    return values | {"contact_value": widened(values["contact_value"], following)}


def pair_results(case: Case, averages: Averages) -> dict[str, ArrayLike | Estimate]:
    """Return g(r), the contact values and the density at the walls with the errors of
    extrapolation.
    """
    values: dict[str, ArrayLike | Estimate] = {}
    if "contact_density" in averages.places:
        density = averages.estimate("contact_density")
        following = averages.estimate("contact_density_following")
        values["contact_density"] = widened(density, following)
    if {"pair_distribution", "contact_value_rate"} & averages.places.keys():
        *_, values["contact_distance"] = pairs_in(case.scene)
    if "pair_distribution" in averages.places:
        around_lone = averages.totals["around_lone"] / averages.runs
        values["pair_distribution"] = _distribution(case, averages, around_lone)
        values |= _at_contact(case, averages, around_lone)
    return values


PAIR = (*CASE_DIMS, "species_pair")
SPECIES = (*CASE_DIMS, "species")

VARIABLES = {
    "pair_distribution": Mean(
        (*PAIR, "distance"), "1", "pair distribution g(r); 1 for an ideal gas in this box"
    ),
    "contact_distance": Variable(PAIR, "length", "distance of the two disks at contact"),
    "contact_value": Mean(
        PAIR, "1", "g(r) at contact, extrapolated from up to 1.2 contact distances"
    ),
    "contact_value_rate": Mean(PAIR, "1", "g(r) at contact, from the collision rate"),
    "contact_density": Mean(
        SPECIES, "1/length^2", "density at the walls, extrapolated from up to 0.2 diameters"
    ),
}

ESTIMATOR = Estimator(
    name="pairs",
    variables=VARIABLES,
    columns=pair_columns,
    results=pair_results,
)
