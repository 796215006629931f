"""Variables of a trade-off dataset: dimensions, unit and meaning.

Biases, spreads and distances are relative to the exact result: 0.01 is 1 %. "95 %" intervals are those of `bias`.
"""

import numpy as np

from brownpipe.analysis.variables import INTERVAL, Mean, Variable, with_uncertainties

ATTRIBUTES = {
    "Conventions": "CF-1.11",
    "title": "Cost-accuracy trade-off of engines",
    "comment": (
        "CPU times, and therefore the Pareto front, are measured anew whenever this dataset is made; they differ "
        "between machines and from one measurement to the next. All other variables are reproducible to the bit. "
        "Biases are relative to exact runs of the same scene; where an interval contains 0, the bias is not resolved."
    ),
}
SCENE, SETTING = ("scene",), ("scene", "setting")
ENDS = INTERVAL[1:]  # low and high, without a standard error
BEST = "no setting has a smaller total error of the MSD"
MSD, D = "MSD at the end", "D in the window"
DISTRIBUTION = "total variation distance of the distribution of displacements at the end, in ten rings"

COORDINATES = {
    "scene": Variable(SCENE, None, "scene and number of disks, NAME_N150, whose exact runs are the reference"),
    "setting": Variable(("setting",), None, "engine and settings; `exact in X`: exact runs of X in place of the scene"),
}
_TABLE = {
    "particles": Variable(SCENE, "1", "number of disks", (), np.int64, 0),
    "duration": Variable(SCENE, "time", "duration of a run"),
    "window_start": Variable(SCENE, "time", "start of the window of time in which D is fitted"),
    "window_end": Variable(SCENE, "time", "end of the window of time in which D is fitted"),
    "runs": Variable(SETTING, "1", "number of runs that did not fail", (), np.int64, 0),
    "failed_runs": Variable(SETTING, "1", "number of runs that failed and were left out", (), np.int64, 0),
    "paired_runs": Variable(SETTING, "1", "number of runs that start like an exact run", (), np.int64, 0),
    "seconds": Variable(SETTING, "s", "CPU time of a run on this machine, start-up and files not counted"),
    "cost_ratio": Variable(SETTING, "1", "CPU time of a run over that of an exact run, median of pairs taken in turn"),
    "cost_ratio_low": Variable(SETTING, "1", "smallest of these ratios"),
    "cost_ratio_high": Variable(SETTING, "1", "largest of these ratios"),
    "pays_from": Variable(SETTING, "s", f"CPU time from which on {BEST}, unresolved biases at their 95 % upper bounds"),
    "pays_to": Variable(SETTING, "s", f"CPU time up to which {BEST}, unresolved biases at their 95 % upper bounds"),
    "may_pay_from": Variable(SETTING, "s", f"CPU time from which on {BEST}, estimated biases and lowest cost ratio"),
    "may_pay_to": Variable(SETTING, "s", f"CPU time up to which {BEST}, estimated biases and lowest cost ratio"),
    "msd_bias": Mean(SETTING, "1", f"relative bias of the {MSD}"),
    "msd_spread": Variable(SETTING, "1", f"relative standard deviation of the {MSD} in one run"),
    "d_bias": Mean(SETTING, "1", f"relative bias of {D}"),
    "d_spread": Variable(SETTING, "1", f"relative standard deviation of {D} in one run"),
    "displacement_bias": Variable(SETTING, "1", f"{DISTRIBUTION}, noise subtracted", ENDS),
    "displacement_bias_noise": Variable(SETTING, "1", f"mean of the {DISTRIBUTION}, due to noise alone"),
    "displacement_spread": Variable(SETTING, "1", "mean distance due to noise in the distribution of one run"),
    "contact_bias": Mean(SETTING, "1", "most significant relative deviation of g(r) near contact"),
    "worst_overlap": Variable(SETTING, "1", "deepest overlap in a run, in contact distances"),
    "departure_time": Variable(SETTING, "time", "median time until the tracer is 0.001 R off its exact path; or inf"),
}
VARIABLES = with_uncertainties(_TABLE)
