"""YAML files that brownpipe writes: the plan of a study, and studies derived from others."""

import os
from pathlib import Path

from brownpipe.engines import Engine
from brownpipe.errors import RequestError
from brownpipe.provenance import made_with
from brownpipe.scene.yaml_file import read_yaml, yaml_text
from brownpipe.storage import write_file
from brownpipe.study.study import REFERENCE
from brownpipe.study.study_file import read_study

# Keys of the original study that do not apply to the derived one.
NOT_INHERITED = ("batch", "tolerance", "target", "instead_of")


def derived_study(study_file: str | Path, path: str | Path, engine: Engine, runs: int) -> dict:
    """Return the contents of a study file at `path`: the scenes of another study with so many runs of one engine.

    Without the figures of the other study if this engine lacks what one of them needs. Raises RequestError if the study
    is refused for another reason.
    """
    mapping = read_yaml(study_file)
    assert isinstance(mapping, dict)  # as `study_file` has been read as a study before
    scenes = mapping["scenes"] if isinstance(mapping["scenes"], list) else [mapping["scenes"]]
    folder = Path(path).resolve().parent
    mapping["scenes"] = [os.path.relpath(Path(study_file).resolve().parent / scene, folder) for scene in scenes]
    for key in NOT_INHERITED:
        mapping.pop(key, None)
    if mapping.get("record") == "none":
        del mapping["record"]  # the planned quantity is calculated from the tracer's path
    keys = {"engines": [{"name": engine.name, **dict(engine.settings)}], "seeds": runs}
    try:
        read_study(study_file, keys | {"batch": "auto"})
    except RequestError:
        read_study(study_file, keys | {"batch": "auto", "figures": None})  # raises if it is refused for another reason
        mapping.pop("figures", None)
    return mapping | keys


def write_yaml(path: str | Path, values: dict, comment: str) -> None:
    """Write a mapping as YAML below a line of comment and one that says what wrote it, all or nothing."""
    text = yaml_text(values, in_blocks=True)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    made = made_with("simulate", REFERENCE.name)
    source = f"source of the engine {REFERENCE.name} {made['source_digest'][:12]}"
    who = f"Written by brownpipe {made['brownpipe_version']}, {source}."
    write_file(path, f"# {comment}\n# {who}\n\n{text}".encode())
