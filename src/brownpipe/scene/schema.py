"""JSON Schema of scene files, for completion and checking in editors: `brownpipe schema scene`.

A schema accepts every file that the reader accepts. The reader also checks what a schema cannot express, such as
overlaps. Bounds and words are those of the reader; `tests/test_schema.py` compares keys, bounds and words with what the
reader asks for while it reads, so that a new key without its entry here or in an example there fails.
"""

from typing import Any

from brownpipe.scene import reading
from brownpipe.scene.sample_times import MOST_PER_DECADE, SMALLEST_TIME
from brownpipe.scene.scene_file import (
    BOUNDARIES,
    HEAVIEST,
    MOST_DISKS,
    ONLY_WITH_SPECIES,
    PLACEMENTS,
    WHILE_EQUILIBRATING,
)

Schema = dict[str, Any]

DIALECT = "http://json-schema.org/draft-07/schema#"  # the one that language servers of editors read
POSITIVE: Schema = {"type": "number", "exclusiveMinimum": 0}
NOT_NEGATIVE: Schema = {"type": "number", "minimum": 0}
NAME: Schema = {"type": "string", "pattern": f"^{reading.NAME.pattern}$"}


def described(schema: Schema, description: str) -> Schema:
    """Return the schema with the text that an editor shows."""
    return schema | {"description": description}


def integer(least: int, most: int) -> Schema:
    """Return the schema of an integer from `least` to `most`."""
    return {"type": "integer", "minimum": least, "maximum": most}


def one_of(*schemas: Schema) -> Schema:
    """Return the schema of values that fit one of the schemas at least."""
    return {"anyOf": list(schemas)}


def or_null(schema: Schema) -> Schema:
    """Return the schema of values that fit, or of no value, which stands for the default."""
    return one_of(schema, {"type": "null"})


def pair(schema: Schema) -> Schema:
    """Return the schema of a list of two."""
    return {"type": "array", "items": schema, "minItems": 2, "maxItems": 2}


def mapping(required: dict[str, Schema], optional: dict[str, Schema] | None = None) -> Schema:
    """Return the schema of a mapping with these keys and no others."""
    properties = required | (optional or {})
    return {"type": "object", "properties": properties, "required": list(required), "additionalProperties": False}


def document(title: str, schema: Schema) -> Schema:
    """Return the schema of a whole file."""
    return {"$schema": DIALECT, "title": title} | schema


def key_names(schema: Schema) -> set[str]:
    """Return the names of all keys of mappings anywhere in a schema."""
    properties = schema.get("properties", {})
    parts = [*properties.values(), *schema.get("anyOf", ()), *filter(None, [schema.get("items")])]
    return set(properties).union(*map(key_names, parts))


def scene_schema() -> Schema:
    """Return the JSON Schema of scene files."""
    disks = one_of(_species(), _explicit())
    required = {
        "box": described(_box(), "the rectangle, and what happens at its sides"),
        "disks": described(disks, "species, whose disks are placed by the program, or an explicit list of disks"),
        "duration": described(POSITIVE, "a run goes from t = 0 to t = duration [time]"),
    }
    equilibrate = or_null(one_of(NOT_NEGATIVE, _equilibrate()))
    interval = "sample times: its multiples and the duration [time] (default: the duration)"
    optional = {
        "particles": described(or_null(integer(0, MOST_DISKS)), "number of disks (default: sum of the counts)"),
        "velocities": described(or_null(_velocities()), "initial velocities: a standard deviation or a temperature"),
        "sample_interval": described(or_null(POSITIVE), interval),
        "samples": described(or_null(_samples()), "logarithmic sample times, in place of sample_interval"),
        "equilibrate": described(equilibrate, "simulated time before t = 0 [time] (default: 0)"),
    }
    return document("Scene of brownpipe", mapping(required, optional) | _only_with_species())


def _only_with_species() -> Schema:
    """The keys that an explicit list of disks excludes, and the one that species need."""
    none = {"properties": {key: {"type": "null"} for key in ONLY_WITH_SPECIES}}
    return {"if": {"properties": {"disks": {"type": "array"}}}, "then": none, "else": {"required": ["velocities"]}}


def _box() -> Schema:
    side = described(pair({"type": "number"}), "[low, high] [length]")
    boundary = described({"enum": list(BOUNDARIES)}, "hard walls (default) or periodic boundaries")
    return mapping({"x": side, "y": side}, {"boundary": boundary})


def _disk_properties() -> dict[str, Schema]:
    mass = {"type": "number", "exclusiveMinimum": 0, "minimum": 1 / HEAVIEST, "maximum": HEAVIEST}
    return {"radius": described(POSITIVE, "[length]"), "mass": described(mass, "[mass]")}


def _explicit() -> Schema:
    motion = {
        "position": described(pair({"type": "number"}), "[x, y] [length]"),
        "velocity": described(pair({"type": "number"}), "[x, y] [length/time]"),
    }
    return {"type": "array", "items": mapping(motion | _disk_properties()), "maxItems": MOST_DISKS}


def _species() -> Schema:
    position = described(or_null(pair({"type": "number"})), "initial centre [x, y] [length] (default: placed)")
    tracer = mapping(_disk_properties(), {"position": position})
    count = one_of(integer(0, MOST_DISKS), {"const": "rest"})
    species = mapping({"name": NAME, "count": described(count, "a number, or rest: of particles")} | _disk_properties())
    keys = {
        "tracer": described(or_null(tracer), "disk 0, whose motion is recorded and analysed"),
        "species": {"type": "array", "items": species},
        "placement": described({"enum": list(PLACEMENTS)}, "random sequential insertion (default), or a lattice"),
    }
    return mapping({}, keys) | one_of({"required": ["tracer"]}, {"required": ["species"]})


def _velocities() -> Schema:
    keys = {
        "standard_deviation": described(or_null(NOT_NEGATIVE), "of every velocity component of every disk"),
        "temperature": described(or_null(NOT_NEGATIVE), "kT: velocity components have variance kT/m"),
        "zero_momentum": described({"type": "boolean"}, "subtract the velocity of the centre of mass (default: false)"),
    }
    return mapping({}, keys)


def _samples() -> Schema:
    first = {"type": "number", "exclusiveMinimum": SMALLEST_TIME}
    per_decade = described(integer(1, MOST_PER_DECADE), "sample times per factor of ten in time")
    return mapping({"per_decade": per_decade}, {"first": described(first, "the first sample time after 0 [time]")})


def _equilibrate() -> Schema:
    tracer = described({"enum": list(WHILE_EQUILIBRATING)}, "whether the tracer is held in place or moves meanwhile")
    return mapping({"time": described(NOT_NEGATIVE, "[time]")}, {"tracer": tracer})
