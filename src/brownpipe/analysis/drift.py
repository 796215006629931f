"""Drifts within the runs of a scene that claims to be in equilibrium from t = 0. See
docs/theory.md, section 5.

In each run a quantity in the last quarter is compared with the same in the first. In equilibrium
their difference is as likely as its negative, because the motion of hard disks is reversible: over
n runs the mean over its standard error is Student's t with n - 1 degrees of freedom. The quantities
of all cases of a dataset are one family of tests (Holm).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.goodness import change_found_with_power
from brownpipe.analysis.thermodynamics import compressibility, temperature
from brownpipe.analysis.variables import CASE_DIMS, ERROR, Variable
from brownpipe.engines import Engine
from brownpipe.engines.definition import REFERENCE_NAME
from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.forecast import settling_time
from brownpipe.observables.equilibrium import claims_equilibrium, ends_of_quarters
from brownpipe.scene import Scene
from brownpipe.scene.species import species_table

LEVEL = 0.01  # family-wise error rate
FEWEST_RUNS = 8
TOO_FEW = (
    f"too few runs, samples or collisions to test for drifts: it takes {FEWEST_RUNS} runs of 4 "
    "sample intervals"
)
POWER = 0.9
LONGER = 2.0
# First words of what is counted in the quarters of every run.
COUNTED = ("kinetic_energy", "quarter_")


class Drift(NamedTuple):
    """The last quarter of the runs minus the first, relative to the mean; arrays (Q,), one entry
    per quantity.
    """

    quantity: Sequence[str]
    change: np.ndarray
    error: np.ndarray  # standard error over runs
    p: np.ndarray  # probability of a change at least as large in equilibrium; NaN if unknown


def is_tested(scene: Scene, engine: Engine) -> bool:
    """Return whether runs are tested: those of the exact engine. Others drift towards an
    equilibrium of their own.
    """
    return claims_equilibrium(scene) and engine.name == REFERENCE_NAME


def quarters_of(
    scene: Scene, times: np.ndarray, observables: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return each quantity in the quarters (n, 4) of n runs sampled at `times` (T,); {} if they
    were not counted.
    """
    if "quarter_virial" not in observables:
        return {}
    duration = np.diff(times[ends_of_quarters(times)])
    kt = temperature(scene, observables["kinetic_energy"])[:, None]
    hot = np.where(kt > 0, kt, np.nan)
    quarters = {
        "pressure": compressibility(scene, observables["quarter_virial"], hot, duration),
        "collision rate": observables["quarter_collisions"] / duration,
    }
    if "quarter_energy" in observables:
        for k, name in enumerate(species_table(scene).name):
            quarters[f"kinetic energy of {name}"] = observables["quarter_energy"][:, :, k]
    if "quarter_order" in observables:
        quarters["psi_6"] = observables["quarter_order"]
    return quarters


def drift_of(quarters: Mapping[str, np.ndarray]) -> Drift:
    """Return the drift of quantities in the quarters (n, 4) of n runs, with the p-value of each
    test alone.

    NaN for fewer than FEWEST_RUNS, for a quantity that is 0 and for one without scatter.
    """
    from scipy.special import stdtr

    values = np.stack([*quarters.values()]) if quarters else np.zeros((0, 1, 4))
    runs = values.shape[1]
    means = values.mean(axis=(1, 2))
    changes = values[..., 3] - values[..., 0]
    change = changes.mean(axis=1)
    error = np.full(len(values), np.nan)
    if runs > 1:
        error = changes.std(axis=1, ddof=1) / np.sqrt(runs)
    may_tell = (error > 0) & (means != 0) & (runs >= FEWEST_RUNS)
    t = np.divide(change, error, out=np.full(len(change), np.nan), where=may_tell)
    size = np.where(means != 0, np.abs(means), np.nan)
    p = 2 * stdtr(runs - 1, -np.abs(t))
    return Drift([*quarters], change / size, error / size, p)


def found_with_power(error: np.ndarray, runs: int, tests: int) -> np.ndarray:
    """Return the drifts (Q,) that are found with probability POWER, at the first step of Holm's
    procedure, from their standard errors (Q,) over that number of `runs`.
    """
    return change_found_with_power(error, runs, LEVEL / tests, POWER)


def time_to_try(scene: Scene) -> float:
    """Return a longer equilibrate.time: LONGER times the end of runs that drift, and not below the
    forecast.
    """
    end = scene.equilibrate.time + scene.duration
    longer = np.fmax(LONGER * end, settling_time(scene))
    return float(f"{longer:.1g}")


def drift_in_words(drift: Drift, to_try: float) -> str:
    """Return what drifts within the runs, and the equilibrate.time to try; empty if nothing
    does.
    """
    changes = [
        f"the {name} by {in_percent(change, error)}"
        for name, change, error, p in zip(*drift, strict=True)
        if p < LEVEL
    ]
    if not changes:
        return ""
    listed = ", ".join(changes).replace(" by ", " drifts by ", 1)
    return f"{listed} within the runs: not equilibrated; try equilibrate.time: {to_try:g}"


def in_percent(change: float, error: float) -> str:
    """Return a change with its standard error, rounded to one digit, in the last digit.

    >>> in_percent(-0.0123, 0.0011), in_percent(0.4, 0.12)
    ('-1.2(1) %', '+40(12) %')
    """
    digit, exponent = f"{100 * error:.0e}".split("e")
    decimals = max(0, -int(exponent))
    uncertainty = digit if decimals else f"{100 * error:.0f}"
    return f"{100 * change:+.{decimals}f}({uncertainty}) %"


def drift_columns(case: Case, runs: Ensemble) -> Columns:
    """Return what is counted in the quarters of every run."""
    if not is_tested(case.scene, case.engine):
        return Columns()
    counted = {}
    for name, values in runs.observables.items():
        if name.startswith(COUNTED) and name not in case.own:
            counted[name] = values
    return Columns(run_values=counted)


def drift_results(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return the drifts, and the time to try."""
    if not is_tested(case.scene, case.engine):
        return {}
    values: dict[str, ArrayLike] = {"time_to_try": time_to_try(case.scene)}
    quarters = quarters_of(case.scene, case.times, averages.run_values)
    if quarters:
        drift = drift_of(quarters)
        values |= {
            "quantity": drift.quantity,
            "drift": drift.change,
            "drift_standard_error": drift.error,
            "drift_p_value": drift.p,
        }
    return values


QUANTITY = (*CASE_DIMS, "quantity")
VARIABLES = {
    "time_to_try": Variable(CASE_DIMS, "time", "equilibrate.time to try if the runs drift"),
    "drift": Variable(
        QUANTITY, "1", "relative change from the first to the last quarter of the runs", ERROR
    ),
    "drift_p_value": Variable(
        QUANTITY, "1", "p-value of the change in equilibrium, adjusted for the dataset (Holm)"
    ),
}
COORDINATES = {"quantity": Variable(("quantity",), None, "quantity that may drift")}

ESTIMATOR = Estimator(
    name="drift",
    variables=VARIABLES,
    columns=drift_columns,
    results=drift_results,
    coordinates=COORDINATES,
)
