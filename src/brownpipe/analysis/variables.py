"""What a variable of the dataset is: dimensions, unit and meaning. Every measure has a table of its own.

Units are those of the scene: `length`, `time` and `mass` stand for its own. "95 %" intervals are bootstrap-t over runs.
"""

from typing import NamedTuple

import numpy as np

KEPT, FAILED, MISSING = 0, 1, 2  # what became of a run
EACH = ("scene", "particles", "engine")
AREA, RATE, SPEED2 = "length^2", "length^2/time", "length^2/time^2"

ATTRIBUTES = {
    "Conventions": "CF-1.11",
    "title": "Brownian motion of a hard disk among hard disks: measures over independent runs",
    "comment": (
        "Units are the reduced units of each scene. Averages are over runs that did not fail; standard errors and "
        "intervals come from resampling runs, never time points. A diffusion coefficient belongs to its window of "
        "time, its particle count and its box: in the plane it has no limit."
    ),
}


class Variable(NamedTuple):
    """One variable of the dataset; `absent` stands where a scene, time or seed has no value."""

    dims: tuple
    units: str
    long_name: str
    dtype: type = float  # object for text
    absent: float | str = np.nan
    extra: dict | None = None
    always: bool = False  # in every dataset, if only as absent

    @property
    def attributes(self):
        return {"units": self.units, "long_name": self.long_name, **(self.extra or {})}


def error_of(name, dims, units, meaning):
    """A mean over runs and its standard error."""
    return {
        name: Variable(dims, units, meaning, extra={"ancillary_variables": f"{name}_standard_error"}),
        f"{name}_standard_error": Variable(dims, units, f"standard error of the {meaning}"),
    }


def estimate_of(name, dims, units, meaning):
    """A mean over runs and the three variables of its uncertainty."""
    return error_of(name, dims, units, meaning) | {
        f"{name}_low": Variable(dims, units, f"lower end of the 95 % interval of the {meaning}"),
        f"{name}_high": Variable(dims, units, f"upper end of the 95 % interval of the {meaning}"),
    }


def kept_always(variables):
    """The same variables, in the dataset whether any group has them or not."""
    return {name: variable._replace(always=True) for name, variable in variables.items()}


SEED = (*EACH, "seed")
STATUS = {"flag_values": np.array([KEPT, FAILED, MISSING], np.int8), "flag_meanings": "kept failed missing"}

VARIABLES = {  # what is known of the runs themselves; every measure has its own
    "runs": Variable(EACH, "1", "number of runs averaged", np.int64, 0),
    "failed_runs": Variable(
        EACH, "1", "number of runs left out because overlap or energy drift passed its bound", np.int64, 0
    ),
    "missing_seeds": Variable(
        EACH, "1", "number of seeds that others of the dataset have and this one lacks", np.int64, 0
    ),
    "energy_drift": Variable(SEED, "1", "relative change of the energy over the run"),
    "worst_overlap": Variable(SEED, "1", "deepest overlap seen, in contact distances"),
    "momentum_residual": Variable(SEED, "1", "relative residual of momentum and the impulses given to the walls"),
    "run_status": Variable(SEED, "1", "what became of the run", np.int8, MISSING, STATUS),
}

COORDINATES = {
    "scene": {"long_name": "scene"},
    "particles": {"units": "1", "long_name": "number of disks, tracer included"},
    "engine": {"long_name": "engine and its settings"},
    "time": {"units": "time", "long_name": "time since the start"},
    "seed": {"long_name": "seed of the run"},
}
