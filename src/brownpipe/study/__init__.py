"""Studies: many runs of many scenes, what they will cost, and how many runs an error needs."""

from brownpipe.study.study import Job, Study, Use
from brownpipe.study.study_file import read_study, refuse_repetition

__all__ = ["Job", "Study", "Use", "read_study", "refuse_repetition"]
