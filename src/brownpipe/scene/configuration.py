"""Configurations: disks whose positions are given, by a list in a scene, by a file or a program.

In the text of a scene the arrays of a configuration are the base64 of their little-endian bytes:
with every digit, 11 bytes a number, and without the file that they were read from.
"""

import base64
import binascii
from collections.abc import Mapping
from numbers import Real
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import PlainSerializer, PlainValidator, WithJsonSchema

from brownpipe.scene.reading import NAME, YamlValue, did_you_mean, refuse

MOST_KINDS = 10  # kinds of unnamed disks that are species of their own
ALL_DISKS = "disks"  # the species of unnamed disks of more kinds
TRACER = "tracer"  # the species of disk 0, if it has one of its own
TYPES = {
    "position": "<f8",
    "velocity": "<f8",
    "radius": "<f8",
    "mass": "<f8",
    "species_index": "<i8",
}


class Configuration(NamedTuple):
    """N disks, the tracer first.

    Disks have the names of species, or none. Of those without names, disks of equal radius and mass
    are a species, kind-1, kind-2, ... in the order of their first disks; of more than MOST_KINDS
    kinds all are one species, `disks`. The two of the example are kind-1 and kind-2.

    >>> import brownpipe as bp
    >>> pair = bp.Configuration(
    ...     position=np.array([[1.0, 1.0], [3.0, 1.0]]),
    ...     velocity=np.array([[1.0, 0.0], [-1.0, 0.0]]),
    ...     radius=np.array([0.5, 0.2]),
    ...     mass=np.array([1.0, 1.0]),
    ... )
    >>> box = {"x": (0, 4), "y": (0, 4)}
    >>> collision = bp.Scene(box=box, disks={"configuration": pair}, duration=1.0)
    >>> run = bp.simulate(collision, record="all")  # equal masses exchange their velocities
    >>> run.disks.velocity.sel(time=1, component="x", seed=0).values.tolist()
    [-1.0, 1.0]
    """

    position: np.ndarray  # (N, 2) float64 centres [length]
    velocity: np.ndarray | None  # (N, 2) float64 [length/time]; None: they are to be drawn
    radius: np.ndarray  # (N,) float64 [length]
    mass: np.ndarray  # (N,) float64 [mass]
    names: tuple[str, ...] = ()  # of K species, in the order of their first disks; () without names
    # (N,) int64, of each disk the index of its name; (0,) without names
    species_index: np.ndarray = np.zeros(0, np.int64)


def with_names(configuration: Configuration) -> Configuration:
    """Return a configuration of which every disk has the name of a species."""
    if configuration.names or not len(configuration.radius):
        return configuration
    kinds = np.stack([configuration.radius, configuration.mass], axis=1)
    kind_of_disk = in_order_of_appearance(np.unique(kinds, axis=0, return_inverse=True)[1])
    number = int(kind_of_disk.max()) + 1
    if number > MOST_KINDS:
        return configuration._replace(names=(ALL_DISKS,), species_index=np.zeros_like(kind_of_disk))
    names = tuple(f"kind-{k + 1}" for k in range(number))
    return configuration._replace(names=names, species_index=kind_of_disk)


def named(configuration: Configuration, name_of_disk: np.ndarray) -> Configuration:
    """Return a configuration whose disks have these names (N,) of species."""
    names = tuple(dict.fromkeys(name_of_disk.tolist()))
    species_index = in_order_of_appearance(name_of_disk)
    return configuration._replace(names=names, species_index=species_index)


def in_order_of_appearance(label: np.ndarray) -> np.ndarray:
    """Return labels (N,) int64 numbered in the order in which they first appear.

    >>> in_order_of_appearance(np.array([7, 7, 2, 7]))
    array([0, 0, 1, 0])
    """
    _, first, index = np.unique(label, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return rank[index.reshape(-1)]


def with_own_species(configuration: Configuration) -> Configuration:
    """Return a configuration of which disk 0 is the only one of the species `tracer`."""
    others = with_names(configuration)
    index = others.species_index
    remaining = np.unique(index[1:])
    names = tuple(others.names[k] for k in remaining if others.names[k] != TRACER)
    if len(names) < len(remaining):
        refuse(f"must have one disk at most of the species {TRACER}", "species")
    rank = np.zeros(len(others.names), np.int64)
    rank[remaining] = np.arange(1, len(remaining) + 1)
    species_index = rank[index]
    species_index[0] = 0
    return others._replace(names=(TRACER, *names), species_index=species_index)


def csv_text(configuration: Configuration) -> str:
    """Return a configuration as a table with a heading, every digit of its numbers."""
    titles = ["x", "y", "radius", "mass"]
    columns = [*configuration.position.T, configuration.radius, configuration.mass]
    if configuration.velocity is not None:
        titles += ["vx", "vy"]
        columns += [*configuration.velocity.T]
    texts = [[repr(value) for value in values.tolist()] for values in columns]
    if configuration.names:
        titles.append("species")
        texts.append([configuration.names[k] for k in configuration.species_index.tolist()])
    lines = [",".join(titles), *map(",".join, zip(*texts, strict=True))]
    return "\n".join(lines) + "\n"


# -- as keys of a scene ----------------------------------------------------------------------------


def _validated(value: object) -> Configuration:
    """Return a configuration that was handed in, or whose arrays are in the text of a scene."""
    if isinstance(value, Configuration):
        fields = value._asdict()
    elif isinstance(value, Mapping):
        fields = {name: _decoded(name, item) for name, item in value.items()}
    else:
        refuse("must be a brownpipe.Configuration")
    configuration = _with_types(fields)
    _check(configuration)
    return configuration


def _with_types(fields: Mapping[str, object]) -> Configuration:
    """Return the configuration of values by field, as arrays of their own, read-only."""
    lacking = [name for name in ("position", "radius", "mass") if fields.get(name) is None]
    if lacking:
        refuse(f"must have {', '.join(lacking)}")
    arrays: dict[str, np.ndarray] = {}
    for name in TYPES:
        value = fields.get(name)
        if value is None:
            continue
        array = _array_of_numbers(name, value)
        array.flags.writeable = False
        arrays[name] = array
    names = fields.get("names", ())
    if not isinstance(names, list | tuple):
        refuse(f"must be a list of names, not {names!r:.80}", "names")
    return Configuration(
        position=arrays["position"],
        velocity=arrays.get("velocity"),
        radius=arrays["radius"],
        mass=arrays["mass"],
        names=tuple(names),
        species_index=arrays.get("species_index", np.zeros(0, np.int64)),
    )


def _array_of_numbers(name: str, value: object) -> np.ndarray:
    """Return a copy of the value of a field as an array of its type.

    Refuses what NumPy would convert without a word: masked values, complex numbers, texts, dates.
    """
    _refuse_masked(name, value)
    wanted = "integers" if name == "species_index" else "numbers"
    kind = np.dtype(TYPES[name]).newbyteorder("=")
    try:
        numbers = np.asarray(value)
        are_real = _are_real(numbers)
        with np.errstate(invalid="ignore"):  # NaN as an integer
            array = numbers.astype(kind) if are_real else numbers
    except (TypeError, ValueError, OverflowError):
        refuse(f"must be an array of {wanted}", name)
    if not are_real:
        refuse(f"must be an array of {wanted}, not of {numbers.dtype.name}", name)
    is_rounded = np.ravel(array != numbers)
    if wanted == "integers" and is_rounded.any():
        disk = int(np.argmax(is_rounded))
        refuse(f"must be an array of integers, not {numbers.flat[disk]} (disk {disk})", name)
    return array


def _refuse_masked(name: str, value: object) -> None:
    """Refuse a masked array, or a list of them, of which some values are masked."""
    rows = value if isinstance(value, list | tuple | np.ma.MaskedArray) else ()
    for disk, row in enumerate(rows):
        if np.ma.is_masked(row):
            refuse(f"must have no masked values (disk {disk})", name)


def _are_real(numbers: np.ndarray) -> bool:
    """Return whether an array holds integers or floating-point numbers, perhaps as objects."""
    if numbers.dtype.kind != "O":
        return numbers.dtype.kind in "iuf"
    return all(isinstance(item, Real) and not isinstance(item, bool) for item in numbers.flat)


def _check(configuration: Configuration) -> None:
    """Refuse arrays whose shapes do not agree, or with numbers that no disk can have."""
    number = len(np.atleast_1d(configuration.radius))
    if not number:
        refuse("must have at least one disk")
    for name in TYPES:
        array = getattr(configuration, name)
        if array is None or (name == "species_index" and not configuration.names):
            continue
        shape = (number, 2) if name in ("position", "velocity") else (number,)
        if array.shape != shape:
            refuse(f"must be an array of shape {shape}, not {array.shape}", name)
        if not np.isfinite(array).all():
            disk = int(np.argwhere(~np.isfinite(array))[0, 0])
            refuse(f"must be finite, not {array[disk].tolist()} (disk {disk})", name)
    for name in ("radius", "mass"):
        array = getattr(configuration, name)
        if not array.min() > 0:
            disk = int(np.argmin(array))
            refuse(f"must be above 0, not {array[disk]:g} (disk {disk})", name)
    _check_names(configuration)


def _check_names(configuration: Configuration) -> None:
    """Refuse names that are none, and indices that do not number them by their first disks."""
    names = configuration.names
    if not names:
        if configuration.species_index.size:
            refuse("must be given with names", "species_index")
        return
    for name in names:
        if not isinstance(name, str) or not NAME.fullmatch(name):
            refuse(f"must be names of species, not {name!r:.80}", "names")
    index = configuration.species_index
    appearing = in_order_of_appearance(index)
    if len(set(names)) < len(names) or not np.array_equal(index, appearing):
        refuse("must be names that differ, in the order of their first disks", "names")
    if index.max() + 1 != len(names):
        refuse(f"must be {index.max() + 1} names, not {len(names)}", "names")


def _decoded(name: str, value: object) -> object:
    """Return an array of the text of a scene; other values as they are."""
    if name not in Configuration._fields:
        hint = did_you_mean(str(name), Configuration._fields)
        refuse(f"unknown key; {hint}allowed: {', '.join(Configuration._fields)}", name)
    if not isinstance(value, str):
        return value
    try:
        flat = np.frombuffer(base64.b64decode(value, validate=True), TYPES[name])
    except (KeyError, ValueError, binascii.Error):
        refuse("must be an array", name)
    return flat.reshape(-1, 2) if name in ("position", "velocity") else flat


def encoded(configuration: Configuration) -> dict[str, YamlValue]:
    """Return a configuration as keys of the text of a scene."""
    keys: dict[str, YamlValue] = {}
    for name, kind in TYPES.items():
        array = getattr(configuration, name)
        if array is not None and (name != "species_index" or configuration.names):
            keys[name] = base64.b64encode(array.astype(kind).tobytes()).decode()
    if configuration.names:
        keys["names"] = list(configuration.names)
    return keys


ConfigurationKey = Annotated[
    Configuration,
    PlainValidator(_validated),
    PlainSerializer(encoded, return_type=dict),
    WithJsonSchema({"type": "object"}),
]
