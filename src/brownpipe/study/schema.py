"""JSON Schema of study files, for completion and checking in editors: `brownpipe schema study`.

Engines with their settings, observables and figures are those of their lists. `scene/schema.py` says what a schema
leaves to the reader. Names of earlier versions, which the reader still accepts, are not in the schema, except the key
`observable`.
"""

from collections.abc import Iterable

from brownpipe.engines import DEFINITIONS
from brownpipe.engines.definition import Definition
from brownpipe.figures.catalogue import FIGURES
from brownpipe.observables import AVERAGES, OBSERVABLES
from brownpipe.scene.scene_file import MOST_DISKS
from brownpipe.scene.schema import (
    NOT_NEGATIVE,
    POSITIVE,
    Schema,
    described,
    document,
    integer,
    mapping,
    one_of,
    or_null,
    pair,
)
from brownpipe.scene.seeds import LARGEST_SEED, MOST_SEEDS, RANGE
from brownpipe.study.study_file import AUTO, DEFAULTS, MOST_RINGS, PERCENTAGE, RECORDS, RENAMED_KEYS, TARGETS

TEXT: Schema = {"type": "string", "minLength": 1}


def study_schema() -> Schema:
    """Return the JSON Schema of study files."""
    keys = _keys()
    optional = {key: keys[key] for key in DEFAULTS}
    renamed = {old: keys[new] | {"deprecated": True} for old, new in RENAMED_KEYS.items()}
    given = [{"required": [key], "not": {"properties": {key: {"type": "null"}}}} for key in ("seeds", "tolerance")]
    schema = mapping({"scenes": keys["scenes"]}, optional | renamed) | {"oneOf": given}
    return document("Study of brownpipe", schema)


def _keys() -> dict[str, Schema]:
    """The schema of each key."""
    percentage = {"type": "string", "pattern": f"^{PERCENTAGE.pattern}$"}
    tolerance = one_of({"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}, percentage, {"type": "null"})
    figures = or_null(_one_or_more(_word(FIGURES), unique=True))
    observables = one_of(_one_or_more(_word(OBSERVABLES)), {"type": "array", "maxItems": 0}, {"type": "null"})
    windows = {"type": "array", "items": pair(NOT_NEGATIVE), "minItems": 1}
    rings = mapping({"dr": described(POSITIVE, "width [length]"), "count": integer(1, MOST_RINGS)})
    instead_of = {"type": "object", "additionalProperties": or_null(_one_or_more(TEXT, least=0))}
    keys = {
        "scenes": (_one_or_more(TEXT), "scene files, relative to the folder of the study"),
        "seeds": (or_null(_seeds()), "a count (2400: seeds 0 to 2399), a range (100-199), or a list of both"),
        "tolerance": (tolerance, "in place of seeds: relative standard error of the target, like 0.02 or 2%"),
        "target": (or_null(_word(TARGETS)), "the quantity that the tolerance refers to (default: msd)"),
        "particles": (
            or_null(_one_or_more(integer(0, MOST_DISKS), unique=True)),
            "numbers of disks (default: the scene's)",
        ),
        "engines": (_one_or_more(_engine()), "engines, with their settings if any (default: exact)"),
        "batch": (
            one_of({"const": AUTO}, integer(1, MOST_SEEDS)),
            "seeds per job (default: auto, from the forecast); results do not depend on it",
        ),
        "record": (_word(RECORDS), "the tracer's trajectory in every run (default), or only the observables"),
        "observables": (observables, "quantities measured in each run, from all of its disks (default: none)"),
        "average": (_word(AVERAGES), "average over runs alone (default), or also over time origins or equal disks"),
        "figures": (figures, "figures to draw (default: all that the study has data for)"),
        "displacement_times": (
            _one_or_more(POSITIVE, least=0),
            "times of the displacement distribution (default: the end of each run)",
        ),
        "fit_windows": (or_null(windows), "[t0, t1] in which lines are fitted to the MSD [time]"),
        "rings": (or_null(rings), "of the displacement distribution (default: from the data)"),
        "instead_of": (instead_of, "scenes that may be run in place of others, for brownpipe tradeoff"),
        "allow_failed": (integer(0, MOST_SEEDS), "runs of the study that may fail (default: 0)"),
    }
    return {key: described(schema, text) for key, (schema, text) in keys.items()}


def _word(words: Iterable[str]) -> Schema:
    return {"enum": list(words)}


def _one_or_more(schema: Schema, least: int = 1, unique: bool = False) -> Schema:
    """The schema of a value or of a list of such values."""
    return one_of(schema, {"type": "array", "items": schema, "minItems": least, "uniqueItems": unique})


def _seeds() -> Schema:
    text = {"type": "string", "pattern": rf"^\s*{RANGE.pattern}\s*(,\s*{RANGE.pattern}\s*)*$"}
    return one_of(
        integer(1, MOST_SEEDS), text, {"type": "array", "items": one_of(integer(0, LARGEST_SEED), text), "minItems": 1}
    )


def _engine() -> Schema:
    """The schema of an engine: its name, or a mapping of its name and settings."""
    bare = [
        name
        for name, definition in DEFINITIONS.items()
        if all(setting.default is not None for setting in definition.settings.values())
    ]
    return one_of(_word(bare), *(_with_settings(definition) for definition in DEFINITIONS.values()))


def _with_settings(definition: Definition) -> Schema:
    required: dict[str, Schema] = {"name": {"const": definition.name}}
    optional: dict[str, Schema] = {}
    for key, setting in definition.settings.items():
        schema = described(_word(setting.words) if setting.words else POSITIVE, setting.help)
        (required if setting.default is None else optional)[key] = schema
    optional["scenes"] = described(_one_or_more(TEXT), "names of the scenes it is used in (default: all)")
    optional["seeds"] = described(_seeds(), "in place of the study's")
    return described(mapping(required, optional), definition.summary)
