"""The pages of reference that are made from the source: the command line, and what is in the
files.
"""

import argparse
from collections.abc import Mapping

from brownpipe.analysis.dataset import ALL_COORDINATES, ALL_VARIABLES
from brownpipe.analysis.variables import Variable
from brownpipe.cli import build_parser
from brownpipe.engines import engine_of_request
from brownpipe.observables import OBSERVABLES
from brownpipe.scene import parse_scene
from brownpipe.scene.reading import YamlValue
from brownpipe.storage.layout import VARIABLES, described, dims_of, variables_by_group
from brownpipe.storage.trajectories import Trajectories
from brownpipe.tradeoff import dataset as tradeoff
from brownpipe.verbs import VERBS
from markdown_text import code, plain, table

ENDINGS = ("_standard_error", "_low", "_high")  # of names of variables
# a scene whose runs have every array of observables but that of runs between walls
EXAMPLE: dict[str, YamlValue] = {
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


# -- the command line ------------------------------------------------------------------------------


def command_line() -> str:
    """Return the page of all verbs with their arguments."""
    head = (
        "# Command line\n\nThe help of `brownpipe` and of each of its verbs (`brownpipe VERB "
        "--help`).\n"
    )
    return "\n".join([head, _arguments(build_parser([])), *map(_verb, VERBS)])


def _verb(name: str) -> str:
    """Return the section of a verb."""
    parser = build_parser([name]).verb_parser
    if parser is None or parser.description is None or parser.epilog is None:
        raise ValueError(f"{name}: must be a verb with a description and an example")
    paragraphs = [" ".join(part.split()) for part in parser.description.split("\n\n")]
    usage = f"```text\n{parser.format_usage().removeprefix('usage: ')}```\n"
    example = f"```sh\n{parser.epilog.removeprefix('example: ')}\n```\n"
    return "\n".join(
        [
            f"## {name}\n",
            *(f"{plain(text)}\n" for text in paragraphs),
            usage,
            _arguments(parser),
            example,
        ]
    )


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


# -- files -----------------------------------------------------------------------------------------


TRAJECTORIES = """\
# Files

What `brownpipe simulate`, `brownpipe aggregate` and `brownpipe tradeoff` write: netCDF4, which is
HDF5. Units are the reduced units of the scene. [The guide](guide.md#what-is-in-the-files) shows how
to read these files.

## Trajectory files

The groups of a file with everything recorded (`--record all,events`) and all observables, as
`xarray.open_datatree` and `brownpipe.open` show them.
"""
OTHERS = """\
### In the root of some files only

What only other engines report, runs that could not go on, or runs between walls; `seed` is the
first dimension.
"""
DATASETS = """\
## Datasets

The dataset of a study. `msd` + `_low` says that there is also `msd_low`: `_standard_error` is the
standard error over runs, `_low` and `_high` are the ends of the 95 % interval. A variable is in a
dataset if some case has a value for it.
"""


def files() -> str:
    """Return the page of the contents of trajectory files and datasets."""
    runs = example_runs()
    groups = variables_by_group(runs.scene, runs.ensemble)
    found = {name for variables in groups.values() for name in variables}
    others = [_row("/", name) for name in VARIABLES if name not in found]
    head = ("variable", "dimensions", "unit", "meaning")
    return "\n".join(
        [
            TRAJECTORIES,
            *(
                f"### {path}\n\n{table(head, [_row(path, name) for name in groups[path]])}"
                for path in groups
            ),
            OTHERS,
            table(head, others),
            f"### Attributes\n\n{', '.join(map(code, runs.attributes))}\n",
            DATASETS,
            _variables(ALL_VARIABLES, ALL_COORDINATES),
            "## Trade-off datasets\n",
            _variables(tradeoff.VARIABLES, tradeoff.COORDINATES),
        ]
    )


def example_runs() -> Trajectories:
    """Return one run with everything recorded and measured."""
    scene, engine = parse_scene(EXAMPLE, "example.yaml"), engine_of_request("exact", {})
    record = frozenset({"tracer", "all", "events"})
    ensemble = engine.simulate(
        scene, [SEED], record, observables=tuple(OBSERVABLES), average="runs"
    )
    return Trajectories(scene, engine, ensemble)


def _row(path: str, name: str) -> tuple[str, ...]:
    """Return the row of a variable: name, dimensions, unit and meaning."""
    return code(name), *map(plain, (", ".join(dims_of(path, name)), *described(name).values()))


def _variables(variables: Mapping[str, Variable], coordinates: Mapping[str, Variable]) -> str:
    """Return the tables of variables, with their errors and intervals, and of coordinates."""
    rows = []
    for name, one in variables.items():
        base = next((name.removesuffix(ending) for ending in ENDINGS if name.endswith(ending)), "")
        if base not in variables:
            names = [name, *(ending for ending in ENDINGS if f"{name}{ending}" in variables)]
            rows.append(
                (
                    " + ".join(map(code, names)),
                    *map(plain, (", ".join(one.dims), one.units or "1", one.long_name)),
                )
            )
    named = [
        (code(name), plain(one.units or "1"), plain(one.long_name))
        for name, one in coordinates.items()
    ]
    head = ("variable", "dimensions", "unit", "meaning")
    return f"{table(head, rows)}\n{table(('coordinate', 'unit', 'meaning'), named)}"
