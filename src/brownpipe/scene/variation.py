"""Scenes of which some keys take several values: `vary` of a study, `brownpipe simulate --value`,
`brownpipe.scan`.

A key is a path such as `disks.tracer.mass`, `disks.species.bath.count` (a species by its name) or
`duration`; `packing_fraction` scales the box, with the given places in it.
"""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, TypeGuard

import numpy as np
from pydantic import AfterValidator, Field

from brownpipe.errors import RequestError
from brownpipe.scene.reading import (
    As,
    Number,
    Positive,
    Section,
    YamlValue,
    key,
    part_of,
    refuse,
    validated,
    with_values,
)
from brownpipe.scene.scene import Scene, parse_scene, refuse_other_file, scaled_disks

PACKING_FRACTION = "packing_fraction"
GROUPS = ("disks", "species", "velocities")  # words of a path that its short name leaves out
# of a value in names and coordinates: 0.3 is 0.3, although the box is calculated from it
DIGITS = 12
Values = tuple[YamlValue, ...]  # of a varied key


class Span(Section):
    """Values at equal steps, or at equal factors (log)."""

    first: Number = key("the first value", alias="from")
    last: Number = key("the last value", alias="to")
    count: Annotated[int, Field(strict=True, ge=2, le=10_000)] = key("how many")
    spacing: Literal["linear", "log"] = key("equal steps or equal factors", "linear")


def _spanned(span: Span, path: str) -> tuple[float, ...]:
    """Return the values of a span to DIGITS digits, as the last bits of NumPy's powers differ
    between processors.

    Numbers of disks are whole.
    """
    if span.spacing == "log" and not span.first * span.last > 0:
        refuse("must be different from 0 and of one sign for spacing: log", path, "from")
    spaced = np.geomspace if span.spacing == "log" else np.linspace
    values = spaced(span.first, span.last, span.count)
    if path.endswith(".count"):
        return tuple(round(value) for value in values)
    return tuple(float(f"{value:.{DIGITS}g}") for value in values)


def _all_spanned(vary: Mapping[str, Span | Values]) -> dict[str, Values]:
    return {
        path: _spanned(values, path) if isinstance(values, Span) else values
        for path, values in vary.items()
    }


# pydantic leaves the values as they are: the scene with them is validated
SpanOrValues: Any = Span | Annotated[tuple[Any, ...], Field(min_length=1)]
Vary = Annotated[dict[str, Annotated[Values, As(SpanOrValues)]], AfterValidator(_all_spanned)]


def combinations(
    vary: Mapping[str, Sequence[YamlValue]], together: bool
) -> list[dict[str, YamlValue]]:
    """Return the values by key of each variant: all combinations or, `together`, first values,
    second ones, ...

    Raises RequestError for the key `particles`, for values of equal names, and for lists of
    different lengths where values belong together.
    """
    if "particles" in vary:
        raise RequestError(
            "vary: particles must be varied by the key `particles` of a study, or by --particles"
        )
    for values in vary.values():
        names = {_word(value) for value in values}
        if len(names) < len(values):
            raise RequestError("vary: must be values that differ")
    lengths = {len(values) for values in vary.values()}
    if together and len(lengths) > 1:
        raise RequestError(
            "vary: must be lists of the same length, as their values belong together"
        )
    rows = zip(*vary.values(), strict=True) if together and vary else product(*vary.values())
    return [dict(zip(vary, row, strict=True)) for row in rows]


def scene_with(
    mapping: Mapping[str, YamlValue],
    where: str,
    values: Mapping[str, YamlValue],
    particles: int | None = None,
    name: str | None = None,
) -> Scene:
    """Return the scene of a mapping, as `parse_scene` does, with these values by key, which are
    added to its name.

    Raises RequestError for anything wrong.
    """
    words = [f"{short_name(path)}={_word(value)}" for path, value in values.items()]
    name = ",".join([name or Path(where).stem, *words])
    refuse_other_file(values)
    keys = dict(values) if particles is None else {**values, "particles": particles}
    phi = keys.pop(PACKING_FRACTION, None)
    mapping = with_values(mapping, _longhand(mapping, keys) | keys, where)
    if PACKING_FRACTION in values:
        mapping = _scaled(mapping, where, phi)
    return parse_scene(mapping, where, name=name)


def _longhand(mapping: Mapping[str, YamlValue], paths: Collection[str]) -> dict[str, YamlValue]:
    """Return the mappings for which a scene has a number or a word, of those of which some paths
    are keys: `{"equilibrate": {"time": 2}}` of `equilibrate: 2`.
    """
    longhand: dict[str, YamlValue] = {}
    time = mapping.get("equilibrate")
    if is_number(time) and any(path.startswith("equilibrate.") for path in paths):
        longhand["equilibrate"] = {"time": time}
    box = mapping.get("box")
    boundary = box.get("boundary") if isinstance(box, dict) else None
    if isinstance(boundary, str) and any(path.startswith("box.boundary.") for path in paths):
        longhand["box.boundary"] = {"x": boundary, "y": boundary}
    return longhand


def _scaled(
    mapping: Mapping[str, YamlValue], where: str, packing_fraction: YamlValue
) -> Mapping[str, YamlValue]:
    """Return the mapping of a scene with a box, and the given places in it, scaled to this packing
    fraction.
    """
    wanted = validated(Annotated[Positive, Field(le=1)], packing_fraction, where, PACKING_FRACTION)
    scene = validated(Scene, mapping, where, context="box to be scaled")
    if scene.packing_fraction == 0:
        raise RequestError(f"{where}: {PACKING_FRACTION}: must be of disks, and there are none")
    factor = math.sqrt(scene.packing_fraction / wanted)
    lengths = {"box.x": scene.box.x, "box.y": scene.box.y}
    if scene.configuration is None and scene.tracer_position is not None:
        lengths["disks.tracer.position"] = scene.tracer_position
    scaled: dict[str, YamlValue] = {}
    for path, (first, last) in lengths.items():
        scaled[path] = [factor * first, factor * last]
    if scene.configuration is not None:
        scaled["disks"] = scaled_disks(scene, factor)
    return with_values(mapping, scaled, where)


def short_name(path: str) -> str:
    """Return the name of a varied key in datasets and folders: `tracer_mass` of
    `disks.tracer.mass`.
    """
    return "_".join(word for word in path.split(".") if word not in GROUPS)


def value_of(scene: Scene, path: str) -> float | str:
    """Return the value of a varied key in a scene: a number, or a text; "none" of a key that has no
    value.
    """
    if path == "equilibrate":  # a number stands for {time: number}
        path = "equilibrate.time"
    if path.startswith("box.boundary."):  # one word stands for two equal ones
        is_periodic = {"x": scene.box.periodic_x, "y": scene.box.periodic_y}
        return "periodic" if is_periodic[path.removeprefix("box.boundary.")] else "reflecting"
    *parents, last = path.split(".")
    section = part_of(_all_keys(scene), parents)
    assert isinstance(section, dict)
    value = section.get(last)
    word = _word(value)
    return type(value)(float(word)) if is_number(value) else word


def _all_keys(scene: Scene) -> dict[str, YamlValue]:
    """Return the mapping of a scene with the packing fraction, and with the keys that its text
    leaves out.
    """
    keys = scene.as_mapping() | {PACKING_FRACTION: scene.packing_fraction}
    keys |= scene.model_dump(include={"velocities", "equilibrate"}, exclude_none=True)
    disks = keys["disks"]
    configuration = scene.configuration
    if configuration is None or not isinstance(disks, dict):
        return keys
    disks["push_apart"] = scene.push_apart
    if scene.has_tracer:
        velocity = (
            scene.tracer_velocity
            if configuration.velocity is None
            else configuration.velocity[0].tolist()
        )
        disks["tracer"] |= {"position": scene.tracer_position, "velocity": velocity}
    return keys


def unit_of(path: str) -> str:
    """Return the unit of a varied key, which the meaning of the key has in brackets."""
    schema = Scene.model_json_schema()
    keys = {**schema["properties"]}
    for section in schema["$defs"].values():
        keys |= section["properties"]
    name = path.split(".")[-1]
    meaning = keys.get(name, {}).get("description", "")
    unit = re.search(r"\[([\w/]+)\]", meaning)
    return unit[1] if unit else "1"


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a number, which may be on an axis; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _word(value: YamlValue) -> str:
    """Return a value as a part of a name of a folder.

    >>> _word({"x": "periodic", "y": "reflecting"})
    'x-periodic-y-reflecting'
    """
    if isinstance(value, Mapping):
        return "-".join(f"{name}-{_word(value[name])}" for name in sorted(value))
    if isinstance(value, list | tuple):
        return "-".join(map(_word, value))
    return f"{value:.{DIGITS}g}".replace("+", "") if is_number(value) else str(value).lower()
