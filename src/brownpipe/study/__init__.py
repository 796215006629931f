"""Studies: many runs of many scenes, their workload, and the number of runs and the engine that a tolerance needs.

`study_file` reads a study; `check` describes it; `run_count` turns its tolerance into a number of runs; `plan` chooses
an engine.
"""

from brownpipe.study.study import Study, forecast_of_runs
from brownpipe.study.study_file import from_command_line, read_study

__all__ = ["Study", "forecast_of_runs", "from_command_line", "read_study"]
