"""Checkpoint files: the stored state of a batch of runs, kept beside the output file until that is complete."""

import json
from pathlib import Path

import h5py
import numpy as np

from brownpipe.errors import RequestError, WrongFileError
from brownpipe.storage.files import naming, read_sealed, sealed, write_file


def write_checkpoint(path: str | Path, made_by: dict, arrays: dict[str, np.ndarray]) -> None:
    """Replace a checkpoint file by one with these named arrays.

    `made_by` says which command and source made them: a flat mapping of names to texts and numbers.
    Raises StorageError if the file cannot be written; the earlier file is then still intact.
    """
    with h5py.File.in_memory(block_size=2**20) as file:
        file.attrs["checkpoint"] = json.dumps(made_by)
        for name, value in arrays.items():
            file[name] = value
        file.flush()
        write_file(path, sealed(file.id.get_file_image()))


def read_checkpoint(path: str | Path, made_by: dict) -> dict[str, np.ndarray] | None:
    """Return the named arrays of a checkpoint file; None if there is no file.

    Raises StorageError if it is damaged, WrongFileError if it is none, RequestError, which names the first difference,
    if its `made_by` differs.
    """
    if not Path(path).exists():
        return None
    with naming(path, "simulate"), h5py.File.in_memory(read_sealed(path)) as file:
        if "checkpoint" not in file.attrs:
            raise WrongFileError("is a file of brownpipe, but not a checkpoint; choose another --output")
        stored, arrays = json.loads(file.attrs["checkpoint"]), {name: item[()] for name, item in file.items()}
    differing = [name for name in made_by if stored.get(name) != made_by[name]]
    if differing:
        cure = "repeat that command, delete this file to begin anew, or choose another --output"
        raise RequestError(f"{path}: is of a run with {_difference(differing[0], stored, made_by)}; {cure}")
    return arrays


def remove_checkpoint(path: str | Path) -> None:
    """Remove a checkpoint file, and the part of one that a killed process has left."""
    for file in (path, f"{path}.brownpipe.part"):
        Path(file).unlink(missing_ok=True)


def _difference(name: str, stored: dict, made_by: dict) -> str:
    """Return the words for an entry that differs; of digests and long lists the name alone."""
    values = [str(mapping.get(name)) for mapping in (stored, made_by)]
    return f"another {name}" if max(map(len, values)) > 40 else f"{name} {values[0]}, not {values[1]}"
