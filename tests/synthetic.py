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


def with_measures(dataset):
    """The dataset with all variables of observables and thermodynamics added."""
    rng = np.random.default_rng(1)
    added = (
        _over_time(dataset, rng)
        | _distributions(dataset, rng)
        | _thermodynamics(dataset, rng)
        | _own(dataset, rng)
    )
    return dataset.assign(added).assign_coords(species=list(SPECIES), species_pair=list(PAIRS))


def at_times(dataset, times):
    """The dataset with the same distribution of displacements at several times."""
    names = [name for name in dataset.variables if "displacement_time" in dataset[name].dims]
    each = [
        dataset[names].isel(displacement_time=[0]).assign_coords(displacement_time=[time])
        for time in times
    ]
    return dataset.drop_vars(names).merge(xarray.concat(each, "displacement_time"))


def _estimate(name, dims, mean, error, rng):
    """A mean that is off by its standard error, and the interval that covers it."""
    mean = mean + rng.standard_normal(np.shape(mean)) * error
    error = np.broadcast_to(error, np.shape(mean))
    parts = {
        "": mean,
        "_standard_error": error,
        "_low": mean - 1.96 * error,
        "_high": mean + 1.96 * error,
    }
    return {f"{name}{part}": (dims, values) for part, values in parts.items()}


def _spread(dataset, shape, values):
    """The same values for every scene, particle count and engine."""
    return np.broadcast_to(values, [*(dataset.sizes[dim] for dim in CASE_DIMS), *shape]).copy()


def _over_time(dataset, rng):
    t = dataset.time.values
    rate = 8.0
    decay = np.exp(-rate * t)
    late = 0.004 / np.maximum(t, 0.02) * (1 - np.exp(-10 * t))
    speed2 = dataset.initial_square_speed.values[..., None]
    vacf = speed2 * (0.97 * decay + late)
    integral = np.concatenate(
        [
            np.zeros_like(vacf[..., :1]),
            np.cumsum((vacf[..., 1:] + vacf[..., :-1]) / 2 * np.diff(t), -1),
        ],
        -1,
    )
    bath = 8 * np.exp(-3 * t)
    running = np.gradient(dataset.msd.values, t, axis=-1) / 4
    hot = np.stack([1.6 + 2.4 * np.exp(-3 * t), 1.6 + 0.02 * (1 - np.exp(-3 * t))], axis=-1)
    time = (*CASE_DIMS, "time")
    each = _spread(dataset, (), 1.0)
    return {
        **_estimate(
            "msd_over_4t", time, dataset.msd_over_4t.values, 0.02 * dataset.msd_over_4t.values, rng
        ),
        **_estimate("diffusion_running", time, running, 0.006, rng),
        **_estimate("velocity_autocorrelation", time, vacf, 0.012 * speed2, rng),
        **_estimate(
            "bath_velocity_autocorrelation", time, _spread(dataset, (len(t),), bath), 0.002, rng
        ),
        **_estimate("green_kubo", time, integral / 2, 0.002 + 0.01 * np.sqrt(t), rng),
        **_estimate("vacf_initial_slope", CASE_DIMS, -rate * speed2[..., 0], 0.5, rng),
        "vacf_initial_slope_expected": (CASE_DIMS, -rate * speed2[..., 0]),
        **_estimate(
            "species_energy",
            (*time, "species"),
            _spread(dataset, hot.shape, hot),
            np.array([0.03, 0.002]),
            rng,
        ),
        **_passage(dataset),
        "enskog_diffusion": (CASE_DIMS, 0.21 * each),
        "accessible_half_width": (CASE_DIMS, 2.7 * each),
    }


def _passage(dataset):
    """A first passage at a rate of 4, known to 10 %."""
    time = (*CASE_DIMS, "time")
    rates = {"": 4.0, "_low": 4.4, "_high": 3.6}
    found = {}
    for part, rate in rates.items():
        inside = np.exp(-rate * dataset.time.values)
        found[f"first_passage_survival{part}"] = time, _spread(dataset, inside.shape, inside)
        median = np.log(2) / rate
        found[f"first_passage_median{part}"] = CASE_DIMS, _spread(dataset, (), median)
    return found


def _own(dataset, rng):
    """A curve and a number that a function of the user measured."""
    time = (*CASE_DIMS, "time")
    left = 75 + 5 * np.exp(-3 * dataset.time.values)
    found = _estimate("left_disks", time, _spread(dataset, left.shape, left), 0.1, rng)
    found |= _estimate("turned", CASE_DIMS, _spread(dataset, (), 0.0), 0.2, rng)
    described = {"units": "1", "long_name": "as measured", "observable": "my_module:my_function"}
    return {
        name: (*one, described if name in ("left_disks", "turned") else {})
        for name, one in found.items()
    }


def _distributions(dataset, rng):
    v = np.arange(-5.95, 6, 0.1)
    u = np.arange(0.05, 8, 0.1)
    r = np.arange(0.0025, 1.5, 0.005)
    z = np.arange(0.005, 1.0, 0.01)
    species = (*CASE_DIMS, "species")
    profile = np.array([[0.03], [4.0]]) * (1 + 0.8 * np.exp(-5 * z) * np.cos(12 * z))
    normal = np.exp(-(v**2) / 2) / np.sqrt(2 * np.pi)
    maxwell = u * np.exp(-(u**2) / 2)
    x = r / np.array(CONTACT)[:, None]
    g = np.where(x >= 1, 1 + 0.35 * np.exp(-2.5 * (x - 1)) * np.cos(6 * (x - 1)), 0.0)
    g[0] = np.nan
    pair = (*CASE_DIMS, "species_pair")
    contact = np.array([np.nan, 1.36, 1.34])
    noise = np.where(x >= 1, 0.03 / np.sqrt(x), 0.0) * np.array([[1], [1], [0.2]])
    return {
        **_density("velocity", dataset, normal, rng),
        **_density("speed", dataset, maxwell, rng),
        **_estimate(
            "pair_distribution", (*pair, "distance"), _spread(dataset, g.shape, g), noise, rng
        ),
        **_estimate("contact_value", pair, _spread(dataset, (3,), contact), 0.02, rng),
        **_estimate("contact_value_rate", pair, _spread(dataset, (3,), contact), 0.006, rng),
        "contact_distance": (pair, _spread(dataset, (3,), CONTACT)),
        **_estimate(
            "density_profile",
            (*species, "wall_distance"),
            _spread(dataset, profile.shape, profile),
            0.02,
            rng,
        ),
        **_estimate(
            "contact_density",
            species,
            _spread(dataset, (2,), 1.8 * np.array([0.03, 4.0])),
            0.02,
            rng,
        ),
        "wall_distance": ("wall_distance", z),
        "velocity_bin": ("velocity_bin", v),
        "speed_bin": ("speed_bin", u),
        "distance": ("distance", r),
    }


def _density(dim, dataset, density, rng):
    """A density of 3,000 tracers and of 400,000 disks of the bath, in bins of width 0.1; nothing is
    in the tails.
    """
    counts = density * np.array([[3e3], [4e5]]) * 0.1
    mean = np.where(counts > 0.5, density, 0.0)
    error = mean / np.sqrt(np.maximum(counts, 0.5))
    return _estimate(
        f"{dim}_density",
        (*CASE_DIMS, "species", f"{dim}_bin"),
        _spread(dataset, error.shape, mean),
        error,
        rng,
    )


def _thermodynamics(dataset, rng):
    phi = dataset.packing_fraction.values
    z = theory.compressibility(phi, theory.contact_value(phi))
    rate = 40 * phi
    return {
        **_estimate("compressibility", CASE_DIMS, z, 0.002 * z, rng),
        **_estimate("compressibility_rate", CASE_DIMS, z, 0.001 * z, rng),
        "enskog_compressibility": (CASE_DIMS, z),
        **_estimate("collision_rate", CASE_DIMS, rate, 0.004 * rate, rng),
        **_estimate("collision_rate_at_temperature", CASE_DIMS, 1.01 * rate, 0.001 * rate, rng),
        **_estimate("tracer_collision_rate", CASE_DIMS, 3 * rate, 0.01 * rate, rng),
        "enskog_collision_rate": (CASE_DIMS, rate),
        "enskog_tracer_collision_rate": (CASE_DIMS, 2.9 * rate),
        **_estimate("orientational_order", CASE_DIMS, 0.1 + 0 * phi, 0.01, rng),
        **_estimate("kinetic_temperature", CASE_DIMS, 1.6 + 0 * phi, 0.001, rng),
        **_estimate("wall_pressure", CASE_DIMS, 40 * phi, 0.1, rng),
    }
