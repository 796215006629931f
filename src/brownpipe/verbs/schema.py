"""`brownpipe schema`: the JSON Schema of scenes or studies."""

import json
from argparse import Namespace
from collections.abc import Callable

from brownpipe.verbs.output import show

EXAMPLE = "study"


def add_arguments(add: Callable) -> None:
    add("kind", choices=("scene", "study"), metavar="scene|study", help="the kind of file")


def schema(arguments: Namespace) -> None:
    """Print the JSON Schema of scene or study files, with which editors complete and check their keys.

    An editor with a YAML language server reads it if the file begins with a comment that says where it is:
    # yaml-language-server: $schema=study.json
    """
    from brownpipe.scene import Scene
    from brownpipe.study import Study

    made = (Scene if arguments.kind == "scene" else Study).model_json_schema()
    show(*json.dumps(made, indent=1).split("\n"))
