"""The pages of reference that are made from the source: the command line, and what is in the files."""

import argparse
from collections.abc import Mapping

from brownpipe.analysis.dataset import ALL_COORDINATES, ALL_VARIABLES
from brownpipe.analysis.variables import Variable
from brownpipe.cli import build_parser
from brownpipe.engines import configured
from brownpipe.observables import ARRAYS, OBSERVABLES
from brownpipe.scene import parse_scene
from brownpipe.storage.hdf5 import Node, Nodes
from brownpipe.storage.layout import MEANING, parameter_nodes, run_nodes
from brownpipe.tradeoff import variables as tradeoff
from brownpipe.verbs import VERBS
from markdown_text import code, plain, table

ENDINGS = ("_standard_error", "_low", "_high")  # of names of variables
EXAMPLE = {  # a scene whose runs have every array of observables but that of runs between walls
    "box": {"x": [0, 4], "y": [0, 4], "boundary": "periodic"},
    "disks": {
        "tracer": {"radius": 0.2, "mass": 2},
        "species": [{"name": "bath", "count": 8, "radius": 0.1, "mass": 1}],
    },
    "velocities": {"temperature": 1},
    "equilibrate": {"time": 0.1, "tracer": "free"},
    "duration": 1,
    "sample_interval": 0.5,
}
SEED = 17
GROUPS = (  # with datasets
    *("particles/tracer", f"particles/seed_{SEED:05d}", "observables/run", f"observables/events/seed_{SEED:05d}"),
    "parameters",
)


# -- the command line -----------------------------------------------------------------------------------------------


def command_line() -> str:
    """Return the page of all verbs with their arguments."""
    head = "# Command line\n\nThe help of `brownpipe` and of each of its verbs (`brownpipe VERB --help`).\n"
    return "\n".join([head, _arguments(build_parser([])), *map(_verb, VERBS)])


def _verb(name: str) -> str:
    """Return the section of a verb."""
    parser = build_parser([name]).of_verb
    paragraphs = [" ".join(part.split()) for part in parser.description.split("\n\n")]
    usage = f"```text\n{parser.format_usage().removeprefix('usage: ')}```\n"
    example = f"```sh\n{parser.epilog.removeprefix('example: ')}\n```\n"
    return "\n".join([f"## {name}\n", *(f"{plain(text)}\n" for text in paragraphs), usage, _arguments(parser), example])


def _arguments(parser: argparse.ArgumentParser) -> str:
    """Return the list of the arguments of a parser, with their help."""
    formatter = parser._get_formatter()
    parts = []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            continue
        metavar = formatter._format_args(action, action.dest.upper()) if action.nargs != 0 else ""
        names = [f"{option} {metavar}".rstrip() for option in action.option_strings] or [metavar]
        parts.append(f"{', '.join(map(code, names))}\n: {plain(formatter._expand_help(action))}\n")
    return "\n".join(parts)


# -- files ----------------------------------------------------------------------------------------------------------


TRAJECTORIES = f"""\
# Files

What `brownpipe simulate` writes (HDF5), and what `brownpipe aggregate` and `brownpipe tradeoff` write (netCDF4). Units
are the reduced units of the scene. [The guide](guide.md#what-is-in-the-files) shows how to read these files.

## Trajectory files

The contents of the file of one run, of seed {SEED}, with everything recorded (`--record all,events`) and all
observables. A file of S seeds has S entries along `seed`; if all disks are recorded, it has a group of them for each
seed.
"""
OTHERS = """\
### In observables/run of some files only

What only other engines report, runs that could not go on, or runs between walls; `seed` is the first dimension.
"""
DATASETS = """\
## Datasets

The dataset of a study. `msd` + `_low` says that there is also `msd_low`: `_standard_error` is the standard error over
runs, `_low` and `_high` are the ends of the 95 % interval. A variable is in a dataset if some case has a value for it.
"""


def files() -> str:
    """Return the page of the contents of trajectory files and datasets."""
    nodes = example_nodes()
    found = {path.rpartition("/")[2] for path in nodes}
    known = MEANING | {name: (array.units, array.long_name) for name, array in ARRAYS.items()}
    others = [(code(name), plain(units), plain(text)) for name, (units, text) in known.items() if name not in found]
    return "\n".join(
        [
            TRAJECTORIES,
            *(_datasets(group, nodes) for group in GROUPS),
            OTHERS,
            table(("name", "unit", "meaning"), others),
            "### Attributes of groups\n",
            table(("group", "attributes"), _groups(nodes)),
            DATASETS,
            _variables(ALL_VARIABLES, ALL_COORDINATES),
            "## Trade-off datasets\n",
            _variables(tradeoff.VARIABLES, tradeoff.COORDINATES),
        ]
    )


def example_nodes() -> Nodes:
    """Return the nodes of the trajectory file of one run, with everything recorded and measured."""
    scene, engine = parse_scene(EXAMPLE, "example.yaml"), configured("exact")
    record = frozenset({"tracer", "all", "events"})
    ensemble = engine.simulate(scene, [SEED], record, observables=tuple(OBSERVABLES), average="runs")
    return run_nodes(scene, ensemble) | parameter_nodes(scene, engine, ensemble, "", "")


def _datasets(group: str, nodes: Nodes) -> str:
    """Return the section of a group: a table of its datasets, those of groups in it included."""
    own = {path: node for path, node in nodes.items() if isinstance(node, Node) and node.value is not None}
    rows = [
        (code(path.removeprefix(f"{group}/")), *map(plain, (", ".join(node.dims), *described(node))))
        for path, node in own.items()
        if path.startswith(f"{group}/")
    ]
    return f"### {group}\n\n{table(('dataset', 'dimensions', 'unit', 'meaning'), rows)}"


def described(node: Node) -> tuple[str, str]:
    """Return unit and meaning of a dataset."""
    return node.attributes["units"], node.attributes["long_name"]


def _groups(nodes: Nodes) -> list[tuple[str, ...]]:
    """Return a row for each group of a file that has attributes."""
    groups = {path: node for path, node in nodes.items() if isinstance(node, Node) and node.value is None}
    return [(code(path), ", ".join(map(code, node.attributes))) for path, node in groups.items() if node.attributes]


def _variables(variables: Mapping[str, Variable], coordinates: Mapping[str, Variable]) -> str:
    """Return the tables of variables, with their errors and intervals, and of coordinates."""
    rows = []
    for name, one in variables.items():
        base = next((name.removesuffix(ending) for ending in ENDINGS if name.endswith(ending)), "")
        if base not in variables:
            names = [name, *(ending for ending in ENDINGS if f"{name}{ending}" in variables)]
            rows.append((" + ".join(map(code, names)), *map(plain, (", ".join(one.dims), one.units, one.long_name))))
    named = [(code(name), plain(one.units or "1"), plain(one.long_name)) for name, one in coordinates.items()]
    head = ("variable", "dimensions", "unit", "meaning")
    return f"{table(head, rows)}\n{table(('coordinate', 'unit', 'meaning'), named)}"
