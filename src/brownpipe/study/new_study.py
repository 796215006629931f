"""A first study: a commented scene and study from `templates/`, to be edited."""

import os
from pathlib import Path

from brownpipe.errors import RequestError
from brownpipe.provenance import PACKAGE
from brownpipe.scene.reading import Name, validated
from brownpipe.storage.files import write_file

TEMPLATES = PACKAGE / "study" / "templates"


def write_new_study(name: str, folder: str | Path = ".") -> tuple[Path, Path]:
    """Write the scene `NAME_scene.yaml` and the study `NAME.yaml` into a folder, made if necessary; return their paths.

    Raises RequestError for a name that cannot be part of a path or is too long, or if one of the files exists;
    StorageError if one cannot be written.
    """
    name = name.removesuffix(".yaml")
    validated(Name, f"{name}_scene", key="name of the scene")
    paths = Path(folder) / f"{name}_scene.yaml", Path(folder) / f"{name}.yaml"
    for path in paths:
        if os.path.lexists(path):
            raise RequestError(f"{path}: exists; choose another name or folder")
    for path, template in zip(paths, ("scene.yaml", "study.yaml"), strict=True):
        write_file(path, (TEMPLATES / template).read_bytes().replace(b"NAME", name.encode()))
    return paths
