"""Datasets with every variable that a figure can show, made up on top of one of real or made-up
displacements.

The curves have the right shape and a noise that their intervals tell of; nothing else about them is
physics.
"""

import numpy as np
import xarray

from brownpipe import theory
from brownpipe.report.products import write

SPECIES = ("tracer", "bath")
PAIRS = ("tracer-tracer", "tracer-bath", "bath-bath")
CONTACT = (0.6, 0.4, 0.2)  # distances
CASE_DIMS = ("scene", "particles", "engine")
RECORD = {"panel": ["scene"], "made_by": {}, "dataset": {"sha256": "0" * 64}}


def render(dataset, folder, names=None, particles=None):
    """Write the products of a dataset, of the figures only `names` if given, into a folder; return
    the paths.
    """
    options = {"figures": names, "particles": particles}
    return write(
        dataset,
        folder,
        RECORD | {name: value for name, value in options.items() if value is not None},
    )


class MadeUp:
    """Variables of a dataset, made up one after the other."""

    def __init__(self, dataset):
        self.dataset = dataset
        self.rng = np.random.default_rng(1)
        self.variables = {}

    def known(self, name, dims, values):
        """Add a variable with the dimensions `dims` besides those of the cases: the same values for
        every scene, particle count and engine, unless they differ.
        """
        cases = [self.dataset.sizes[dim] for dim in CASE_DIMS]
        shape = np.shape(values)[-len(dims) :] if dims else ()
        spread = np.broadcast_to(values, [*cases, *shape]).copy()
        self.variables[name] = ((*CASE_DIMS, *dims), spread)

    def measured(self, name, dims, mean, error):
        """Add a mean that is off by its standard error, and the interval that covers it."""
        self.known(name, dims, mean)
        _, mean = self.variables[name]
        mean = mean + self.rng.standard_normal(mean.shape) * error
        error = np.broadcast_to(error, mean.shape)
        self.known(name, dims, mean)
        self.known(f"{name}_standard_error", dims, error)
        self.known(f"{name}_low", dims, mean - 1.96 * error)
        self.known(f"{name}_high", dims, mean + 1.96 * error)

    def coordinate(self, name, values):
        self.variables[name] = (name, values)


def with_measures(dataset):
    """The dataset with all variables of observables and thermodynamics added."""
    made_up = MadeUp(dataset)
    _over_time(made_up)
    _energies(made_up)
    _passage(made_up)
    _velocities(made_up)
    _pairs(made_up)
    _walls(made_up)
    _thermodynamics(made_up)
    _own(made_up)
    added = dataset.assign(made_up.variables)
    return added.assign_coords(species=list(SPECIES), species_pair=list(PAIRS))


def at_times(dataset, times):
    """The dataset with the same distribution of displacements at several times."""
    names = [name for name in dataset.variables if "displacement_time" in dataset[name].dims]
    each = [
        dataset[names].isel(displacement_time=[0]).assign_coords(displacement_time=[time])
        for time in times
    ]
    return dataset.drop_vars(names).merge(xarray.concat(each, "displacement_time"))


def _over_time(made_up):
    """An MSD over 4 t, and a velocity autocorrelation with a tail in 1/t, with its integral."""
    dataset = made_up.dataset
    t = dataset.time.values
    rate = 8.0
    square_speed = dataset.initial_square_speed.values[..., None]
    msd_over_4t = dataset.msd_over_4t.values
    made_up.measured("msd_over_4t", ["time"], msd_over_4t, 0.02 * msd_over_4t)
    running = np.gradient(dataset.msd.values, t, axis=-1) / 4
    made_up.measured("diffusion_running", ["time"], running, 0.006)
    tail = 0.004 / np.maximum(t, 0.02) * (1 - np.exp(-10 * t))
    autocorrelation = square_speed * (0.97 * np.exp(-rate * t) + tail)
    made_up.measured("velocity_autocorrelation", ["time"], autocorrelation, 0.012 * square_speed)
    made_up.measured("bath_velocity_autocorrelation", ["time"], 8 * np.exp(-3 * t), 0.002)
    trapezia = (autocorrelation[..., 1:] + autocorrelation[..., :-1]) / 2 * np.diff(t)
    integral = np.zeros_like(autocorrelation)
    integral[..., 1:] = np.cumsum(trapezia, axis=-1)
    made_up.measured("green_kubo", ["time"], integral / 2, 0.002 + 0.01 * np.sqrt(t))
    slope = -rate * square_speed[..., 0]
    made_up.measured("vacf_initial_slope", [], slope, 0.5)
    made_up.known("vacf_initial_slope_expected", [], slope)
    made_up.known("enskog_diffusion", [], 0.21)
    made_up.known("accessible_half_width", [], 2.7)


def _energies(made_up):
    """A hot tracer that cools down, and a bath that it warms."""
    t = made_up.dataset.time.values
    tracer = 1.6 + 2.4 * np.exp(-3 * t)
    bath = 1.6 + 0.02 * (1 - np.exp(-3 * t))
    energy = np.stack([tracer, bath], axis=-1)
    made_up.measured("species_energy", ["time", "species"], energy, np.array([0.03, 0.002]))


def _passage(made_up):
    """A first passage at a rate of 4, known to 10 %."""
    t = made_up.dataset.time.values
    rates = {"": 4.0, "_low": 4.4, "_high": 3.6}
    for end, rate in rates.items():
        made_up.known(f"first_passage_survival{end}", ["time"], np.exp(-rate * t))
        made_up.known(f"first_passage_median{end}", [], np.log(2) / rate)


def _own(made_up):
    """A curve and a number that a function of the user measured."""
    number = 75 + 5 * np.exp(-3 * made_up.dataset.time.values)
    made_up.measured("left_disks", ["time"], number, 0.1)
    made_up.measured("turned", [], 0.0, 0.2)
    attributes = {"units": "1", "long_name": "as measured", "observable": "my_module:my_function"}
    for name in ("left_disks", "turned"):
        made_up.variables[name] += (attributes,)


def _velocities(made_up):
    v = np.arange(-5.95, 6, 0.1)
    speed = np.arange(0.05, 8, 0.1)
    _density(made_up, "velocity", np.exp(-(v**2) / 2) / np.sqrt(2 * np.pi))
    _density(made_up, "speed", speed * np.exp(-(speed**2) / 2))
    made_up.coordinate("velocity_bin", v)
    made_up.coordinate("speed_bin", speed)


def _density(made_up, name, density):
    """A density of 3,000 tracers and of 400,000 disks of the bath, in bins of width 0.1; nothing is
    in the tails.
    """
    counts = density * np.array([[3e3], [4e5]]) * 0.1
    mean = np.where(counts > 0.5, density, 0.0)
    error = mean / np.sqrt(np.maximum(counts, 0.5))
    made_up.measured(f"{name}_density", ["species", f"{name}_bin"], mean, error)


def _pairs(made_up):
    """Pair distributions with shells of neighbours, but that of the single tracer with itself."""
    r = np.arange(0.0025, 1.5, 0.005)
    x = r / np.array(CONTACT)[:, None]
    is_apart = x >= 1
    shells = 1 + 0.35 * np.exp(-2.5 * (x - 1)) * np.cos(6 * (x - 1))
    g = np.where(is_apart, shells, 0.0)
    g[0] = np.nan
    noise = np.where(is_apart, 0.03 / np.sqrt(x), 0.0) * np.array([[1], [1], [0.2]])
    contact = np.array([np.nan, 1.36, 1.34])
    made_up.measured("pair_distribution", ["species_pair", "distance"], g, noise)
    made_up.measured("contact_value", ["species_pair"], contact, 0.02)
    made_up.measured("contact_value_rate", ["species_pair"], contact, 0.006)
    made_up.known("contact_distance", ["species_pair"], CONTACT)
    made_up.coordinate("distance", r)


def _walls(made_up):
    """Densities that oscillate near a wall."""
    z = np.arange(0.005, 1.0, 0.01)
    density = np.array([0.03, 4.0])
    layers = 1 + 0.8 * np.exp(-5 * z) * np.cos(12 * z)
    profile = density[:, None] * layers
    made_up.measured("density_profile", ["species", "wall_distance"], profile, 0.02)
    made_up.measured("contact_density", ["species"], 1.8 * density, 0.02)
    made_up.coordinate("wall_distance", z)


def _thermodynamics(made_up):
    phi = made_up.dataset.packing_fraction.values
    z = theory.compressibility(phi, theory.contact_value(phi))
    rate = 40 * phi
    made_up.measured("compressibility", [], z, 0.002 * z)
    made_up.measured("compressibility_rate", [], z, 0.001 * z)
    made_up.known("enskog_compressibility", [], z)
    made_up.measured("collision_rate", [], rate, 0.004 * rate)
    made_up.measured("collision_rate_at_temperature", [], 1.01 * rate, 0.001 * rate)
    made_up.measured("tracer_collision_rate", [], 3 * rate, 0.01 * rate)
    made_up.known("enskog_collision_rate", [], rate)
    made_up.known("enskog_tracer_collision_rate", [], 2.9 * rate)
    made_up.measured("orientational_order", [], 0.1, 0.01)
    made_up.measured("kinetic_temperature", [], 1.6, 0.001)
    made_up.measured("wall_pressure", [], rate, 0.1)
