"""Study files, and values that replace some of their keys."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from brownpipe.errors import RequestError
from brownpipe.provenance import digest_of
from brownpipe.quoting import shell_path
from brownpipe.scene.reading import Name, validated
from brownpipe.scene.scene import is_study
from brownpipe.scene.yaml_file import Document, read_yaml, scalar
from brownpipe.study.study import Study

PLAIN = re.compile(r"[\w.,-]{1,40}", re.ASCII)  # a value that may be part of the name of a folder
REPLACED = {"seeds": "tolerance", "tolerance": "seeds"}  # by a new value of these keys


def read_study(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Study:
    """Return the study in a YAML file; paths of scenes are relative to the folder of that file.

    `overrides` replaces top-level keys; seeds also replace a tolerance, and a tolerance the seeds. Raises RequestError,
    one line, for any mistake in the study, or in any of its scenes with any of its particle counts.
    """
    mapping, overrides = read_yaml(path), overrides or {}
    if isinstance(mapping, Document):
        if not is_study(mapping) and mapping.keys() & {"box", "disks", "duration"}:
            cure = f"run it with brownpipe simulate {shell_path(path)}, or list it in a study"
            raise RequestError(f"{path}: is a scene, not a study; {cure}")
        gone = {
            REPLACED[new]: None for new in overrides.keys() & REPLACED if overrides[new] and REPLACED[new] in mapping
        }
        mapping = mapping.with_values({**gone, **overrides}) if overrides else mapping
    name = validated(Name, Path(path).stem, str(path), "name of the file") + variant(overrides)
    return validated(Study, mapping, str(path), context={"name": name, "folder": Path(path).parent})


def variant(overrides: Mapping[str, Any]) -> str:
    """Return what the name of a study gets for keys that are replaced, so that its results stand in another folder."""
    words = {key: value if isinstance(value, str) else json.dumps(value) for key, value in sorted(overrides.items())}
    return "".join(f"+{key}={word if PLAIN.fullmatch(word) else digest_of(word)}" for key, word in words.items())


def from_command_line(values: Mapping[str, object]) -> dict[str, object]:
    """Return the values of `snakemake --config KEY=VALUE` with the types that they would have in a study file.

    Snakemake reads numbers inside lists and mappings, null, true and false as text.
    """
    return {key: _with_types(value) for key, value in values.items()}


def _with_types(value: object) -> object:
    """Return a value with every text in it, at any depth, read as a plain scalar of YAML."""
    if isinstance(value, dict):
        return {key: _with_types(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_with_types(part) for part in value]
    return scalar(value) if isinstance(value, str) else value
