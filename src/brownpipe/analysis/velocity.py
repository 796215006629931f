"""Velocities: autocorrelations, Green-Kubo integral, energies of the species, distributions.

What is averaged here are the arrays that `brownpipe.observables` makes of every run.
"""

import numpy as np

from brownpipe import observables, theory
from brownpipe.analysis.displacement import SAME_TIME, with_velocity
from brownpipe.analysis.measure import Columns, Measure, with_interval
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.thermodynamics import enskog
from brownpipe.analysis.variables import EACH, RATE, SPEED2, Variable, estimate_of

CORRELATIONS = ("velocity_autocorrelation", "bath_velocity_autocorrelation")
EARLY = 0.25  # of the velocity autocorrelation, lost at the times from which its initial slope is taken
COARSE = 0.2  # of it, lost at the first sample after 0, beyond which no such slope is stated
REACH = 1.0  # of the samples for the slope, in units of the relaxation time of Enskog's theory
DENSITIES = {"velocity_density": "velocity_counts", "speed_density": "speed_counts"}


def enskog_rate(scene):
    """Friction rate kT/(m D) [1/time] of the tracer by Enskog's theory; 0 where the scene has none."""
    theory_of = enskog(scene)
    return scene.velocities.temperature / (scene.mass[0] * theory_of["enskog_diffusion"]) if theory_of else 0.0


def early(times, rate):
    """Indices [0, i, j] of the samples from which the slope of the autocorrelation at 0 is taken.

    j is the last one at which, at the friction rate `rate`, no more than EARLY of it is lost, and i lies half-way. In
    coarse samples, or without a rate, the first three.
    """
    last = max(int(np.searchsorted(rate * times, EARLY, side="right")) - 1, 2) if rate else 2
    return [0, min(max(int(np.searchsorted(times, times[last] / 2)), 1), last - 1), last]


def twice_as_late(times, chosen, rate):
    """Indices [0, i', j'] of the samples at twice the times of those `chosen`; [0, i] where there are none in reach."""
    later = np.searchsorted(times, 2 * times[chosen] * (1 - SAME_TIME))
    if later[2] < len(times) and later[1] < later[2] and rate * times[later[2]] <= REACH:
        return later.tolist()
    return chosen[:2]


def slope_weights(times, rate=0.0):
    """Weights (K,) such that weights @ C is the slope at 0 of an autocorrelation C(times), times[0] = 0.

    That of C(t) exp(rate t) by the parabola through three points (the straight line through two), less rate C(0): exact
    for an exponential decay at that rate.
    """
    if len(times) == 2:
        weights = np.array([-1, 1]) / times[1]
    else:
        a, b = times[1:]
        weights = np.array([-(a + b) / (a * b), b / (a * (b - a)), -a / (b * (b - a))])
    return weights * np.exp(rate * times) - rate * (times == 0)


def density(counts, width):
    """Density (n, K, V) of `counts` (n, K, V) in bins of equal width."""
    return counts / counts.sum(axis=-1, keepdims=True) / width


def initial_slope(case, found):
    """Estimate of the slope at 0 of the tracer's autocorrelation, its error that of the samples' spacing included.

    The latter is the difference of the slope from that of samples twice as late, several times the error of the
    parabola; it is added to the standard error in quadrature, and to both ends of the interval. NaN where samples are
    too far apart: more than COARSE of the autocorrelation is lost at the first one.
    """
    mean = found.mean("velocity_autocorrelation")
    if "vacf_initial_slope" not in found or mean[0] - mean[1] > COARSE * mean[0]:
        return Estimate(*np.full(4, np.nan))
    rate, times, slope = enskog_rate(case.scene), case.times, found.estimate("vacf_initial_slope")
    later = twice_as_late(times, early(times, rate), rate)
    spacing = abs(slope.mean - (slope_weights(times[later], rate) * mean[later]).sum())
    return Estimate(slope.mean, np.hypot(slope.standard_error, spacing), slope.low - spacing, slope.high + spacing)


def expected_slope(case, found):
    """-(2 mu/m) (2 kT/m) rate of the tracer, the slope of its autocorrelation at 0 in equilibrium; rate as measured.

    Exact for hard disks whose kinetic energy is canonical over the runs: each collision takes 2 mu/m of the velocity
    along the line of centres, whose mean square is 2 kT/mu in a collision. 2 kT/m is the measured <v^2> or, in a box
    without total momentum, M/(M - m) times as much, M the mass of all disks: <v^2> lacks the motion of their centre of
    mass, relative velocities do not. NaN if the partners differ in mass, or without a rate.
    """
    scene = case.scene
    partners = np.unique(scene.mass[1:])
    if partners.size != 1 or "tracer_collisions" not in found:
        return np.nan
    rate = found.mean("tracer_collisions") / case.times[-1]
    share = 2 * theory.reduced_mass(scene.mass[0], partners[0]) / scene.mass[0]
    still = scene.velocities is not None and scene.velocities.zero_momentum
    at_rest = still and (scene.box.periodic or case.average != "origins")  # walls give the momentum back
    square_speed = found.mean("velocity_autocorrelation")[0] / (1 - at_rest * scene.mass[0] / scene.mass.sum())
    return -share * rate * square_speed


def _sample(case, runs):
    means = {name: runs.observables[name] for name in CORRELATIONS if name in runs.observables}
    if "velocity_autocorrelation" in means:
        if len(case.times) > 2:
            rate = enskog_rate(case.scene)
            chosen = early(case.times, rate)
            times, first = case.times[chosen], means["velocity_autocorrelation"][:, chosen]
            if rate * times[2] <= REACH:
                means["vacf_initial_slope"] = (first * slope_weights(times, rate)).sum(axis=1)
    integral = with_velocity(case, runs, "velocity_displacement")
    if integral is not None:
        means["green_kubo"] = integral / 2
    if "species_energy" in runs.observables:
        means["species_energy"] = runs.observables["species_energy"]
    for name, counts in DENSITIES.items():
        if counts in runs.observables:
            means[name] = density(runs.observables[counts], _width(case, counts))
    return Columns(means)


def _width(case, counts):
    values = observables.axes(case.scene, counts)[observables.ARRAYS[counts].dims[-1]]
    return values[1] - values[0]


def _estimate(case, found):
    names = (*CORRELATIONS, "green_kubo", "species_energy", *DENSITIES)
    values = {}
    for name in (name for name in names if name in found):
        values |= with_interval(name, found.estimate(name))
    if "velocity_autocorrelation" in found and len(case.times) > 2:
        values |= with_interval("vacf_initial_slope", initial_slope(case, found))
        values["vacf_initial_slope_expected"] = expected_slope(case, found)
    return values


def _axes(case, found):
    made = [counts for name, counts in DENSITIES.items() if name in found]
    made += ["species_energy"] if "species_energy" in found else []
    along = {dim: values for name in made for dim, values in observables.axes(case.scene, name).items()}
    return {dim: (dim, values) for dim, values in along.items() if dim != "time"}


TIME, SPECIES = (*EACH, "time"), (*EACH, "species")

MEASURE = Measure(
    _sample,
    _estimate,
    {
        **estimate_of("velocity_autocorrelation", TIME, SPEED2, "velocity autocorrelation v(0).v(t) of the tracer"),
        **estimate_of("bath_velocity_autocorrelation", TIME, SPEED2, "velocity autocorrelation v(0).v(t) in the bath"),
        **estimate_of(
            "green_kubo",
            TIME,
            RATE,
            "half of <v(0).(r(t) - r(0))> of the tracer, the integral of its velocity autocorrelation up to the time",
        ),
        **estimate_of(
            "vacf_initial_slope",
            EACH,
            "length^2/time^3",
            "slope at 0 of the velocity autocorrelation; its errors include that of the sample spacing",
        ),
        "vacf_initial_slope_expected": Variable(
            EACH,
            "length^2/time^3",
            "-(2 mu/m) (2 kT/m) times the measured collision rate; kT from <v^2> of the tracer",
        ),
        **estimate_of("species_energy", (*TIME, "species"), "energy", "kinetic energy per disk; kT in equilibrium"),
        **estimate_of("velocity_density", (*SPECIES, "velocity"), "1", "density of the velocity components"),
        **estimate_of("speed_density", (*SPECIES, "speed"), "1", "density of the speeds"),
    },
    _axes,
    {
        "species": {"long_name": "species of disks"},
        "velocity": {"units": "1", "long_name": "velocity component in units of sqrt(kT/m), middle of the bin"},
        "speed": {"units": "1", "long_name": "speed in units of sqrt(kT/m), middle of the bin"},
    },
)
