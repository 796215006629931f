"""Observables whose averages over runs are of interest as they are; `brownpipe.observables` has unit and meaning."""

from brownpipe.analysis.estimator import Averages, Case, Columns
from brownpipe.analysis.variables import EACH, Mean
from brownpipe.engines.ensemble import Ensemble
from brownpipe.observables import ARRAYS

NAMES = (
    *("bath_velocity_autocorrelation", "species_energy", "density_profile"),
    *("orientational_order", "orientational_order_squared"),
)
VARIABLES = {name: Mean((*EACH, *ARRAYS[name].dims), *ARRAYS[name][1:3]) for name in NAMES}


def columns(case: Case, runs: Ensemble) -> Columns:
    """Return these observables."""
    return Columns({name: runs.observables[name] for name in NAMES if name in runs.observables})


def results(case: Case, averages: Averages) -> dict:
    """Return nothing but the averages."""
    return {}
