"""Velocities of one run: autocorrelation, kinetic energies, histograms. T sample times, N disks, K
species.
"""

import numpy as np

from brownpipe.observables.average import over_origins
from brownpipe.observables.averages import (
    Factors,
    Product,
    Samples,
    averaged,
    averaged_by_component,
    averaged_over_origins,
)
from brownpipe.observables.displacement import dot
from brownpipe.observables.observable import Axis, Observable, RunArray, only_where_axes_differ
from brownpipe.observables.trajectory import Track
from brownpipe.scene import Scene, motion
from brownpipe.scene.species import bath_disks, species_table

BIN = 0.1  # width of the bins, in units of sqrt(kT/m)
# velocity component, either sign, in these units; the outermost bins include all values beyond
LARGEST_COMPONENT = 6.0
VELOCITIES = (np.arange(120) - 59.5) * BIN  # centres of the bins
SPEEDS = (np.arange(80) + 0.5) * BIN
# velocity components that are scaled and counted at a time, so that temporary arrays stay small
VALUES_AT_ONCE = 2**18


def autocorrelation(scene: Scene, track: Track, average: str) -> dict[str, np.ndarray]:
    """Return the velocity autocorrelation v(0).v(t) (T,) of the tracer, and its integral over time;
    where walls make the motion along x and y differ, also those of the components (2, T).

    The integral of v(0).v(s) over s from 0 to t is v(0).(r(t) - r(0)); in two dimensions D is half
    its mean (Green-Kubo), and D along x the mean of v_x(0) (x(t) - x(0)). `average` as in
    `displacement.square_displacement`.
    """
    if scene.box.axes_differ:
        return averaged_by_component(scene, track, average, COMPONENT_PRODUCTS)
    if over_origins(average):
        products = (VELOCITY_PRODUCT, VELOCITY_DISPLACEMENT)
        correlation, integral = averaged_over_origins(scene, track, products)
    else:
        correlation = _correlation_with_start(track.known_velocity)
        (integral,) = averaged(scene, track, average, (VELOCITY_DISPLACEMENT,))
    return {"velocity_autocorrelation": correlation, "velocity_displacement": integral}


def bath_autocorrelation(scene: Scene, track: Track, average: str) -> dict[str, np.ndarray]:
    """Return v(0).v(t) (T,), a mean over the disks of the most numerous species except the
    tracer's.

    `average`: from t = 0, or for `origins` from every sample as time origin.
    """
    disks = bath_disks(scene)
    if over_origins(average):
        (correlation,) = averaged_over_origins(scene, track.select(disks), (VELOCITY_PRODUCT,))
    else:
        correlation = _correlation_with_start(track.known_velocity[:, disks])
    return {"bath_velocity_autocorrelation": correlation}


def _correlation_with_start(velocity: np.ndarray) -> np.ndarray:
    """Return v(0).v(t) (T,), averaged over M disks; velocity: (T, M, 2)."""
    disks = velocity.shape[1]
    flat = velocity.reshape(len(velocity), -1)
    return np.einsum("tm,m->t", flat, flat[0]) / disks


def _velocity_factors(earlier: Samples, later: Samples) -> Factors:
    """v.v', of the velocities v of the earlier and v' of the later sample."""
    yield from zip(earlier.velocity, later.velocity, strict=True)


def _velocity_displacement_factors(earlier: Samples, later: Samples) -> Factors:
    """v.r = v.b - v.a of displacements a and b from one point, with the velocity v of the earlier
    sample.
    """
    a_x, a_y = earlier.displacement
    b_x, b_y = later.displacement
    v_x, v_y = earlier.velocity
    yield v_x, b_x
    yield v_y, b_y
    yield -(v_x * a_x + v_y * a_y), later.present


def _component_product(axis: int) -> Product:
    """Return v_x v_x' (0) or v_y v_y' (1) of the earlier and the later sample."""

    def factors(earlier: Samples, later: Samples) -> Factors:
        yield earlier.velocity[axis], later.velocity[axis]

    return Product(
        lambda pairs: pairs.earlier_velocity[..., axis] * pairs.later_velocity[..., axis], factors
    )


def _component_displacement(axis: int) -> Product:
    """Return v x = v b - v a along x (0) or y (1), with the velocity v of the earlier sample."""

    def factors(earlier: Samples, later: Samples) -> Factors:
        v = earlier.velocity[axis]
        yield v, later.displacement[axis]
        yield -v * earlier.displacement[axis], later.present

    return Product(
        lambda pairs: pairs.displacement[..., axis] * pairs.earlier_velocity[..., axis], factors
    )


def species_energy(scene: Scene, track: Track, _: str) -> dict[str, np.ndarray]:
    """Return the kinetic energy per disk (T, K) of each species: kT in equilibrium for any mass
    (equipartition).

    Where the total momentum is zero it is kT (1 - m/M), with the mass m of a disk and M of all; in
    a channel, along which alone it is zero, kT (1 - m/2M).
    """
    species = species_table(scene)
    square = np.sum(track.known_velocity**2, axis=-1)
    energies = []
    for k in range(len(species.name)):
        disks = species.species_index == k
        energies.append((square[:, disks] * scene.mass[disks]).mean(axis=1) / 2)
    return {"species_energy": np.stack(energies, axis=1)}


def velocity_distribution(scene: Scene, track: Track, _: str) -> dict[str, np.ndarray]:
    """Return histograms of velocity components (K, 120) and of speeds (K, 80), in units of
    sqrt(kT/m).

    All samples of a stationary run are counted, otherwise the last one. kT is the scene's
    temperature or, if none is given, the mean kinetic energy per disk of the counted samples. In
    equilibrium the components are standard normal and the speeds have the density u exp(-u^2/2)
    (Maxwell-Boltzmann). The outermost bins include all values beyond.
    """
    species = species_table(scene)
    velocity = track.known_velocity
    temperature = _temperature(scene, velocity) or np.inf
    scale = np.sqrt(scene.mass / temperature)[:, None]
    components = np.zeros((len(species.name), len(VELOCITIES)), np.int64)
    speeds = np.zeros((len(species.name), len(SPEEDS)), np.int64)
    step = max(1, VALUES_AT_ONCE // velocity[0].size)  # samples at a time
    for first in range(0, len(velocity), step):
        scaled = velocity[first : first + step] * scale
        _count(components, species.species_index[:, None], scaled + LARGEST_COMPONENT)
        _count(speeds, species.species_index, np.hypot(scaled[..., 0], scaled[..., 1]))
    return {"velocity_counts": components, "speed_counts": speeds}


def _temperature(scene: Scene, velocity: np.ndarray) -> float:
    """Return kT [energy]: the scene's, or the mean kinetic energy per disk of the samples (T, N,
    2).
    """
    drawn = motion.temperature(scene)
    if drawn is not None:
        return drawn
    means = []
    for sample in velocity:
        energy = scene.mass / 2 * np.sum(sample**2, axis=-1)
        means.append(energy.mean())
    return float(np.mean(means))


def _count(counts: np.ndarray, species_index: np.ndarray, value: np.ndarray) -> None:
    """Add values >= 0 to the histograms counts (K, bins), each to the row of its species."""
    last = counts.shape[1] - 1
    column = np.clip(np.floor(value / BIN), 0, last).astype(np.int64)
    flat = (column + species_index * (last + 1)).ravel()  # places in the flattened histograms
    counts += np.bincount(flat, minlength=counts.size).reshape(counts.shape)


VELOCITY_PRODUCT = Product(
    lambda pairs: dot(pairs.earlier_velocity, pairs.later_velocity), _velocity_factors
)
VELOCITY_DISPLACEMENT = Product(
    lambda pairs: dot(pairs.displacement, pairs.earlier_velocity), _velocity_displacement_factors
)
COMPONENT_PRODUCTS = {
    "velocity_autocorrelation": (_component_product(0), _component_product(1)),
    "velocity_displacement": (_component_displacement(0), _component_displacement(1)),
}
AUTOCORRELATION = Observable(
    autocorrelation,
    {
        "velocity_autocorrelation": RunArray(
            ("time",), "length^2/time^2", "v(0).v(t) of the tracer (see `average`)"
        ),
        "velocity_displacement": RunArray(
            ("time",), "length^2/time", "v(0).(r(t) - r(0)), the integral of v(0).v(s)"
        ),
        "component_velocity_autocorrelation": RunArray(
            ("component", "time"),
            "length^2/time^2",
            "where walls make the axes differ: v_x(0) v_x(t) and v_y(0) v_y(t) of the tracer",
        ),
        "component_velocity_displacement": RunArray(
            ("component", "time"),
            "length^2/time",
            "where walls make the axes differ: v_x(0) (x(t) - x(0)), and along y",
        ),
    },
    tracks_needed="tracer",
    absent=only_where_axes_differ(
        "component_velocity_autocorrelation", "component_velocity_displacement"
    ),
    seconds_per_disk_sample=4e-8,
)
MEANING = "v(0).v(t), mean over the disks of the most numerous species except the tracer's"
BATH_AUTOCORRELATION = Observable(
    bath_autocorrelation,
    {
        "bath_velocity_autocorrelation": RunArray(
            ("time",), "length^2/time^2", MEANING, averaged=True
        )
    },
    tracks_needed="bath",
    seconds_per_disk_sample=2e-9,
    why_unfit=lambda scene: (
        None if len(bath_disks(scene)) else "needs disks of another species than the tracer's"
    ),
)
EQUIPARTITION = (
    "kinetic energy per disk (kT in equilibrium; kT (1 - m/M) where the total momentum is zero, "
    "kT (1 - m/2M) where that along a channel is)"
)
ENERGY = Observable(
    species_energy,
    {"species_energy": RunArray(("time", "species"), "energy", EQUIPARTITION, averaged=True)},
    seconds_per_disk_sample=1.7e-8,
)
BEYOND = "centre of its bin; the last bin includes all beyond"
DISTRIBUTION = Observable(
    velocity_distribution,
    {
        "velocity_counts": RunArray(
            ("species", "velocity_bin"), "1", "histogram of the velocity components"
        ),
        "speed_counts": RunArray(("species", "speed_bin"), "1", "histogram of the speeds"),
    },
    axes={
        "velocity_bin": Axis(
            "sqrt(kT/mass)",
            f"velocity component, {BEYOND}, so does the first",
            lambda _: VELOCITIES,
        ),
        "speed_bin": Axis("sqrt(kT/mass)", f"speed, {BEYOND}", lambda _: SPEEDS),
    },
    seconds_per_disk_sample=2.8e-8,
    is_over_samples=True,
)
