"""The dataset's table of contents: every variable with its dimensions, unit and meaning, in one place.

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
    dtype: type = float
    absent: float = np.nan
    extra: dict | None = None

    @property
    def attributes(self):
        return {"units": self.units, "long_name": self.long_name, **(self.extra or {})}


def _estimate(name, dims, units, meaning):
    """A mean over runs and the three variables of its uncertainty."""
    return {
        name: Variable(dims, units, meaning, extra={"ancillary_variables": f"{name}_standard_error"}),
        f"{name}_standard_error": Variable(dims, units, f"standard error of the {meaning}"),
        f"{name}_low": Variable(dims, units, f"lower end of the 95 % interval of the {meaning}"),
        f"{name}_high": Variable(dims, units, f"upper end of the 95 % interval of the {meaning}"),
    }


def _count(name, meaning):
    """A number of events per run, averaged over runs, and its standard error."""
    return {
        name: Variable(EACH, "1", f"mean number of {meaning} in a run"),
        f"{name}_standard_error": Variable(EACH, "1", f"standard error of the mean number of {meaning} in a run"),
    }


TIME, WINDOW, RING, MODEL, SEED = (*EACH, "time"), (*EACH, "window"), (*EACH, "r"), (*EACH, "model"), (*EACH, "seed")
STATUS = {"flag_values": np.array([KEPT, FAILED, MISSING], np.int8), "flag_meanings": "kept failed missing"}

VARIABLES = {
    "runs": Variable(EACH, "1", "number of runs averaged", np.int64, 0),
    "failed_runs": Variable(
        EACH, "1", "number of runs left out because overlap or energy drift passed its bound", np.int64, 0
    ),
    "missing_seeds": Variable(
        EACH, "1", "number of seeds that others of the dataset have and this one lacks", np.int64, 0
    ),
    "box_width": Variable(EACH, "length", "width of the box"),
    "box_height": Variable(EACH, "length", "height of the box"),
    "duration": Variable(EACH, "time", "duration of a run"),
    "packing_fraction": Variable(EACH, "1", "share of the box covered by disks"),
    "initial_square_speed": Variable(EACH, SPEED2, "expected <v0^2> of the tracer: the MSD begins as <v0^2> t^2"),
    **_estimate("msd", TIME, AREA, "mean squared displacement of the tracer"),
    "msd_over_4t": Variable(TIME, RATE, "mean squared displacement over 4 t"),
    **_estimate("slope", WINDOW, RATE, "least-squares slope of the mean squared displacement over the window"),
    "intercept": Variable(WINDOW, AREA, "intercept of the least-squares line over the window"),
    "intercept_standard_error": Variable(WINDOW, AREA, "standard error of the intercept"),
    "naive_slope_error": Variable(WINDOW, RATE, "what least squares alone claims as error of the slope; far too small"),
    **_estimate("diffusion_coefficient", WINDOW, RATE, "diffusion coefficient, slope/4, over the window"),
    "displacement_counts": Variable(RING, "1", "number of runs that end in the ring"),
    "displacement_counts_low": Variable(RING, "1", "lower end of the 95 % (Wilson) interval of the count"),
    "displacement_counts_high": Variable(RING, "1", "upper end of the 95 % (Wilson) interval of the count"),
    "displacement_overflow": Variable(EACH, "1", "number of runs that end beyond the outermost ring"),
    "model_diffusion_coefficient": Variable(MODEL, RATE, "diffusion coefficient put into eq. (18) of the 2020 note"),
    "expected_counts": Variable((*MODEL, "r"), "1", "number of runs expected in the ring, eq. (18) integrated"),
    "expected_overflow": Variable(MODEL, "1", "number of runs expected beyond the outermost ring"),
    "chi_square": Variable(MODEL, "1", "chi-square of the counts, overflow included, sparse rings pooled"),
    "degrees_of_freedom": Variable(MODEL, "1", "pooled bins less one for the total and one for the fitted D"),
    "p_value": Variable(MODEL, "1", "chance of a larger chi-square if the model is right"),
    **_count("pair_collisions", "collisions between disks"),
    **_count("wall_collisions", "collisions with walls"),
    **_count("tracer_collisions", "collisions of the tracer with other disks"),
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
    "window": {"long_name": "window of time of the straight-line fit"},
    "window_start": {"units": "time", "long_name": "start of the window"},
    "window_end": {"units": "time", "long_name": "end of the window"},
    "r": {"units": "length", "long_name": "middle of the ring"},
    "r_inner": {"units": "length", "long_name": "inner radius of the ring"},
    "r_outer": {"units": "length", "long_name": "outer radius of the ring"},
    "model": {
        "long_name": "where the D of eq. (18) is taken from: msd = MSD(t)/4t at the end, slope = slope/4 of a window"
    },
    "seed": {"long_name": "seed of the run"},
}
