"""`brownpipe check`: is a scene or study valid, and what will it cost?"""

from argparse import Namespace
from collections.abc import Callable

from brownpipe.verbs.output import show
from brownpipe.verbs.values import SCENE, add_particles

EXAMPLE = SCENE


def add_arguments(add: Callable) -> None:
    add("file", metavar="SCENE|STUDY", help="scene or study file (YAML)")
    add_particles(add)


def check(arguments: Namespace) -> None:
    """Say whether a scene or study is valid, what will be simulated, and what it will cost."""
    from brownpipe.study.check import describe_scene_or_study

    show(*describe_scene_or_study(arguments.file, arguments.particles).split("\n"))
