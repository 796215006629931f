"""`brownpipe new`: a scene and a study to start from, from `templates/`."""

import os
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import RequestError
from brownpipe.provenance import PACKAGE
from brownpipe.quoting import shell_path
from brownpipe.verbs.output import show

EXAMPLE = "my_study"
TEMPLATES = PACKAGE / "study" / "templates"


def add_arguments(add: Callable) -> None:
    add("name", metavar="NAME", help="name of the study")
    add("--folder", default=".", metavar="FOLDER", help="where to write the files (default: this folder)")


def new(arguments: Namespace) -> None:
    """Write a commented scene and study to start from: NAME_scene.yaml and NAME.yaml.

    They run as they are, in half a minute: a heavy disk among 199 and among 399 light ones, 300 runs each.
    """
    from brownpipe.scene.reading import Name, validated
    from brownpipe.storage import write_file
    from brownpipe.study.workflow import pipeline_folder

    name = arguments.name.removesuffix(".yaml")
    validated(Name, f"{name}_scene", key="name of the scene")
    scene, study = Path(arguments.folder) / f"{name}_scene.yaml", Path(arguments.folder) / f"{name}.yaml"
    for path in (scene, study):
        if os.path.lexists(path):
            raise RequestError(f"{path}: exists; choose another name or folder")
    for path, template in ((scene, "scene.yaml"), (study, "study.yaml")):
        write_file(path, (TEMPLATES / template).read_bytes().replace(b"NAME", name.encode()))
    show(f"{scene}: the physics of one run", f"{study}: the runs and their analysis", "")
    show(f"brownpipe check {shell_path(study)}    # what will be simulated, at what cost")
    show(f"brownpipe run {shell_path(study)}      # results and figures in results/{study.stem}")
    show(f"all keys: {pipeline_folder() / 'config' / 'README.md'}")
