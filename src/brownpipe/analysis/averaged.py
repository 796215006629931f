"""Observables whose averages over runs are of interest as they are; `brownpipe.observables` has unit and meaning."""

import numpy as np

from brownpipe.analysis.estimator import Averages, Case, Columns
from brownpipe.analysis.variables import EACH, Mean, Variable
from brownpipe.engines.ensemble import Ensemble
from brownpipe.observables import ARRAYS, AXES
from brownpipe.observables.own import Own

NAMES = (
    *("bath_velocity_autocorrelation", "species_energy", "density_profile"),
    *("orientational_order", "orientational_order_squared"),
)
VARIABLES = {name: Mean((*EACH, *ARRAYS[name].dims), *ARRAYS[name][1:3]) for name in NAMES}


def variables_of(own: Own) -> dict[str, Variable]:
    """Return the variables of arrays that a user's own functions measured."""
    return {
        name: Mean((*EACH, *array.dims), array.units, array.long_name, extra={"observable": array.observable})
        for name, array in own.items()
    }


def columns(case: Case, runs: Ensemble) -> Columns:
    """Return these observables, and the user's own."""
    return Columns({name: runs.observables[name] for name in (*NAMES, *case.own) if name in runs.observables})


def results(case: Case, averages: Averages) -> dict:
    """Return the averages of the user's own arrays, and numbers along their own dimensions."""
    own = {name: array for name, array in case.own.items() if name in averages}
    sizes = {dim: size for array in own.values() for dim, size in zip(array.dims, array.shape, strict=True)}
    counted = {dim: np.arange(size) for dim, size in sizes.items() if dim not in AXES}
    return {name: averages.estimate(name) for name in own} | counted
