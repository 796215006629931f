"""Finished batches of an interrupted study, which the workflow takes for incomplete: recognised by what is in them.

Snakemake deletes the outputs of a job before it runs the job again, also where a process went on after Snakemake was
killed and wrote its file to the end. So each file of a job that is about to run is set aside, and `brownpipe simulate`
takes it back if it holds exactly the runs that it would make, by this source and these packages.
"""

import os
from pathlib import Path

from brownpipe.engines.request import Request
from brownpipe.engines.state import Ensemble
from brownpipe.errors import StorageError
from brownpipe.provenance import modules_of, source_digest, versions
from brownpipe.storage.expected import difference
from brownpipe.storage.files import sync
from brownpipe.storage.layout import FORMAT
from brownpipe.storage.trajectories import read_header, read_trajectories

SUFFIX = ".kept"


def set_aside(path: str | Path) -> None:
    """Give a trajectory file another name, under which `take_back` finds it; without the file do nothing."""
    if os.path.isfile(path):
        os.replace(path, f"{path}{SUFFIX}")


def take_back(path: str | Path, request: Request) -> Ensemble | None:
    """Give a file that was set aside its name again and return its runs; remove it if it is not as requested.

    Its seal and digest are verified. Return None if there is no such file.
    """
    kept = f"{path}{SUFFIX}"
    if not os.path.isfile(kept):
        return None
    ensemble = _runs(kept, request)
    if ensemble is None:
        os.unlink(kept)
        return None
    os.utime(kept)  # newer than what was made before: the steps that follow are due
    os.replace(kept, path)
    sync(Path(path).parent)
    return ensemble


def _runs(path: str, request: Request) -> Ensemble | None:
    """Return the runs of a file if it is what `brownpipe simulate` would write now, otherwise None."""
    try:
        header, contents = read_header(path), read_trajectories(path)
    except StorageError:
        return None
    source = source_digest(*modules_of("simulate", request.engine.name))
    made_now = versions() | {"format": FORMAT, "source_digest": source}
    is_same = all(header.get(name) == value for name, value in made_now.items())
    return contents.ensemble if is_same and difference(contents.outline, request) is None else None
