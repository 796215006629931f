"""Studies: many runs of many scenes, their workload, and the number of runs and the engine that a
tolerance needs.

`check` describes a study; `plan` turns a tolerance into a number of runs, and chooses an engine;
`budget` turns a CPU time into runs and their errors.
"""

from brownpipe.study.study import Study, forecast_of_runs, read_study

__all__ = ["Study", "forecast_of_runs", "read_study"]
