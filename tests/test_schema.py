"""The JSON Schemas of scenes and studies: they accept what the reader accepts, with the same keys, bounds and words."""

import contextlib
import copy
import json
from pathlib import Path

import pytest
from jsonschema import Draft7Validator

from brownpipe.cli import main
from brownpipe.errors import DONE, RequestError
from brownpipe.scene import read_scene, reading
from brownpipe.scene.scene_file import MOST_BYTES
from brownpipe.scene.schema import scene_schema
from brownpipe.scene.yaml_file import read_yaml
from brownpipe.study import read_study
from brownpipe.study.schema import study_schema
from brownpipe.study.study_file import RENAMED_KEYS

ROOT = Path(__file__).parent.parent
CONFIG = ROOT / "config"
ALL_SCENES = sorted((CONFIG / "scenes").glob("*.yaml")) + sorted((ROOT / "tests" / "scenes").glob("*.yaml"))
SCENES = [file for file in ALL_SCENES if not file.stem.startswith(("refuse_", "expected"))]
STUDIES = sorted(CONFIG.glob("*.yaml"))
SCHEMAS = {"scene": scene_schema(), "study": study_schema()}
ACCEPTS = {kind: Draft7Validator(schema).is_valid for kind, schema in SCHEMAS.items()}
WHOLE_SCENE = {
    "box": {"x": [-3, 3], "y": [-3, 3], "boundary": "periodic"},
    "particles": 9,
    "disks": {
        "tracer": {"radius": 0.3, "mass": 1, "position": [0, 0]},
        "species": [{"name": "bath", "count": "rest", "radius": 0.1, "mass": 0.4}],
        "placement": "random",
    },
    "velocities": {"temperature": 1.6, "zero_momentum": True},
    "duration": 1,
    "samples": {"per_decade": 5, "first": 0.01},
    "equilibrate": {"time": 1, "tracer": "free"},
}
BARE_SCENE = {
    "box": {"x": [0, 1], "y": [0, 1]},
    "disks": {"species": [{"name": "bath", "count": 3, "radius": 0.01, "mass": 1}]},
    "velocities": {"standard_deviation": 1},
    "duration": 1,
    "equilibrate": 1,
}
LISTED_SCENE = {
    "box": {"x": [0, 1], "y": [0, 1]},
    "disks": [{"position": [0.5, 0.5], "velocity": [1, 0], "radius": 0.1, "mass": 1}],
    "duration": 1,
    "sample_interval": 0.1,
}
WHOLE_STUDY = {
    "scenes": ["scenes/harrison2020.yaml", "scenes/harrison2020_thermal.yaml"],
    "seeds": ["0-9", 17],
    "particles": [50, 100],
    "engines": [
        "exact",
        {
            "name": "timestep",
            "time_step": 0.01,
            "precision": "single",
            "collisions": "late",
            "scenes": "harrison2020",
            "seeds": 3,
        },
        {"name": "langevin", "friction": "enskog", "scenes": ["harrison2020"], "seeds": "0-9"},
    ],
    "batch": 100,
    "record": "tracer",
    "observables": ["species_energy"],
    "average": "runs",
    "figures": ["msd", "health"],
    "displacement_times": [0.5],
    "fit_windows": [[0.1, 1]],
    "rings": {"dr": 0.04, "count": 24},
    "instead_of": {"harrison2020": ["harrison2020_thermal"]},
    "allow_failed": 2,
}
EXACT = {"name": "exact", "scenes": "harrison2020", "seeds": 3}
TOLERANT_STUDY = {"scenes": "scenes/harrison2020.yaml", "tolerance": "2%", "target": "d", "engines": [EXACT]}
TOLERANT_STUDY |= {"batch": "auto"}
EXAMPLES = [
    *(("scene", mapping) for mapping in (WHOLE_SCENE, BARE_SCENE, LISTED_SCENE)),
    *(("study", mapping) for mapping in (WHOLE_STUDY, TOLERANT_STUDY)),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the scenes of the studies."""
    path = tmp_path_factory.mktemp("studies")
    (path / "scenes").symlink_to(CONFIG / "scenes")
    return path


def read(kind, mapping, folder):
    """Read the text of a mapping as a scene or study. (JSON is YAML.)"""
    file = folder / f"{kind}.yaml"
    file.write_text(json.dumps(mapping))
    return {"scene": read_scene, "study": read_study}[kind](file)


@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_schemas_are_valid_and_in_docs(kind, capsys):
    Draft7Validator.check_schema(SCHEMAS[kind])
    assert main(["schema", kind]) == DONE
    printed = capsys.readouterr().out
    assert json.loads(printed) == SCHEMAS[kind]
    assert (ROOT / "docs" / "schema" / f"{kind}.json").read_text() == printed, (
        f"brownpipe schema {kind} > docs/schema/{kind}.json"
    )


@pytest.mark.parametrize(("kind", "mapping"), EXAMPLES, ids=range(len(EXAMPLES)))
def test_whole_examples_are_accepted(kind, mapping, folder):
    assert ACCEPTS[kind](mapping)
    read(kind, mapping, folder)


@pytest.mark.parametrize("file", SCENES + STUDIES, ids=lambda file: file.stem)
def test_every_file_that_is_there_is_accepted(file):
    kind = "study" if file in STUDIES else "scene"
    assert ACCEPTS[kind](read_yaml(file, MOST_BYTES))


# -- the same keys, bounds and words --------------------------------------------------------------------------------


def parts_at(schema, path=()):
    """The parts of a schema that apply to the value at a path, of all alternatives."""
    branches = [part for key in ("anyOf", "oneOf") for branch in schema.get(key, ()) for part in parts_at(branch)]
    if not path:
        return [schema, *branches]
    first, rest = path[0], path[1:]
    if isinstance(first, int):
        inner = [part["items"] for part in (schema, *branches) if "items" in part]
    else:
        inner = [part["properties"][first] for part in (schema, *branches) if first in part.get("properties", ())]
    return [part for each in inner for part in parts_at(each, rest)]


@pytest.fixture
def asked(monkeypatch):
    """What the reader asks for while it reads: (function, entry, positional and keyword arguments)."""
    calls = []

    def spied(name, read):
        def spy(entry, *args, **kwargs):
            calls.append((name, entry, args, kwargs))
            return read(entry, *args, **kwargs)

        return spy

    for name in ("fields", "number", "integer", "choice"):
        monkeypatch.setattr(reading, name, spied(name, getattr(reading, name)))
    return calls


def has_keys(part, required, optional=None):
    """Whether a part of a schema has these keys, with null for those that default to it; engines have two more."""
    keys, properties = {*required, *(optional or {})}, part.get("properties", {})
    extra = properties.keys() - keys
    nulls = [key for key, default in (optional or {}).items() if default is None]
    return (
        keys <= properties.keys()
        and extra <= {*RENAMED_KEYS, "scenes", "seeds"}
        and set(part.get("required", ())) == set(required)
        and all(Draft7Validator(properties[key]).is_valid(None) for key in nulls)
    )


def has_bounds(part, above=None, least=None):
    bounds = {key: bound for key, bound in (("exclusiveMinimum", above), ("minimum", least)) if bound is not None}
    return part.get("type") == "number" and bounds.items() <= part.items()


def says_the_same(schema, name, path, args, kwargs):
    """Whether the schema has at this path the keys, bounds or words that the reader asks for there."""
    found = parts_at(schema, path)
    if name == "fields":
        return any(has_keys(part, *args) for part in found)
    if name == "choice":
        return set(args[0]) == {word for part in found for word in (*part.get("enum", ()), part.get("const")) if word}
    if name == "integer":
        return any((part.get("minimum"), part.get("maximum")) == args[:2] for part in found)
    return any(has_bounds(part, *args, **kwargs) for part in found)


def is_name_of_scene(path):
    """Whether the words at a path are the names of the scenes of the study, which no schema knows."""
    return path[:1] == ("instead_of",) or (path[:1] == ("engines",) and "scenes" in path)


@pytest.mark.parametrize(("kind", "mapping"), EXAMPLES, ids=range(len(EXAMPLES)))
def test_what_the_reader_asks_for_is_in_the_schema(kind, mapping, asked, folder):
    read(kind, mapping, folder)
    own = [(name, entry.path, *rest) for name, entry, *rest in asked if entry.file == str(folder / f"{kind}.yaml")]
    own = [call for call in own if not is_name_of_scene(call[1])]
    assert own and [call for call in own if not says_the_same(SCHEMAS[kind], *call)] == []


def keys_of(schema):
    """Every key of a schema, as (key, of the mapping with these keys)."""
    for part in parts_at(schema):
        yield from ((key, tuple(part["properties"])) for key in part.get("properties", ()))
        for inner in (*part.get("properties", {}).values(), *([part["items"]] if "items" in part else ())):
            yield from keys_of(inner)


def mappings_in(value):
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [*([value] if isinstance(value, dict) else ()), *(found for one in inside for found in mappings_in(one))]


@pytest.mark.parametrize("kind", SCHEMAS)
def test_the_examples_above_have_every_key(kind):
    given = [one.keys() for example_kind, mapping in EXAMPLES if example_kind == kind for one in mappings_in(mapping)]
    known = [(key, set(together)) for key, together in keys_of(SCHEMAS[kind]) if key not in RENAMED_KEYS]
    assert known
    assert [key for key, together in known if not any(key in keys and keys <= together for keys in given)] == [], (
        "no file of EXAMPLES has these keys"
    )


# -- what the schema refuses, the reader refuses --------------------------------------------------------------------

WRONG = (None, True, -1, 0, 0.5, 1e300, "word", "", [], [1], [[1, 2, 3]], {}, {"name": "exact"})


def changes_of(mapping):
    """Copies of a mapping: a value anywhere in it replaced, a key left out, an unknown key added."""
    for path in paths_of(mapping):
        for value in WRONG:
            yield changed(mapping, path, lambda parent, key, value=value: parent.__setitem__(key, value))
        yield changed(mapping, path, lambda parent, key: parent.__delitem__(key))
        if isinstance(path[-1], str):
            yield changed(mapping, path, lambda parent, key: parent.__setitem__(key + "s", parent[key]))


def paths_of(value, path=()):
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in inside:
        yield (*path, key)
        yield from paths_of(part, (*path, key))


def changed(mapping, path, change):
    mapping = copy.deepcopy(mapping)
    parent = mapping
    for key in path[:-1]:
        parent = parent[key]
    change(parent, path[-1])
    return mapping


@pytest.mark.parametrize(
    ("kind", "mapping"),
    [pytest.param(*one, marks=[pytest.mark.slow] if one[1] is WHOLE_STUDY else []) for one in EXAMPLES],
    ids=range(len(EXAMPLES)),
)
def test_what_the_schema_refuses_the_reader_refuses(kind, mapping, folder):
    refused = [one for one in changes_of(mapping) if not ACCEPTS[kind](one)]
    assert len(refused) > 10 * len(mapping)
    assert [one for one in refused if is_accepted(kind, one, folder)] == []


def is_accepted(kind, mapping, folder):
    with contextlib.suppress(RequestError):
        return read(kind, mapping, folder) is not None
    return False
