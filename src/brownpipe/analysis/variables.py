"""Variables of the dataset: dimensions, unit and meaning. Every estimator has a table of its own.

Units are the reduced units of the scene: `length`, `time`, `mass`. "95 %" intervals are bootstrap-t over runs.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

SAME_TIME = 1e-9  # relative difference below which two times are equal: k dt depends on dt by round-off
KEPT, FAILED, MISSING = 0, 1, 2  # status of a run
EACH = ("scene", "particles", "engine")  # the labels of a case
TIME = (*EACH, "time")
FOLLOWED = "of the tracer (where measured over disks, of all disks equal to it)"
AREA, RATE, SPEED2 = "length^2", "length^2/time", "length^2/time^2"

ATTRIBUTES = {
    "Conventions": "CF-1.11",
    "title": "Brownian motion of a hard disk among hard disks: averages over independent runs",
    "comment": (
        "Units are the reduced units of each scene. Averages are over runs that did not fail; standard errors and "
        "intervals come from the spread of runs, never of time points. A diffusion coefficient is meaningful only "
        "with its fit window, particle count and box: in two dimensions it has no limit at long times."
    ),
}


class Variable(NamedTuple):
    """One variable of the dataset; `absent` is its value where a scene, time or seed has none."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    dtype: type = float  # object for text
    absent: float | str = np.nan
    extra: dict | None = None  # further attributes
    always: bool = False  # in every dataset, even if no case has a value

    @property
    def attributes(self) -> dict[str, object]:
        return {"units": self.units, "long_name": self.long_name, **(self.extra or {})}


def error_of(name: str, dims: tuple[str, ...], units: str, meaning: str) -> dict[str, Variable]:
    """Return the variables of a mean over runs and its standard error."""
    return {
        name: Variable(dims, units, meaning, extra={"ancillary_variables": f"{name}_standard_error"}),
        f"{name}_standard_error": Variable(dims, units, f"standard error of the {meaning}"),
    }


def estimate_of(name: str, dims: tuple[str, ...], units: str, meaning: str) -> dict[str, Variable]:
    """Return the variables of a mean over runs, its standard error and the ends of its 95 % interval."""
    return error_of(name, dims, units, meaning) | {
        f"{name}_low": Variable(dims, units, f"lower end of the 95 % interval of the {meaning}"),
        f"{name}_high": Variable(dims, units, f"upper end of the 95 % interval of the {meaning}"),
    }


def kept_always(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the same variables, to be in every dataset."""
    return {name: variable._replace(always=True) for name, variable in variables.items()}


SEED = (*EACH, "seed")
STATUS = {"flag_values": np.array([KEPT, FAILED, MISSING], np.int8), "flag_meanings": "kept failed missing"}

VARIABLES = {  # numbers and health of the runs; every estimator has a table of its own
    "runs": Variable(EACH, "1", "number of runs averaged", np.int64, 0),
    "failed_runs": Variable(
        EACH,
        "1",
        "number of runs left out: energy drift beyond its bound (exact engine: also overlap or momentum residual; time "
        "steps: also a disk that has left the box), a number not finite, or a run that could not go on",
        np.int64,
        0,
    ),
    "missing_seeds": Variable(
        EACH,
        "1",
        "number of seeds, from the first to the last of this engine, without a run",
        np.int64,
        0,
    ),
    "energy_drift": Variable(SEED, "1", "relative change of the energy over the run"),
    "worst_overlap": Variable(SEED, "1", "deepest overlap, in contact distances"),
    "momentum_residual": Variable(SEED, "1", "relative residual of the momentum balance, wall impulses included"),
    "run_status": Variable(SEED, "1", "status of the run", np.int8, MISSING, STATUS),
    "stopped": Variable(SEED, "1", "why the run could not go on; empty for the others", object, ""),
}

COORDINATES = {
    "scene": {"long_name": "scene"},
    "particles": {"units": "1", "long_name": "number of disks, tracer included"},
    "engine": {"long_name": "engine and its settings"},
    "time": {"units": "time", "long_name": "time since the start"},
    "seed": {"long_name": "seed of the run"},
}
