"""How a study was run: `run.yaml` in its results names the study file and the keys that the command line replaced."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from brownpipe.errors import RequestError, StorageError
from brownpipe.quoting import shell_path, shell_word
from brownpipe.scene.yaml_file import read_yaml, yaml_text
from brownpipe.storage.checksums import MOST_BYTES, read_sealed_text, write_sealed_text

NAME = "run.yaml"
COMMENT = "# How this study was run; `brownpipe verify` compares its results with what it asks for."


class RunRecord(NamedTuple):
    """What `brownpipe run` was given."""

    study: str  # path of the study file, relative to the folder that holds `results`
    config: Mapping[str, object] = {}  # values in place of those of the study file

    def command(self, *target: str) -> str:
        """Return the command that runs the study again, to be pasted into a shell."""
        config = ["--config", *(f"{key}={json.dumps(value)}" for key, value in self.config.items())]
        further = [*target, *(config if self.config else [])]
        words = ["--", *map(shell_word, further)] if further else []
        return " ".join(["brownpipe run", shell_path(self.study), *words])


def write_run_record(folder: str | Path, record: RunRecord) -> None:
    """Write the record into the folder of a study's results, unless it is there."""
    text = f"{COMMENT}\n{yaml_text({'study': record.study, 'config': dict(record.config)})}"
    path = Path(folder) / NAME
    try:
        if read_sealed_text(path) == text:
            return
    except StorageError:
        pass
    write_sealed_text(path, text)


def read_run_record(folder: str | Path) -> RunRecord:
    """Return the record of a study's results; without a seal it is not trusted, but taken for what it says.

    Raises RequestError if there is no record in the file.
    """
    path = Path(folder) / NAME
    mapping = read_yaml(path, MOST_BYTES)
    if not isinstance(mapping, dict) or not isinstance(mapping.get("study"), str):
        raise RequestError(f"{path}: names no study")
    config = mapping.get("config")
    return RunRecord(mapping["study"], config if isinstance(config, dict) else {})


def is_run_record(path: str | Path) -> bool:
    """Whether a file is a record of how a study was run."""
    try:
        read_run_record(Path(path).parent)
    except RequestError:
        return False
    return True


def likely_study(folder: Path) -> str | None:
    """Return the study file with the name of the results: NAME.yaml beside `results`, or the only one a folder deeper.

    None if there is no such file.
    """
    root, name = folder.parent.parent, f"{folder.name}.yaml"
    beside, deeper = root / name, list(root.glob(f"*/{name}"))
    found = [beside] if beside.is_file() else deeper
    return os.path.relpath(found[0], root) if len(found) == 1 else None
