"""`brownpipe new`: a scene and a study to start from."""

from argparse import Namespace
from collections.abc import Callable

from brownpipe.errors import DONE
from brownpipe.quoting import shell_path
from brownpipe.verbs.output import show

EXAMPLE = "my_study"


def add_arguments(add: Callable) -> None:
    add("name", metavar="NAME", help="name of the study")
    add("--folder", default=".", metavar="FOLDER", help="where to write the files (default: this folder)")


def new(arguments: Namespace) -> int:
    """Write a commented scene and study to start from: NAME_scene.yaml and NAME.yaml.

    They run as they are, in half a minute: a heavy disk among 199 and among 399 light ones, 300 runs each.
    """
    from brownpipe.study.new_study import write_new_study
    from brownpipe.study.workflow import pipeline_folder

    scene, study = write_new_study(arguments.name, arguments.folder)
    quoted = shell_path(study)
    show(f"{scene}: the physics of one run", f"{study}: the runs and their analysis", "")
    show(f"brownpipe check {quoted}    # what will be simulated, at what cost")
    show(f"brownpipe run {quoted}      # results and figures in results/{study.stem}")
    show(f"all keys: {pipeline_folder() / 'config' / 'README.md'}")
    return DONE
