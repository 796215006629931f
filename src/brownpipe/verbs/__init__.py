"""The verbs of the command line.

Each verb is a record at the foot of its module: `brownpipe check FILE` runs `CHECK` of
`verbs/studies.py`. `VERBS` lists their names without importing a module, which takes time;
`load_verb("check")` imports one. Other imports that take long are inside the functions that need
them.
"""

from argparse import Action, Namespace
from collections.abc import Callable
from typing import NamedTuple

AddOption = Callable[..., Action]  # `add_argument` of the parser of a verb


class Verb(NamedTuple):
    """A verb of the command line.

    The docstring of `run` is the help: a line for the list of all verbs, paragraphs, and at the end
    an example, a command that parses.
    """

    name: str
    run: Callable[[Namespace], int | None]  # from arguments to the exit status; None: done
    add_options: Callable[[AddOption], None]


def _verbs_of_studies() -> tuple[Verb, ...]:
    from brownpipe.verbs.studies import CHECK, NEW, PLAN, RUN, SCHEMA

    return NEW, RUN, CHECK, PLAN, SCHEMA


def _verbs_of_runs() -> tuple[Verb, ...]:
    from brownpipe.verbs.simulate import SIMULATE

    return (SIMULATE,)


def _verbs_of_results() -> tuple[Verb, ...]:
    from brownpipe.verbs.results import AGGREGATE, FIGURES, TRADEOFF

    return AGGREGATE, FIGURES, TRADEOFF


def _verbs_of_files() -> tuple[Verb, ...]:
    from brownpipe.verbs.files import EXPORT, INSPECT, MOVIE, VERIFY

    return INSPECT, VERIFY, MOVIE, EXPORT


# the names in the order of the help, each with what imports its module
VERBS: dict[str, Callable[[], tuple[Verb, ...]]] = {
    **dict.fromkeys(["new", "run", "check", "plan", "schema"], _verbs_of_studies),
    "simulate": _verbs_of_runs,
    **dict.fromkeys(["aggregate", "figures", "tradeoff"], _verbs_of_results),
    **dict.fromkeys(["inspect", "verify", "movie", "export"], _verbs_of_files),
}


def load_verb(name: str) -> Verb:
    """Import the module of a verb, and return the verb."""
    [verb] = [verb for verb in VERBS[name]() if verb.name == name]
    return verb
