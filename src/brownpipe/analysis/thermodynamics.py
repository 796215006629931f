"""Thermodynamics from collisions: rates, temperature, compressibility factor, pressure; and
Enskog's theory of them.

Every run has its own kinetic temperature kT, from its energy: its rates are proportional to
sqrt(kT), its virial to kT. n runs. See docs/theory.md, section 3.
"""

import numpy as np

from brownpipe import theory
from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.variables import CASE_DIMS, ERROR, RATE, Mean, Variable
from brownpipe.engines import friction
from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.friction import (
    DENSEST,
    drift_diffusion,
    mean_root,
    rate_at_temperature,
)
from brownpipe.scene import Scene, motion
from brownpipe.scene.species import kinds_of


def temperature(scene: Scene, energy: np.ndarray) -> np.ndarray:
    """Return kT (n,) [energy] of runs with kinetic energies (n,): energy per disk.

    In a periodic box with zero total momentum, which is conserved, two degrees of freedom are
    missing: N - 1 disks. In a channel it is one, along it: N - 1/2.
    """
    return energy / (motion.moving_disks(scene) or np.nan)


def compressibility(
    scene: Scene, virial: np.ndarray, kt: np.ndarray, duration: float
) -> np.ndarray:
    """Return Z = 1 + W/(2 N kT T) (n,), W the sum of abs(momentum transfer) * contact distance in a
    time T.

    W is the `virial` (n,) of pair collisions, T the duration. In a periodic box Z = P/(n kT).
    Between walls it is not: the forces of the walls, which act on centres at a distance R from the
    sides w and h, contribute to the virial, too. By the virial theorem, for equal disks and the
    same pressure P on all walls, as in a square (w = h),

        2 N kT + W/T = P [h (w - 2R) + w (h - 2R)],  so that  Z = Z_wall (1 - R/w - R/h),

    with Z_wall = P/(n kT), n = N/A, A the area of the box. With several species R is the mean
    radius weighted by the momentum transferred to the walls. In other rectangles the mean pressures
    on short and long walls differ, to first order in R/w even for an ideal gas, and Z_wall is that
    of both together.

    In a channel of height h and length w along x, F the force across a section of it,

        N kT + W_x/T = F w,  N kT + W_y/T = P w (h - 2R),  so that  Z = (Z_x + Z_y)/2

    with Z_x = F w/(N kT) and Z_y = Z_wall (1 - 2R/h). Z_x is Z_y for an ideal gas, but 2.08 where
    Z_y is 2.00 in a channel 8 diameters high at a packing fraction of 0.29.
    """
    return 1.0 + virial / (2.0 * scene.particles * kt * duration)


def compressibility_from_rate(scene: Scene, rate: np.ndarray, kt: np.ndarray) -> np.ndarray:
    """Return Z = 1 + 2 phi chi (n,) of equal disks from their collision rate (n,).

    With the diameter s the canonical mean of the rate is 2 n s chi sqrt(pi kT/m), so Z = 1 + rate s
    sqrt(pi m/kT)/4. At the constant energy of a run the mean relative speed is larger by
    1/`mean_root`.
    """
    inverse_speed = np.sqrt(np.pi * scene.mass[0] / kt)
    return 1.0 + mean_root(scene) * rate * 2 * scene.radius[0] * inverse_speed / 4.0


def enskog(scene: Scene) -> dict[str, float]:
    """Return collision rates, contact value, compressibility and the tracer's diffusion coefficient
    by Enskog's theory.

    At the mean density of the box, with or without walls; {} without a temperature or beyond the
    packing fraction DENSEST. The tracer's rate and contact value are those of the langevin engine
    (`friction.partners_of`), and so is its diffusion coefficient f^2 kT/(m gamma), f of
    `motion.bath_share`.
    """
    kt = motion.temperature(scene)
    if not kt or scene.particles < 2 or scene.packing_fraction > DENSEST:
        return {}
    kinds = kinds_of(scene)
    number = kinds.number
    n = number / scene.box.area
    rates = theory.mixture_collision_rates(n, 2 * kinds.radius, kinds.mass, kt)
    rates = rates * (1 - np.diag(1 / number))  # none with itself
    collision_rate = (number * rates.sum(axis=1)).sum() / number.sum()
    partners = friction.partners_of(scene)
    main_partner = np.argmax(friction.bath_of(scene).number)
    gamma = partners.friction.sum()
    diffusion = motion.bath_share(scene) ** 2 * kt / (scene.mass[0] * gamma)
    return {
        "enskog_collision_rate": collision_rate,
        "enskog_tracer_collision_rate": partners.rate.sum(),
        "enskog_contact_value": partners.contact_value[main_partner],
        "enskog_compressibility": theory.mixture_compressibility(n, 2 * kinds.radius),
        "enskog_diffusion": diffusion,
    }


def thermodynamic_columns(case: Case, runs: Ensemble) -> Columns:
    """Return rates, temperatures and compressibility factors of the runs of hard disks."""
    scene = case.scene
    duration = case.times[-1]
    measured = runs.observables
    if "pair_collisions" not in measured or not scene.particles:
        return Columns()
    counts = ("pair_collisions", "wall_collisions", "tracer_collisions")
    means = {name: measured[name] for name in counts}
    means["collision_rate"] = 2 * measured["pair_collisions"] / (scene.particles * duration)
    means["tracer_collision_rate"] = measured["tracer_collisions"] / duration
    if "kinetic_energy" not in measured:
        return Columns(means)
    kt = temperature(scene, measured["kinetic_energy"])
    hot = np.where(kt > 0, kt, np.nan)  # NaN: nothing moves
    if scene.particles > 1 and np.ptp(scene.radius) == np.ptp(scene.mass) == 0:
        rate = means["collision_rate"]
        means["compressibility_rate"] = compressibility_from_rate(scene, rate, hot)
    if motion.temperature(scene) and scene.particles > 1:
        for name in ("collision_rate", "tracer_collision_rate"):
            means[f"{name}_at_temperature"] = rate_at_temperature(scene, means[name], hot)
    means["kinetic_temperature"] = kt
    means["compressibility"] = compressibility(scene, measured["virial"], hot, duration)
    if "wall_impulse" in measured:
        across = scene.box.size[::-1]  # how long the sides at right angles to x and y are
        walls = 2 * across[~scene.box.periodic_axes].sum()
        pressure = measured["wall_impulse"] / (walls * duration)
        means["wall_pressure"] = pressure
        means["wall_compressibility"] = pressure * scene.box.area / (scene.particles * hot)
    return Columns(means)


def thermodynamic_results(case: Case, _: Averages) -> dict[str, float]:
    """Return Enskog's theory, and what the drift of the centre of mass adds to D, if anything."""
    values = enskog(case.scene)
    drift = drift_diffusion(case.scene)
    if case.engine.moves_all_disks and drift > 0:
        values["drift_diffusion"] = drift
    return values


AT_TEMPERATURE = "per time, at the temperature of the scene"

VARIABLES = {
    "pair_collisions": Variable(
        CASE_DIMS, "1", "mean number of collisions between disks in a run", ERROR
    ),
    "wall_collisions": Variable(
        CASE_DIMS, "1", "mean number of collisions with walls in a run", ERROR
    ),
    "tracer_collisions": Variable(
        CASE_DIMS, "1", "mean number of collisions of the tracer in a run", ERROR
    ),
    "collision_rate": Mean(CASE_DIMS, "1/time", "collisions of a disk with others per time"),
    "tracer_collision_rate": Mean(
        CASE_DIMS, "1/time", "collisions of the tracer with others per time"
    ),
    "collision_rate_at_temperature": Mean(
        CASE_DIMS, "1/time", f"collisions of a disk with others {AT_TEMPERATURE}"
    ),
    "tracer_collision_rate_at_temperature": Mean(
        CASE_DIMS, "1/time", f"collisions of the tracer {AT_TEMPERATURE}"
    ),
    "kinetic_temperature": Mean(CASE_DIMS, "energy", "temperature kT from the kinetic energy"),
    "compressibility": Mean(
        CASE_DIMS,
        "1",
        "compressibility factor 1 + W/(2 N kT t), W the virial; P/(n kT) if periodic",
    ),
    "wall_compressibility": Mean(
        CASE_DIMS, "1", "compressibility factor P/(n kT), P the pressure on the walls, n = N/A"
    ),
    "compressibility_rate": Mean(
        CASE_DIMS, "1", "compressibility factor of equal disks from their collision rate"
    ),
    "wall_pressure": Mean(
        CASE_DIMS,
        "energy/length^2",
        "pressure on the walls: momentum transferred per length and time",
    ),
    "enskog_collision_rate": Variable(
        CASE_DIMS, "1/time", "collisions of a disk with others per time, Enskog's theory"
    ),
    "enskog_tracer_collision_rate": Variable(
        CASE_DIMS, "1/time", "collisions of the tracer per time, Enskog's theory"
    ),
    "enskog_contact_value": Variable(
        CASE_DIMS, "1", "theoretical contact value of tracer and main species of its bath"
    ),
    "enskog_compressibility": Variable(
        CASE_DIMS, "1", "compressibility factor from Enskog's contact values"
    ),
    "enskog_diffusion": Variable(
        CASE_DIMS, RATE, "diffusion coefficient by Enskog's theory, without drift of all disks"
    ),
    "drift_diffusion": Variable(
        CASE_DIMS, RATE, "what the drift of the centre of mass adds to D by the end of a run"
    ),
}

ESTIMATOR = Estimator(
    name="thermodynamics",
    variables=VARIABLES,
    columns=thermodynamic_columns,
    results=thermodynamic_results,
)
