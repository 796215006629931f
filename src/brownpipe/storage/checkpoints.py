"""Checkpoints: what an engine needs to go on, in a file beside the output that is there only until that is complete."""

import glob
import json
from pathlib import Path

import numpy as np

from brownpipe.errors import RequestError, StorageError
from brownpipe.storage.files import BLANK_SEAL, read_sealed, seal, write_file
from brownpipe.storage.tree import Node, digest, from_bytes, to_bytes


def write_checkpoint(path: str | Path, made_by: dict, arrays: dict[str, np.ndarray]) -> None:
    """Write named arrays and what made them, a flat mapping of names to texts and numbers; all or nothing.

    Raises StorageError if the file cannot be written; the one before it is then still there.
    """
    nodes = {"checkpoint": Node(None, {})} | {f"checkpoint/{name}": Node(value, {}) for name, value in arrays.items()}
    nodes["made_by"] = Node(json.dumps(made_by), {})
    nodes["checkpoint"].attributes.update(contents_digest=digest(nodes), seal=BLANK_SEAL)
    write_file(path, seal(to_bytes(nodes, compress=False)))


def read_checkpoint(path: str | Path, made_by: dict) -> dict[str, np.ndarray] | None:
    """The arrays in a checkpoint, None if there is no file.

    Raises StorageError if it is damaged, and RequestError, naming what differs, if something else made it.
    """
    if not Path(path).exists():
        return None
    try:
        nodes = _contents(path)
    except StorageError as error:
        raise StorageError(f"{path}: {error}; delete it to begin anew") from error
    other = json.loads(nodes["made_by"].value)
    differing = [name for name in made_by if other.get(name) != made_by[name]]
    if differing:
        cure = "repeat that command, delete this file to begin anew, or choose another --output"
        raise RequestError(f"{path}: is of a run with {_difference(differing[0], other, made_by)}; {cure}")
    return {
        name.removeprefix("checkpoint/"): node.value
        for name, node in nodes.items()
        if name.startswith("checkpoint/") and node.value is not None
    }


def remove_checkpoint(path: str | Path) -> None:
    """Remove a checkpoint, and what a process that was killed while it wrote one has left."""
    path = Path(path)
    for file in (path, *path.parent.glob(f"{glob.escape(path.name)}.*.part")):
        file.unlink(missing_ok=True)


def _contents(path):
    nodes = from_bytes(read_sealed(path))
    if "checkpoint" not in nodes:
        raise StorageError("is a file of brownpipe, but not a checkpoint")
    if nodes["checkpoint"].attributes["contents_digest"] != digest(nodes):
        raise StorageError("HDF5 gives back other numbers than were written; check memory and the HDF5 library")
    return nodes


def _difference(name, other, made_by):
    """What is not the same, in words; digests and long lists are only named."""
    values = [str(each.get(name)) for each in (other, made_by)]
    return f"another {name}" if max(map(len, values)) > 40 else f"{name} {values[0]}, not {values[1]}"
