"""Variables of the dataset: dimensions, unit and meaning. Every estimator has a table of its own.

Units are the reduced units of the scene: `length`, `time`, `mass`. "95 %" intervals are bootstrap-t
over runs.
"""

from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis.resampling import Estimate
from brownpipe.observables import ARRAYS

if TYPE_CHECKING:
    from xarray import Dataset

# relative difference below which two times are equal: k dt depends on dt by round-off
SAME_TIME = 1e-9
KEPT, FAILED, MISSING = 0, 1, 2  # status of a run
CASE_DIMS = ("scene", "particles", "engine")  # the dimensions of cases
TIME = (*CASE_DIMS, "time")
SEED = (*CASE_DIMS, "seed")
FOLLOWED = "of the tracer (where measured over disks, of all disks equal to it)"
AREA = "length^2"
RATE = "length^2/time"
SPEED2 = "length^2/time^2"

ATTRIBUTES = {
    "Conventions": "CF-1.11",
    "title": "Brownian motion of a hard disk among hard disks: averages over independent runs",
    "comment": (
        "Units are the reduced units of each scene. Averages, standard errors and intervals are "
        "over runs that did not fail, never over time points. A diffusion coefficient has meaning "
        "only with its fit window, N and box."
    ),
}


# Ends of the names of the uncertainties of a mean over runs, and their meaning.
UNCERTAINTIES = {
    "standard_error": "standard error of the {}",
    "low": "lower end of the 95 % interval of the {}",
    "high": "upper end of the 95 % interval of the {}",
}
ERROR = ("standard_error",)
ENDS = ("low", "high")
INTERVAL = tuple(UNCERTAINTIES)


class Variable(NamedTuple):
    """One variable or coordinate of the dataset.

    dims: names of its dimensions: of a variable scene, particles and engine, and perhaps others.
    units: in length, time and mass, "1" without unit, None for text.
    long_name: what it means, as labels and tables say it.
    uncertainties: of a mean over runs ("standard_error",), or ("standard_error", "low", "high") for
    its 95 % interval, too: each is a variable of its own beside it.
    dtype: of its values, object for text.
    absent: its value where a scene, time or seed has none.
    extra: further attributes, by name.

    >>> import brownpipe as bp
    >>> dims = ("scene", "particles", "engine", "time")
    >>> speed = bp.Variable(dims, "length/time", "mean speed of the tracer", ("standard_error",))
    >>> speed.attributes
    {'units': 'length/time', 'long_name': 'mean speed of the tracer'}
    """

    dims: tuple[str, ...]
    units: str | None  # None: text
    long_name: str
    # Of a mean over runs ERROR or INTERVAL: variables of their own.
    uncertainties: tuple[str, ...] = ()
    dtype: type | np.dtype = float  # object for text
    absent: float | str = np.nan
    extra: Mapping[str, object] = MappingProxyType({})  # further attributes

    @property
    def attributes(self) -> dict[str, object]:
        units = {} if self.units is None else {"units": self.units}
        return {**units, "long_name": self.long_name, **self.extra}


Mean = partial(Variable, uncertainties=INTERVAL)  # of a quantity over runs, with its interval


def with_uncertainties(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the table of variables with their uncertainties: `x`, `x_standard_error`, `x_low`,
    `x_high`.
    """
    table = {}
    for name, variable in variables.items():
        extra = dict(variable.extra)
        if variable.uncertainties:
            extra["ancillary_variables"] = f"{name}_{variable.uncertainties[0]}"
        table[name] = variable._replace(extra=extra)
        for ending in variable.uncertainties:
            meaning = UNCERTAINTIES[ending].format(variable.long_name)
            table[f"{name}_{ending}"] = Variable(variable.dims, variable.units, meaning)
    return table


def names_of(name: str) -> list[str]:
    """Return the names of the variables of an Estimate, in its order.

    >>> names_of("msd")
    ['msd', 'msd_standard_error', 'msd_low', 'msd_high']
    """
    return [name, *(f"{name}_{ending}" for ending in UNCERTAINTIES)]


def with_intervals(values: Mapping[str, ArrayLike | Estimate]) -> dict[str, ArrayLike]:
    """Return values by the names of their variables: those of an Estimate x, for example, as `x`,
    `x_low`, `x_high`.
    """
    arrays: dict[str, ArrayLike] = {}
    for name, value in values.items():
        if isinstance(value, Estimate):
            arrays |= zip(names_of(name), value, strict=True)
        else:
            arrays[name] = value
    return arrays


STATUS = {
    "flag_values": np.array([KEPT, FAILED, MISSING], np.int8),
    "flag_meanings": "kept failed missing",
}

AVERAGED = [name for name, array in ARRAYS.items() if array.averaged]
VARIABLES = {
    name: Mean((*CASE_DIMS, *array.dims), array.units, array.long_name)
    for name, array in ARRAYS.items()
    if array.averaged
}
# Numbers and health of the runs.
VARIABLES |= {
    "runs": Variable(CASE_DIMS, "1", "number of runs averaged", (), np.int64, 0),
    "failed_runs": Variable(
        CASE_DIMS, "1", "number of runs left out: not healthy, or unable to go on", (), np.int64, 0
    ),
    "energy_drift": Variable(SEED, "1", "relative change of the energy over the run"),
    "worst_overlap": Variable(SEED, "1", "deepest overlap, in contact distances"),
    "momentum_residual": Variable(
        SEED, "1", "relative residual of the momentum balance, wall impulses included"
    ),
    "run_status": Variable(SEED, "1", "status of the run", (), np.int8, MISSING, STATUS),
    "stopped": Variable(
        SEED, "1", "why the run could not go on; empty for the others", (), object, ""
    ),
}

COORDINATES = {
    "scene": Variable(("scene",), None, "scene"),
    "particles": Variable(("particles",), "1", "number of disks, tracer included"),
    "engine": Variable(("engine",), None, "engine and its settings"),
    "seed": Variable(("seed",), None, "seed of the run"),
}

# attribute of a dataset: the names of its coordinates for keys of the scenes that were varied
VARIED = "varied"


def labels_of_cases(dataset: "Dataset") -> list[str]:
    """Return the coordinates that tell the cases of a dataset apart: scene, varied keys, count,
    engine.
    """
    return [CASE_DIMS[0], *str(dataset.attrs.get(VARIED, "")).split(), *CASE_DIMS[1:]]


def average_of(dataset: "Dataset") -> str:
    """Return what displacements and autocorrelations of a dataset are averaged over, of
    `observables.average.AVERAGES`.
    """
    return str(dataset.attrs.get("average", "runs"))
