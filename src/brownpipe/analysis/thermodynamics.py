"""Collisions and what they say: rates, temperature, compressibility, pressure, against Enskog's theory.

Every run has its own temperature, from its own energy: rates and the virial of a run scale with it exactly.
"""

import numpy as np

from brownpipe import theory
from brownpipe.analysis.measure import Columns, Measure, with_error, with_interval
from brownpipe.analysis.variables import EACH, RATE, Variable, error_of, estimate_of
from brownpipe.engines import friction
from brownpipe.engines.friction import DENSEST

COLLISIONS = ("pair_collisions", "wall_collisions", "tracer_collisions")
RATES = ("collision_rate", "tracer_collision_rate")


def temperature(scene, energy):
    """kT [energy] of runs with kinetic energies (n,): energy per disk.

    In a periodic box without total momentum two degrees of freedom are missing: per disk but one.
    """
    return energy / (_moving(scene) or np.nan)


def _moving(scene):
    """Half of the degrees of freedom of the velocities."""
    return scene.particles - (scene.box.periodic and scene.velocities is not None and scene.velocities.zero_momentum)


def rate_at(temperature, scene, rate, kt):
    """Collision rates (n,) of runs with kinetic temperatures `kt` (n,), scaled to the canonical mean at `temperature`.

    If all velocities are multiplied by a factor, hard disks follow the same paths, faster by this factor: rates go as
    sqrt(kt). Over runs with velocities drawn at `temperature` the mean of sqrt(kt/temperature) is slightly below 1
    (`mean_root`). With this factor the scaled rate has, in equilibrium, the mean of the rate itself, without the
    scatter of the temperatures of runs.
    """
    return rate * np.sqrt(temperature / kt) * mean_root(scene)


def mean_root(scene):
    """Mean of sqrt(kT_run/kT) over runs with velocities drawn at kT: `theory.mean_root_chi_square`."""
    return theory.mean_root_chi_square(2 * _moving(scene))


def compressibility(scene, virial, kt, duration):
    """Z = 1 + W/(2 N kT T), W the sum of abs(momentum transfer) * contact distance over pair collisions in a time T.

    In a periodic box this is P/(n kT). Between walls it is not: their forces act on centres at a distance R from the
    sides w and h and have a virial, too. By the virial theorem, for equal disks and one pressure P on all walls,

        2 N kT + W/T = P [h (w - 2R) + w (h - 2R)],  so that  Z = Z_wall (1 - R/w - R/h),

    with Z_wall = P/(n kT) of `wall_compressibility`. With several species R is the mean over the momentum that the
    walls receive.
    """
    return 1.0 + virial / (2.0 * scene.particles * kt * duration)


def wall_compressibility(scene, pressure, kt):
    """Z_wall = P/(n kT) with the `pressure` P on the walls and n = N/A, A the area of the box."""
    return pressure * scene.box.area / (scene.particles * kt)


def compressibility_from_rate(scene, rate, kt):
    """Z = 1 + 2 phi chi of equal disks, whose collision rate is 2 n s chi sqrt(pi kT/m): 1 + rate s sqrt(pi m/kT)/4.

    This is the mean rate over energies. A run keeps its own, at which disks are faster by 1/`mean_root`.
    """
    return 1.0 + mean_root(scene) * rate * 2 * scene.radius[0] * np.sqrt(np.pi * scene.mass[0] / kt) / 4.0


def is_alike(scene):
    """Are all disks equal, and two or more?"""
    return scene.particles > 1 and np.ptp(scene.radius) == 0 and np.ptp(scene.mass) == 0


def enskog(scene):
    """Collision rates, contact value, compressibility, and diffusion coefficient of the tracer: Enskog's theory.

    Of the whole box, walls or not; {} without a temperature or beyond DENSEST. The tracer's own rate, contact value and
    diffusion coefficient kT/(m gamma) are those of the langevin engine (`friction.partners_of`).
    """
    kt = scene.velocities and scene.velocities.temperature
    if not kt or scene.particles < 2 or scene.packing_fraction > DENSEST:
        return {}
    kinds = [one for one in scene.species if one.count]
    radius, mass, number = (np.array([getattr(one, of) for one in kinds]) for of in ("radius", "mass", "count"))
    n = number / scene.box.area
    rates = theory.mixture_collision_rates(n, 2 * radius, mass, kt)
    rates = rates * np.where(np.eye(len(kinds)) > 0, (1 - 1 / number), 1.0)  # no disk meets itself
    partners = friction.partners_of(scene)
    return {
        "enskog_collision_rate": (number * rates.sum(axis=1)).sum() / number.sum(),
        "enskog_tracer_collision_rate": partners.rate.sum(),
        "enskog_contact_value": partners.contact_value[np.argmax(friction.bath_of(scene).number)],
        "enskog_compressibility": theory.mixture_compressibility(n, 2 * radius),
        "enskog_diffusion": kt / (mass[0] * partners.friction.sum()),
    }


def _sample(case, runs):
    scene, seen, duration = case.scene, runs.observables, case.times[-1]
    means = {name: seen[name] for name in COLLISIONS if name in seen}
    if "pair_collisions" in seen and scene.particles:
        means["collision_rate"] = 2 * seen["pair_collisions"] / (scene.particles * duration)
    if "tracer_collisions" in seen and scene.particles:
        means["tracer_collision_rate"] = seen["tracer_collisions"] / duration
    if "wall_impulse" in seen:
        means["wall_pressure"] = seen["wall_impulse"] / (2 * (scene.box.width + scene.box.height) * duration)
    if "kinetic_energy" in seen and scene.particles:
        means |= _of_temperature(case, seen, temperature(scene, seen["kinetic_energy"]), means)
    return Columns(means)


def _of_temperature(case, seen, kt, means):
    """What needs the temperature of the runs (n,); NaN where nothing moves."""
    scene, found, hot = case.scene, {"kinetic_temperature": kt}, np.where(kt > 0, kt, np.nan)
    if "virial" in seen:
        found["compressibility"] = compressibility(scene, seen["virial"], hot, case.times[-1])
    if scene.velocities and scene.velocities.temperature and scene.particles > 1:
        for name in (name for name in RATES if name in means):
            found[f"{name}_at_temperature"] = rate_at(scene.velocities.temperature, scene, means[name], hot)
    if "wall_pressure" in means:
        found["wall_compressibility"] = wall_compressibility(scene, means["wall_pressure"], hot)
    if "collision_rate" in means and is_alike(scene):
        found["compressibility_rate"] = compressibility_from_rate(scene, means["collision_rate"], hot)
    return found


MEASURED = {
    "collision_rate": ("1/time", "collisions of a disk with others per time"),
    "tracer_collision_rate": ("1/time", "collisions of the tracer with others per time"),
    "collision_rate_at_temperature": (
        "1/time", "collisions of a disk with others per time, each run's scaled to the temperature of the scene"
    ),
    "tracer_collision_rate_at_temperature": (
        "1/time", "collisions of the tracer with others per time, each run's scaled to the temperature of the scene"
    ),
    "kinetic_temperature": ("energy", "temperature kT from the kinetic energy"),
    "compressibility": (
        "1", "compressibility factor 1 + W/(2 N kT t), W the virial of pair collisions in time t; P/(n kT) if periodic"
    ),
    "wall_compressibility": ("1", "compressibility factor P/(n kT) from the pressure P on the walls, n = N/A"),
    "compressibility_rate": ("1", "compressibility factor of equal disks from their collision rate"),
    "wall_pressure": ("energy/length^2", "momentum given to the walls per length and time"),
}  # fmt: skip


def _estimate(case, found):
    values = {}
    for name in (name for name in COLLISIONS if name in found):
        values |= with_error(name, found.estimate(name))
    for name in (name for name in MEASURED if name in found):
        values |= with_interval(name, found.estimate(name))
    return values | enskog(case.scene)


MEASURE = Measure(
    _sample,
    _estimate,
    {
        **error_of("pair_collisions", EACH, "1", "mean number of collisions between disks in a run"),
        **error_of("wall_collisions", EACH, "1", "mean number of collisions with walls in a run"),
        **error_of("tracer_collisions", EACH, "1", "mean number of collisions of the tracer with other disks in a run"),
        **{
            key: one
            for name, (unit, text) in MEASURED.items()
            for key, one in estimate_of(name, EACH, unit, text).items()
        },
        "enskog_collision_rate": Variable(EACH, "1/time", "collisions of a disk with others per time, Enskog's theory"),
        "enskog_tracer_collision_rate": Variable(EACH, "1/time", "collisions of the tracer per time, Enskog's theory"),
        "enskog_contact_value": Variable(EACH, "1", "contact value of the tracer and its most numerous partners"),
        "enskog_compressibility": Variable(
            EACH, "1", "compressibility factor of a periodic box, from the contact values"
        ),
        "enskog_diffusion": Variable(EACH, RATE, "diffusion coefficient of the tracer, Enskog's theory"),
    },
)
