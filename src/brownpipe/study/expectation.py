"""What a study expects of its trajectory files: which there are, and the runs that each of them holds."""

from collections.abc import Mapping
from pathlib import Path

from brownpipe.storage import Expected
from brownpipe.study.run_count import PLAN, settle
from brownpipe.study.study import Study
from brownpipe.study.study_file import from_command_line, read_study


def read_settled(
    study_file: str | Path, overrides: Mapping[str, object] | None = None, plan: str | Path | None = None
) -> Study:
    """Return a study with its number of runs; `overrides` replaces keys, as `snakemake --config` does.

    For a tolerance the number is that which the workflow has determined and stored in the file `plan`, by default that
    of the study in the folder `results`. Raises RequestError like `read_study`.
    """
    study = read_study(study_file, from_command_line(overrides or {}))
    return settle(study, plan or f"results/{study.name}/{PLAN}", lambda _: None, dry_run=True)


def expected_files(study: Study) -> list[Expected]:
    """Return the trajectory files of a study, relative to the working directory, each with the runs it is to hold."""
    return [Expected(f"results/{study.name}/simulate/{job.file}", study.request_of(job)) for job in study.jobs()]
