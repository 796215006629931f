"""Velocities: autocorrelations, Green-Kubo integral, energies of the species, distributions.

What is averaged here are the arrays that `brownpipe.observables` makes of every run.
"""

import numpy as np

from brownpipe import theory
from brownpipe.analysis.displacement import with_velocity
from brownpipe.analysis.measure import Columns, Measure, with_interval
from brownpipe.analysis.thermodynamics import enskog
from brownpipe.analysis.variables import EACH, RATE, SPEED2, Variable, estimate_of

CORRELATIONS = ("velocity_autocorrelation", "bath_velocity_autocorrelation")
EARLY = 0.25  # of the velocity autocorrelation, lost at the times from which its initial slope is taken
DENSITIES = {"velocity_density": "velocity_counts", "speed_density": "speed_counts"}


def early(scene, times):
    """Indices [0, i, j] of the samples that show how the autocorrelation begins.

    j is the last one at which, by Enskog's theory, no more than EARLY of it is lost, and i lies half-way: a parabola
    through these is off by EARLY^2/12 = 0.5 %. Without such theory, or in coarse samples, the first three.
    """
    theory_of = enskog(scene)
    if not theory_of:
        return [0, 1, 2]
    loss = scene.velocities.temperature / (scene.mass[0] * theory_of["enskog_diffusion"]) * times
    last = max(int(np.searchsorted(loss, EARLY, side="right")) - 1, 2)
    return [0, min(max(int(np.searchsorted(times, times[last] / 2)), 1), last - 1), last]


def slope_weights(times):
    """Weights (3,) such that weights @ y is the slope at times[0] of the parabola through three points y(times)."""
    a, b = times[1:3] - times[0]
    return np.array([-(a + b) / (a * b), b / (a * (b - a)), -a / (b * (b - a))])


def density(counts, width):
    """Density (n, K, V) of `counts` (n, K, V) in bins of equal width."""
    return counts / counts.sum(axis=-1, keepdims=True) / width


def expected_slope(case, found):
    """-(2 mu/m) rate <v^2> of the tracer, the slope of its autocorrelation at 0 in equilibrium, with the measured rate.

    Exact for hard disks (each collision takes 2 mu/m of the velocity along the line of centres). NaN if its partners
    differ in mass, or without a rate.
    """
    partners = np.unique(case.scene.mass[1:])
    if partners.size != 1 or "tracer_collisions" not in found:
        return np.nan
    rate = found.mean("tracer_collisions") / case.times[-1]
    share = 2 * theory.reduced_mass(case.scene.mass[0], partners[0]) / case.scene.mass[0]
    return -share * rate * found.mean("velocity_autocorrelation")[0]


def _sample(case, runs):
    means = {name: runs.observables[name] for name in CORRELATIONS if name in runs.observables}
    if "velocity_autocorrelation" in means:
        if len(case.times) > 2:
            chosen = early(case.scene, case.times)
            first = means["velocity_autocorrelation"][:, chosen]
            means["vacf_initial_slope"] = (first * slope_weights(case.times[chosen])).sum(axis=1)
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
    from brownpipe import observables

    values = observables.axes(case.scene, counts)[observables.VARIABLES[counts].dims[-1]]
    return values[1] - values[0]


def _estimate(case, found):
    names = (*CORRELATIONS, "green_kubo", "vacf_initial_slope", "species_energy", *DENSITIES)
    values = {}
    for name in (name for name in names if name in found):
        values |= with_interval(name, found.estimate(name))
    if "vacf_initial_slope" in values:
        values["vacf_initial_slope_expected"] = expected_slope(case, found)
    return values


def _axes(case, found):
    from brownpipe import observables

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
            "vacf_initial_slope", EACH, "length^2/time^3", "slope at 0 of the velocity autocorrelation, by a parabola"
        ),
        "vacf_initial_slope_expected": Variable(
            EACH, "length^2/time^3", "-(2 mu/m) <v^2> times the measured collision rate of the tracer"
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
