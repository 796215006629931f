"""YAML files (YAML 1.2, core schema), and values checked by pydantic: every refusal is one line.

It names the file, its line, the key, the allowed values and the value found.
"""

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn, TypeVar

import numpy as np
import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    TypeAdapter,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError, ValidationError, core_schema

from brownpipe.errors import RequestError
from brownpipe.text import shell_path

if TYPE_CHECKING:
    from typing_extensions import TypeForm

SYNONYMS = {
    "runs": ("seeds",),
    "n": ("particles", "count"),
    "number": ("particles", "count"),
    "kt": ("temperature",),
    "dt": ("time_step",),
}
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")

# -- YAML ------------------------------------------------------------------------------------------

NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
# .inf and .nan are no values
CONSTANTS = {"null": None, "~": None, "": None, "true": True, "false": False}
# all scalars are texts; tags mean nothing
LOADER = yaml.CBaseLoader if yaml.__with_libyaml__ else yaml.BaseLoader


# What YAML and JSON can hold, from a file or a program. Arrays are in configurations alone, which
# are tuples of them.
Scalar = None | bool | int | float | str
YamlValue = Scalar | np.ndarray | Sequence["YamlValue"] | Mapping[str, "YamlValue"]
Place = tuple[str | int, ...]  # keys and indices on the way to a value


class Document(dict[str, YamlValue]):
    """A mapping with the lines that it was read from."""

    # line (from 1) of each value's key or list item; 0: not in the file
    lines: Mapping[Place, int] = {}


def with_values(
    mapping: Mapping[str, YamlValue], values: Mapping[str, YamlValue], where: str = ""
) -> Document:
    """Return a mapping with other values of some keys, which may be paths like disks.tracer.mass;
    None: not given.

    Items of a list are found by their names: disks.species.bath.count. Raises RequestError for
    other paths, after the name of the file, `where`.
    """
    document = Document(deepcopy(dict(mapping)))
    new = {(path.split(".")[0],): 0 for path in values}
    lines = mapping.lines if isinstance(mapping, Document) else {}
    kept = {place: line for place, line in lines.items() if place[:1] not in new}
    document.lines = kept | new
    for path, value in values.items():
        *parents, last = path.split(".")
        if last == "count" and isinstance(value, float) and value.is_integer():
            value = int(value)
        try:
            section = part_of(document, parents)
            if not isinstance(section, dict):
                raise LookupError(last)
            section[last] = value
        except LookupError:
            allowed = (
                "must be a key like disks.tracer.mass, or disks.species.NAME.mass with the name "
                "of a species"
            )
            raise RequestError(": ".join(filter(None, (where, path, allowed)))) from None
    return document


def part_of(whole: YamlValue, words: Iterable[str]) -> YamlValue:
    """Return the part at a path of keys and names of list items, `disks.species.bath`; missing
    mappings are created, empty.

    Raises LookupError for other paths.
    """
    for word in words:
        if isinstance(whole, dict):
            whole = whole.setdefault(word, {})
        elif isinstance(whole, list | tuple):
            whole = _item_named(word, whole)
        else:
            raise LookupError(word)
    return whole


def _item_named(name: str, items: Sequence[YamlValue]) -> dict[str, YamlValue]:
    """Return the mapping with this name in a list. Raises LookupError if there is none."""
    for item in items:
        if isinstance(item, dict) and item.get("name") == name:
            return item
    raise LookupError(name)


def read_yaml(path: str | Path) -> Document:
    """Return the mapping in a YAML file, of dicts with str keys, lists, str, int, float, bool and
    None.

    Raises RequestError if the file cannot be read or is not such YAML.
    """
    lines: dict[Place, int] = {}
    text = ""
    try:
        text = Path(path).read_text("utf-8-sig")
        node = yaml.compose(text, LOADER)
        if node is None:
            raise ValueError("empty; must be a mapping of keys to values")
        mapping = _value(node, (), lines)
        if not isinstance(mapping, dict):
            raise ValueError("must be a mapping of keys to values")
        document = Document(mapping)
    except OSError as error:
        raise RequestError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise RequestError(
            f"{path}: not text; if it is an HDF5 file: brownpipe inspect {shell_path(path)}"
        ) from None
    except (ValueError, RecursionError) as error:
        raise RequestError(f"{path}: {error}") from None
    except yaml.YAMLError as error:
        raise RequestError(f"{path}: {_yaml_problem(error, text)}") from None
    document.lines = lines
    return document


def _yaml_problem(error: yaml.YAMLError, text: str) -> str:
    """Return the line at which a text is not YAML, if it is known, and what is wrong there."""
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", "a character that is not allowed").removeprefix("but ")
    if mark is None:
        return f"not valid YAML: {problem}"
    marked = text.split("\n")[mark.line : mark.line + 1]  # none behind the last line
    if any(line[mark.column :].startswith("\t") for line in marked):
        problem = "a tab; YAML indents by spaces"
    return f"line {mark.line + 1}: not valid YAML: {problem}"


def _value(node: yaml.Node, path: Place, lines: dict[Place, int]) -> YamlValue:
    """Return the value of a node, and add the lines of it and of all in it to `lines`."""
    lines.setdefault(path, node.start_mark.line + 1)
    if isinstance(node, yaml.ScalarNode):
        return node.value if node.style else scalar(node.value)
    if isinstance(node, yaml.SequenceNode):
        return [_value(item, (*path, k), lines) for k, item in enumerate(node.value)]
    mapping: dict[str, YamlValue] = {}
    for key_node, item in node.value:
        key = key_node.value
        line = key_node.start_mark.line + 1
        if not isinstance(key, str) or key in mapping:
            raise ValueError(f"line {line}: key {key!r:.80}: must be a plain word, and given once")
        lines[*path, key] = line
        mapping[key] = _value(item, (*path, key), lines)
    return mapping


def scalar(text: str) -> Scalar:
    """Return the value of a plain scalar: None, bool, int, float, otherwise str. (010 is 10.)"""
    if not NUMBER.fullmatch(text):
        return CONSTANTS.get(text.lower(), text)
    return int(text) if text.lstrip("+-").isdigit() else float(text)


def value_in(text: str) -> YamlValue:
    """Return the value of a key in YAML, a list or mapping in brackets; what is not such YAML is a
    text.
    """
    with suppress(ValueError, RecursionError, yaml.YAMLError):
        if text.startswith(("[", "{")):
            node = yaml.compose(text, LOADER)
            if node is not None:
                return _value(node, (), {})
        return scalar(text)
    return text


class Dumper(yaml.SafeDumper):
    """Writes YAML 1.1, with quotes around texts that are numbers in YAML 1.2 alone: a name 089."""


def _text_node(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    style = None if isinstance(scalar(text), str) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


Dumper.add_representer(str, _text_node)


def yaml_text(mapping: Mapping[str, YamlValue]) -> str:
    """Return the text of a YAML file with these keys in their order, as `read_yaml` reads it;
    innermost lists and mappings are in brackets.
    """
    return yaml.dump(
        mapping,
        Dumper=Dumper,
        sort_keys=False,
        width=120,
        default_flow_style=None,
        allow_unicode=True,
    )


def write_yaml(path: Path, mapping: Mapping[str, YamlValue]) -> None:
    """Write a YAML file with these keys, unless there is one that has them already.

    Raises RequestError for a file with other contents, which is left as it is, and if the file
    cannot be written.
    """
    write_text(path, yaml_text(mapping))


def refuse_other_text(path: Path, text: str) -> None:
    """Raise RequestError for a file that is there and has other contents than this text."""
    if path.exists() and path.read_bytes() != text.encode():
        raise RequestError(f"{path}: exists; delete it, or choose another name")


def write_text(path: Path, text: str) -> None:
    """Write a text file, unless there is one of these contents already.

    Raises RequestError for a file with other contents, which is left as it is, and if the file
    cannot be written.
    """
    try:
        if path.exists() and path.read_bytes() == text.encode():
            return
        with path.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except FileExistsError:
        raise RequestError(f"{path}: exists; delete it, or choose another name") from None
    except OSError as error:
        raise RequestError(f"{path}: cannot be written: {error.strerror}") from None


# -- types of values -------------------------------------------------------------------------------

NO_MINUS_ZERO = AfterValidator(lambda value: value + 0.0)
Number = Annotated[float, Field(strict=True, allow_inf_nan=False), NO_MINUS_ZERO]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0), NO_MINUS_ZERO]
Pair = tuple[Number, Number]
Integer = Annotated[int, Field(strict=True)]
SeedNumber = Annotated[int, Field(strict=True, ge=0)]
AtLeastOne = Annotated[int, Field(strict=True, ge=1)]
Count = Annotated[int, Field(strict=True, ge=0, le=10_000_000)]
Name = Annotated[str, Field(pattern=f"^{NAME.pattern}$")]
T = TypeVar("T")


def _nullable(kind: object, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
    return core_schema.nullable_schema(handler(kind))


# A key that may be left out, as its default follows from other keys: a validated section has it.
Resolved = Annotated[T, GetPydanticSchema(_nullable)]


class Section(BaseModel):
    """A section of a scene or study file: a mapping with these keys, such as `box` or `velocities`.

    A key whose value is null is taken as not given.
    """

    model_config = {"frozen": True, "extra": "forbid"}

    @classmethod
    @cache
    def _allowed_keys(cls) -> tuple[str, ...]:
        return tuple(field.alias or name for name, field in cls.model_fields.items())

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, value: object) -> object:
        keys = cls._allowed_keys()
        if not isinstance(value, Mapping):
            raise PydanticCustomError(
                "section_type", f"must be a mapping with the keys {', '.join(keys)}"
            )
        for key in value:
            if key not in keys:
                hint = did_you_mean(str(key), keys)
                if str(key).isdigit():
                    hint = "a number has a decimal point; "
                refuse(f"unknown key; {hint}allowed: {', '.join(keys)}", key)
        return {key: item for key, item in value.items() if item is not None}

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse a new value of a key: another scene is made with it. Private attributes are no
        keys.
        """
        if name in self.__private_attributes__:
            super().__setattr__(name, value)
            return
        self._refuse_new_value(name, value)

    def _refuse_new_value(self, name: str, value: object) -> NoReturn:
        paths = 'scene.replace with the path of the key, as in {"disks.tracer.mass": 3.0}'
        raise RequestError(f"{name}: cannot be changed; {paths}, returns another scene")

    def _resolve(self, **values: object) -> None:
        """Set keys whose defaults follow from other keys; they do not count as given."""
        self.__dict__.update(values)


def key(meaning: str, default: Any = ..., **more: Any) -> Any:
    """Return the field of a section: what it means, and its default unless it must be given."""
    return Field(default, description=meaning, **more)


def alone(name: str, schema: object) -> BeforeValidator:
    """Let the value of one key stand for a mapping with this key alone, as `equilibrate: 5` for
    `equilibrate: {time: 5}`; `schema` is the type of both.
    """

    def as_mapping(value: object) -> Mapping[str, object]:
        return value if isinstance(value, Mapping) else {name: value}

    return BeforeValidator(as_mapping, json_schema_input_type=schema)


def As(kind: object) -> GetPydanticSchema:  # noqa: N802  # stands in annotations, like a type
    """Let values be read as this type, which is made at run time: `Annotated[tuple[str, ...],
    As(Names)]` is a tuple for mypy, and `Names` for pydantic.
    """
    return GetPydanticSchema(lambda _, handler: handler.generate_schema(kind))


def choice_of(names: Iterable[str]) -> "TypeForm[str]":
    """Return the type of a text that is one of these."""
    choice: Any = Literal[tuple(names)]
    return choice


def plain(value: Any) -> Any:
    """Return a value as a YAML file would give it: lists and mappings of Python's numbers instead
    of NumPy's.

    A section becomes the mapping of its given keys. A record, such as a configuration, is left as
    it is.
    """
    if isinstance(value, tuple) and type(value) is not tuple:
        return value
    if isinstance(value, Section):
        value = value.model_dump(exclude_unset=True)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | range | set | frozenset):
        return [plain(item) for item in value]
    return value


def without_none(mapping: Mapping[str, T | None]) -> dict[str, T]:
    """Return the keys of a mapping that have a value."""
    return {key: value for key, value in mapping.items() if value is not None}


# -- refusals --------------------------------------------------------------------------------------

# by pydantic's names of errors, with the context that comes with them; others as pydantic words
# them
PROBLEMS = {
    "missing": "missing; must be given",
    "union_tag_not_found": "must have the key {discriminator}",
    "union_tag_invalid": "must be {expected_tags}",
    "bool_type": "must be true or false",
    "string_pattern_mismatch": (
        "must be a name: letters, digits, '.', '_', '-', first a letter or digit, at most 64"
    ),
    "path_type": "must be the path of a file",
    "tuple_type": "must be a list",
    "too_short": "must be a list of at least {min_length}",
    "too_long": "must be a list of at most {max_length}",
}


def refuse(problem: str, *path: str | int) -> NoReturn:
    """Refuse, within a validator, the value at a path of keys and indices, relative to the
    validated value.
    """
    raise PydanticCustomError("refused", "{problem}", {"problem": problem, "path": path})


def validated(
    kind: "TypeForm[T]", value: object, file: str = "", key: str = "", context: object = None
) -> T:
    """Return a value as `kind`, a type that pydantic knows. Raises RequestError, naming the file
    and the key.

    It names the line, too, if the value is from a `Document`; for a missing key that of the mapping
    that lacks it.
    """
    try:
        return _adapter(kind).validate_python(value, context=context)
    except ValidationError as error:
        path, problem = _place_and_problem(error, value)
    line = _line_of(path, value.lines if isinstance(value, Document) else {})
    if file and line is not None:
        file += f": line {line}" if line else " (replaced)"
    place = _path_in_words((key, *path))
    raise RequestError(": ".join(filter(None, (file, place, problem)))) from None


# pydantic's validator of a type; that of `SceneName` takes 0.1 ms to make
_adapter: Callable[[object], TypeAdapter] = lru_cache(maxsize=256)(TypeAdapter)


def _line_of(path: Sequence[str | int], lines: Mapping[Place, int]) -> int | None:
    """Return the line of the value at a path or, for a missing one, of the innermost mapping around
    it.
    """
    for length in range(len(path), -1, -1):
        place = tuple(path[:length])
        if place in lines:
            return lines[place]
    return None


def _path_in_words(path: Iterable[str | int]) -> str:
    """Return a path of keys and indices as one writes it: disks.species[0].mass."""
    words = (f"[{word}]" if isinstance(word, int) else f".{word}" for word in path if word != "")
    return "".join(words).removeprefix(".")


def _place_and_problem(refusal: ValidationError, value: object) -> tuple[list[str | int], str]:
    """Return the path of a refused value, and what is wrong with it: the first of the most deeply
    nested errors.

    A value that may be of several types has an error for each of them.
    """
    errors = refusal.errors(include_url=False)
    paths = [_path(error, value) for error in errors]
    path = max(paths, key=len)
    here = [error for error, place in zip(errors, paths, strict=True) if place == path]
    first = here[0]
    problem = " or ".join(dict.fromkeys(map(_problem, here)))
    problem = re.sub(r"\w+ should", "must", problem).replace(" or must be ", " or ")
    if first["type"] == "refused":
        return path, problem
    if first["type"] != "missing":
        refused = first.get("ctx", {}).get("tag", first["input"])
        return path, f"{problem}, not {refused!r:.80}"
    missing = []  # other missing keys of the same mapping
    for error, place in zip(errors, paths, strict=True):
        if error["type"] == "missing" and place != path and place[:-1] == path[:-1]:
            missing.append(str(place[-1]))
    if missing:
        problem += f", and so must {' and '.join(dict.fromkeys(missing))}"
    return path, problem


def _problem(error: ErrorDetails) -> str:
    """Return what is wrong in the words of PROBLEMS, otherwise in pydantic's."""
    words = PROBLEMS.get(error["type"], "{msg}")
    return words.format(msg=error["msg"], **error.get("ctx", {}))


def _path(error: ErrorDetails, value: Any) -> list[str | int]:
    """Return where in a value an error is: its place without the names of types that pydantic puts
    in between.
    """
    path: list[str | int] = []
    for word in error["loc"]:
        with suppress(LookupError, TypeError):
            value = value[word]
            path.append(word)
    if error["type"] == "missing" and value is not None:
        path += error["loc"][-1:]
    path += error.get("ctx", {}).get("path", ())
    return path


def did_you_mean(word: str, options: Sequence[str]) -> str:
    """Return a question about the most similar option, "" if none is similar."""
    lower = word.lower()
    similar = difflib.get_close_matches(lower, options, n=1)
    for name in (*SYNONYMS.get(lower, ()), *similar):
        if name in options:
            return f"did you mean {name}? "
    return ""
