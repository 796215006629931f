"""Checkpoint files: the stored state of a batch of runs, kept beside the output file until that is complete."""

import json
from pathlib import Path

import numpy as np

from brownpipe.errors import RequestError, StorageError
from brownpipe.storage.files import read_sealed, sealed, write_file
from brownpipe.storage.hdf5 import Node, from_bytes, to_bytes


def write_checkpoint(path: str | Path, made_by: dict, arrays: dict[str, np.ndarray]) -> None:
    """Replace a checkpoint file by one with these named arrays.

    `made_by` says which command and source made them: a flat mapping of names to texts and numbers.
    Raises StorageError if the file cannot be written; the earlier file is then still intact.
    """
    nodes = {"checkpoint": Node(None, {})} | {f"checkpoint/{name}": Node(value, {}) for name, value in arrays.items()}
    nodes["made_by"] = Node(json.dumps(made_by), {})
    write_file(path, sealed(to_bytes(nodes, compress=False)))


def read_checkpoint(path: str | Path, made_by: dict) -> dict[str, np.ndarray] | None:
    """Return the named arrays of a checkpoint file; None if there is no file.

    Raises StorageError if it is damaged, RequestError if its `made_by` differs; the message names the first difference.
    """
    if not Path(path).exists():
        return None
    try:
        nodes = from_bytes(read_sealed(path))
        if "checkpoint" not in nodes:
            raise StorageError("is a file of brownpipe, but not a checkpoint")
    except StorageError as error:
        raise StorageError(f"{path}: {error}; delete it to begin anew") from error
    stored = json.loads(nodes["made_by"].value)
    differing = [name for name in made_by if stored.get(name) != made_by[name]]
    if differing:
        cure = "repeat that command, delete this file to begin anew, or choose another --output"
        raise RequestError(f"{path}: is of a run with {_difference(differing[0], stored, made_by)}; {cure}")
    arrays = ((name.removeprefix("checkpoint/"), node.value) for name, node in nodes.items())
    return {name: value for name, value in arrays if name not in ("checkpoint", "made_by")}


def remove_checkpoint(path: str | Path) -> None:
    """Remove a checkpoint file, and the part of one that a killed process has left."""
    for file in (path, f"{path}.brownpipe.part"):
        Path(file).unlink(missing_ok=True)


def _difference(name: str, stored: dict, made_by: dict) -> str:
    """Return the words for an entry that differs; of digests and long lists the name alone."""
    values = [str(mapping.get(name)) for mapping in (stored, made_by)]
    return f"another {name}" if max(map(len, values)) > 40 else f"{name} {values[0]}, not {values[1]}"
