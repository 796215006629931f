"""Velocities: autocorrelations, Green-Kubo integral, energies of the species, distributions.

Averages over runs of the arrays that `brownpipe.observables` measures in every run. n runs of a
block, T sample times. See docs/theory.md, section 4.
"""

import numpy as np
from numpy.typing import ArrayLike

from brownpipe import theory
from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.thermodynamics import enskog
from brownpipe.analysis.variables import (
    CASE_DIMS,
    FOLLOWED,
    RATE,
    SAME_TIME,
    SPEED2,
    TIME,
    Mean,
    Variable,
)
from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.friction import partners_of
from brownpipe.observables import AXES
from brownpipe.observables.equilibrium import claims_equilibrium
from brownpipe.scene import Scene, motion

# last of the samples that give the initial slope, in units of the inverse of `fastest_rate`
EARLY = 0.25
# decay at the first sample after 0 beyond which the sampling is too coarse for an initial slope
COARSE = 0.2
# Mean free times after which the tail is that of theory, at packing fractions: as J. J. Erpenbeck
# and W. W. Wood compare them, Phys. Rev. A 26, 1648 (1982)
TAIL_DENSITIES = (0.14, 0.30, 0.45)
TAIL_STARTS = (20.0, 30.0, 40.0)
CROSSED = 0.7  # the tail is that of an infinite fluid up to this share of the sound-crossing time
LATEST = 1.0  # latest of these samples, in units of the inverse of `fastest_rate`


def enskog_rate(scene: Scene) -> float:
    """Return the friction rate gamma [1/time] of the tracer by Enskog's theory; 0 where that does
    not apply.
    """
    return float(partners_of(scene).friction.sum()) if enskog(scene) else 0.0


def fastest_rate(scene: Scene) -> float:
    """Return the friction rate of the tracer or the collision rate of all disks, whichever is
    larger; 0 for neither.

    Once the bath has had collisions, it returns to a heavy tracer part of the momentum that it
    took: the friction is no longer that of the initial slope, long before the tracer slows down.
    """
    return max(enskog_rate(scene), enskog(scene).get("enskog_collision_rate", 0.0))


def samples_of_initial_slope(times: np.ndarray, rate: float) -> list[int]:
    """Return the indices [0, i, j] of the samples for the slope of the autocorrelation at 0.

    j is the last sample at which the decay at the rate `rate` (`fastest_rate`) is at most EARLY,
    and i lies half-way. If samples are coarse, or without a rate, the first three.
    """
    last = 2
    if rate:
        samples = int(np.searchsorted(rate * times, EARLY, side="right"))
        last = max(samples - 1, 2)
    middle = int(np.searchsorted(times, times[last] / 2))
    return [0, min(max(middle, 1), last - 1), last]


def samples_twice_as_late(times: np.ndarray, samples: list[int], rate: float) -> list[int]:
    """Return the indices [0, i', j'] of the samples at twice the times of `samples` [0, i, j].

    [0, i] if these are later than LATEST.
    """
    later = np.searchsorted(times, 2 * times[samples] * (1 - SAME_TIME))
    if later[2] < len(times) and later[1] < later[2] and rate * times[later[2]] <= LATEST:
        return later.tolist()
    return samples[:2]


def slope_weights(times: np.ndarray, rate: float = 0.0) -> np.ndarray:
    """Return weights (K,) such that weights @ C is the slope at 0 of an autocorrelation C(times),
    times[0] = 0.

    The slope of C(t) exp(rate t), by the parabola through three points (the straight line through
    two), minus rate C(0): exact for an exponential decay at that rate.
    """
    powers = np.vander(times / times[-1], increasing=True)
    weights = np.linalg.inv(powers)[1] / times[-1]
    return weights * np.exp(rate * times) - rate * (times == 0)


def initial_slope(case: Case, averages: Averages) -> Estimate:
    """Return the slope at 0 of the tracer's autocorrelation; its error includes the discretisation
    error.

    The latter is taken to be the difference from the slope obtained with samples twice as late,
    which is several times the actual error of the parabola. It is added to the standard error in
    quadrature, and to both ends of the interval. NaN if the decay at the first sample exceeds
    COARSE.
    """
    mean = averages.mean("velocity_autocorrelation")
    if "vacf_initial_slope" not in averages.places or mean[0] - mean[1] > COARSE * mean[0]:
        return Estimate(*np.full(4, np.nan))
    times = case.times
    fastest = fastest_rate(case.scene)
    later = samples_twice_as_late(times, samples_of_initial_slope(times, fastest), fastest)
    weights = slope_weights(times[later], enskog_rate(case.scene))
    slope = averages.estimate("vacf_initial_slope")
    systematic = abs(slope.mean - (weights * mean[later]).sum())
    error = np.hypot(slope.standard_error, systematic)
    return Estimate(slope.mean, error, slope.low - systematic, slope.high + systematic)


def expected_slope(case: Case, averages: Averages) -> float:
    """Return -(2 mu/m) (2 kT/m) rate, the slope at 0 of the tracer's autocorrelation in
    equilibrium.

    Exact for hard disks with a canonical distribution of energies over the runs, and the measured
    collision rate: a collision changes the tracer's velocity by 2 mu/m times the relative velocity
    along the line of centres, whose mean square in a collision is 2 kT/mu. 2 kT/m is the measured
    <v^2> or, with zero total momentum, M/(M - m) times that, M the mass of all disks: <v^2> lacks
    the motion of the centre of mass, relative velocities do not.

    NaN if the partners differ in mass, without a rate, and where the rate at t = 0 is not the mean
    rate of the runs, which is measured: in scenes that do not claim to be in equilibrium at one
    temperature, and with walls, near which the rate differs and which turn the velocity, too.
    """
    scene = case.scene
    partners = np.unique(scene.mass[1:])
    is_settled = motion.is_thermal(scene) and claims_equilibrium(scene)
    has_one_rate = is_settled and not scene.box.has_walls
    if partners.size != 1 or not has_one_rate or "tracer_collisions" not in averages.places:
        return np.nan
    rate = averages.mean("tracer_collisions") / case.times[-1]
    share = 2 * theory.reduced_mass(scene.mass[0], partners[0]) / scene.mass[0]
    is_at_rest = motion.keeps_momentum_zero(scene)
    lacking_share = scene.mass[0] / scene.mass.sum() if is_at_rest else 0.0
    square_speed = averages.mean("velocity_autocorrelation")[0] / (1 - lacking_share)
    return -share * rate * square_speed


def tail_of_fluid(case: Case) -> np.ndarray | None:
    """Return the tail of the velocity autocorrelation (T,) [length^2/time^2] by mode-coupling
    theory, (2 kT/m) (a/t - 1/N) with zero total momentum, otherwise without 1/N; NaN at other times
    than those of the tail.

    With D and the viscosity of Enskog's theory in all Sonine orders. None unless the scene is a
    periodic fluid of equal disks, and a sample is late enough, but before sound has crossed the
    box. docs/theory.md, section 4.
    """
    scene = case.scene
    has_equal_disks = len(np.unique(scene.mass)) == len(np.unique(scene.radius)) == 1
    kt = motion.temperature(scene)
    if not kt or not has_equal_disks or scene.box.has_walls or scene.tracer_velocity is not None:
        return None
    if not enskog(scene):
        return None
    phi = scene.packing_fraction
    n = scene.particles / scene.box.area
    mass = scene.mass[0]
    diameter = 2 * scene.radius[0]
    contact = theory.contact_value(phi)
    friction = theory.enskog_friction(n, diameter, contact, mass / 2, kt)
    diffusion = theory.SONINE_DIFFUSION * kt / friction
    viscosity = theory.enskog_viscosity(n, diameter, contact, mass, kt) / (n * mass)
    rate = theory.collision_rate(n, diameter, contact, mass / 2, kt)
    start = np.interp(phi, TAIL_DENSITIES, TAIL_STARTS) / rate
    crossing = min(scene.box.width, scene.box.height) / theory.sound_speed(phi, mass, kt)
    is_tail = (case.times >= start) & (case.times <= CROSSED * crossing)
    if not is_tail.any():
        return None
    amplitude = theory.tail_amplitude(n, diffusion, viscosity)
    lacking = 1 / scene.particles if motion.keeps_momentum_zero(scene) else 0.0
    tail = np.full(len(case.times), np.nan)
    tail[is_tail] = 2 * kt / mass * (amplitude / case.times[is_tail] - lacking)
    return tail


def velocity_columns(case: Case, runs: Ensemble) -> Columns:
    """Return autocorrelation, its slope at 0, running D and densities."""
    measured = runs.observables
    means = {}
    if "velocity_autocorrelation" in measured:
        autocorrelation = measured["velocity_autocorrelation"]
        means["velocity_autocorrelation"] = autocorrelation
        if len(case.times) > 2:
            fastest = fastest_rate(case.scene)
            samples = samples_of_initial_slope(case.times, fastest)
            if fastest * case.times[samples[2]] <= LATEST:
                weights = slope_weights(case.times[samples], enskog_rate(case.scene))
                means["vacf_initial_slope"] = (autocorrelation[:, samples] * weights).sum(axis=1)
    if "displacement_velocity" in measured:
        means["diffusion_running"] = measured["displacement_velocity"] / 2
    if "velocity_displacement" in measured:
        means["green_kubo"] = measured["velocity_displacement"] / 2
    for name in ("velocity", "speed"):
        if f"{name}_counts" in measured:
            counts = measured[f"{name}_counts"]  # (n, K, V) of K species in V bins of equal width
            middles = np.asarray(AXES[f"{name}_bin"].coordinates(case.scene))
            shares = counts / counts.sum(axis=-1, keepdims=True)
            means[f"{name}_density"] = shares / (middles[1] - middles[0])
    return Columns(means)


def velocity_results(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return the slope of the autocorrelation at 0, its value in equilibrium, and the tail of
    theory.
    """
    if "velocity_autocorrelation" not in averages.places or len(case.times) < 3:
        return {}
    results: dict[str, ArrayLike] = {
        "vacf_initial_slope": initial_slope(case, averages),
        "vacf_initial_slope_expected": expected_slope(case, averages),
    }
    tail = tail_of_fluid(case)
    if tail is not None:
        results["vacf_tail"] = tail
    return results


SPECIES = (*CASE_DIMS, "species")
SLOPE = "length^2/time^3"

VARIABLES = {
    "diffusion_running": Mean(
        TIME, RATE, f"half of <v(t).(r(t) - r(0))> {FOLLOWED}, d<r^2>/dt / 4"
    ),
    "velocity_autocorrelation": Mean(
        TIME, SPEED2, f"velocity autocorrelation v(0).v(t) {FOLLOWED}"
    ),
    "green_kubo": Mean(
        TIME,
        RATE,
        f"half of the integral of the autocorrelation, <v(0).(r(t) - r(0))>/2, {FOLLOWED}",
    ),
    "vacf_initial_slope": Mean(
        CASE_DIMS, SLOPE, "initial slope of the autocorrelation; errors include that of sampling"
    ),
    "vacf_initial_slope_expected": Variable(
        CASE_DIMS, SLOPE, "initial slope expected from <v^2> and collision rate"
    ),
    "vacf_tail": Variable(
        TIME, SPEED2, "tail of the autocorrelation by mode-coupling theory, with Enskog's D and nu"
    ),
    "velocity_density": Mean(
        (*SPECIES, "velocity_bin"), "1", "probability density of the velocity components"
    ),
    "speed_density": Mean((*SPECIES, "speed_bin"), "1", "probability density of the speeds"),
}

ESTIMATOR = Estimator(
    name="velocity",
    variables=VARIABLES,
    columns=velocity_columns,
    results=velocity_results,
)
