"""Strict reading of YAML 1.2 (core schema), and the lines at which values stand.

Every refusal is one line that names the file, its line and the problem. Files may have mappings, lists and scalars.
Further features of YAML (anchors, aliases, tags, merge keys, several documents) are refused, and so is any text that
two programs may read differently (duplicate keys, numbers with leading zeros).
"""

import math
import os
import re
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import Any, NoReturn

import yaml

from brownpipe.errors import RequestError
from brownpipe.opening import read_ordinary
from brownpipe.quoting import shell_path

HDF5 = b"\x89HDF"  # the first bytes of an HDF5 file
DEEPEST = 10  # levels of nesting; a scene needs 4
LONGEST_NUMBER = 64  # characters
LONGEST_SHOWN = 80  # characters of a value in a message
NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|0o[0-7]+|0x[0-9a-fA-F]+")
WORDS = dict.fromkeys(("", "~", "null", "Null", "NULL"))
WORDS |= {word: word[0] in "tT" for word in ("true", "True", "TRUE", "false", "False", "FALSE")}
WORDS |= {sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")}
WORDS |= dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan)


class Document(dict[str, object]):
    """A mapping with the text that it was read from."""

    text = ""


def read_yaml(path: str | Path, most_bytes: int) -> object:
    """Return the contents of a YAML file as dicts with str keys, lists, str, int, float, bool and None.

    A mapping is returned as a `Document`.

    Raises RequestError if the file cannot be read, is larger than `most_bytes`, or is not strict YAML.
    """
    text = _text(path, most_bytes)
    try:
        value = _document(str(path), _events(text))
    except yaml.YAMLError as error:
        raise RequestError(f"{path}: {_why_not_yaml(error, text)}") from None
    if isinstance(value, dict):
        value = Document(value)
        value.text = text
    return value


def _events(text: str) -> Iterator[yaml.Event]:
    """Yield the events of the parser, the first of which is the start of the stream."""
    return yaml.parse(text, Loader=yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader)


def _why_not_yaml(error: yaml.YAMLError, text: str) -> str:
    """Return the line and the problem of a text that cannot be parsed, common ones in words."""
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be parsed"
    line = text.splitlines()[mark.line] if mark and mark.line < len(text.splitlines()) else ""
    if problem == "could not find expected ':'":
        mark, problem = error.context_mark, "must be KEY: VALUE, with a blank after the colon"  # type: ignore[attr-defined]
    elif "cannot start any token" in problem and "\t" in line[: mark.column + 1]:
        problem = "a tab; must be blanks"
    elif problem == "did not find expected key":
        problem = "a key is expected here; is the line indented like the others?"
    return f"{f'line {mark.line + 1}: ' if mark else ''}not valid YAML: {problem}"


def _text(path: str | Path, most_bytes: int) -> str:
    """Return the text of an ordinary file in UTF-8, without reading more than most_bytes + 1."""
    try:
        data = read_ordinary(path, most_bytes + 1)
    except OSError as error:
        hint = f"; did you mean {Path(path).name}.yaml?" if os.path.isfile(f"{path}.yaml") else ""
        raise RequestError(f"{path}: cannot be read: {error.strerror}{hint}") from None
    except ValueError as error:  # a file name that no system allows
        raise RequestError(f"{str(path)!r}: cannot be read: {error}") from None
    if data.startswith(HDF5):
        command = f"brownpipe inspect {shell_path(path)}"
        raise RequestError(f"{path}: not text: byte 0 is not UTF-8; it is an HDF5 file: {command}")
    if len(data) > most_bytes:
        raise RequestError(f"{path}: larger than {most_bytes / 2**20:g} MiB, the most that is read")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RequestError(f"{path}: not text: byte {error.start} is not UTF-8; save it in UTF-8") from None


def _document(file: str, events: Iterator[yaml.Event]) -> object:
    """Return the value of the only document in a stream of parser events."""
    next(events)  # the start of the stream
    if isinstance(next(events), yaml.StreamEndEvent):
        raise RequestError(f"{file}: empty; must be a mapping of keys to values")
    value = _value(file, events, next(events), 1)
    next(events)  # the end of the document
    if not isinstance(next(events), yaml.StreamEndEvent):
        raise RequestError(f"{file}: more than one YAML document; must be one")
    return value


def _value(file: str, events: Iterator[yaml.Event], event: Any, depth: int) -> object:
    """Return the value that begins with `event`; a list or mapping takes its parts from the following `events`.

    `event` is an alias or the beginning of a scalar, list or mapping; these classes differ in their attributes.
    """
    if event.anchor is not None:
        _refuse_line(file, event, "anchors (&name) and aliases (*name) are not allowed; write the value out")
    if event.tag is not None:
        _refuse_line(file, event, f"the tag {event.tag:.{LONGEST_SHOWN}} is not allowed; write a plain value")
    if depth > DEEPEST:
        _refuse_line(file, event, f"nested more than {DEEPEST} levels deep")
    if isinstance(event, yaml.ScalarEvent):
        try:
            return scalar(event.value) if event.implicit[0] else event.value
        except ValueError as problem:
            _refuse_line(file, event, str(problem))
    if isinstance(event, yaml.SequenceStartEvent):
        values = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            values.append(_value(file, events, event, depth + 1))
        return values
    mapping: dict[str, object] = {}
    while not isinstance(event := next(events), yaml.MappingEndEvent):
        key = _key(file, event, mapping)
        mapping[key] = _value(file, events, next(events), depth + 1)
    return mapping


def _key(file: str, event: yaml.Event, mapping: dict) -> str:
    """Return a key that the mapping does not have yet."""
    if not isinstance(event, yaml.ScalarEvent) or event.anchor is not None or event.tag is not None:
        _refuse_line(file, event, "a key must be a plain word")
    if event.value in mapping:
        cure = "a list has brackets: [low, high]" if event.value.endswith(")") else "must be given once"
        _refuse_line(file, event, f"duplicate key {shown(event.value)}; {cure}")
    return event.value


def scalar(text: str) -> object:
    """Return the value of a plain scalar by the core schema: None, bool, int, float, otherwise str.

    Raises ValueError for a number that other programs may read differently, or that is too long or too large.
    """
    if text in WORDS:
        return WORDS[text]
    if not NUMBER.fullmatch(text):
        return text
    if re.match(r"[-+]?0[0-9]", text):
        raise ValueError(f"{text[:LONGEST_NUMBER]}: a number must not start with a superfluous zero")
    if len(text) > LONGEST_NUMBER:
        raise ValueError(f"a number of {len(text)} characters; must be at most {LONGEST_NUMBER}")
    if text[:2] in ("0o", "0x"):
        return int(text, 0)
    if text.lstrip("+-").isdigit():
        return int(text)
    if math.isinf(float(text)):
        raise ValueError(f"{text}: must be a finite number, below 1.8e308")
    return float(text)


def _refuse_line(file: str, event: yaml.Event, problem: str) -> NoReturn:
    raise RequestError(f"{file}: line {event.start_mark.line + 1}: {problem}")


def shown(value: object) -> str:
    """Return the value as in YAML, on one line and shortened."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple) and len(value) > 4:
        return f"a list of {len(value)}"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    text = repr(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


def line_in(text: str, path: Sequence[str | int | None], is_missing: bool) -> int | None:
    """Return the line, from 1, at which the value at a path of keys and indices begins: its key, or its item of a list.

    If the value `is_missing`, that of the mapping which should have it; None if it is not there otherwise.
    """
    events = _events(text)
    next(events), next(events)  # the starts of the stream and the document
    event: Any = next(events)
    line = event.start_mark.line + 1
    for part in path:
        is_mapping = isinstance(event, yaml.MappingStartEvent)
        if not isinstance(event, yaml.CollectionStartEvent) or is_mapping != isinstance(part, str):
            break  # it stands for a mapping or list
        for index in count():
            name: Any = next(events)  # of the item: its key, in a list its value
            if isinstance(name, yaml.CollectionEndEvent):
                return line if is_missing else None
            event = next(events) if is_mapping else name
            if part == (name.value if is_mapping else index):
                line = name.start_mark.line + 1
                break
            _skip(events, event)
    return line


def _skip(events: Iterator[yaml.Event], event: yaml.Event) -> None:
    """Take the rest of the value that begins with `event` from the following events."""
    depth = int(isinstance(event, yaml.CollectionStartEvent))
    while depth:
        event = next(events)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)


def yaml_text(mapping: dict, in_blocks: bool = False) -> str:
    """Return the text of a YAML file from which `read_yaml` returns an equal mapping; the keys keep their order.

    Innermost lists and mappings are in brackets, and the text is ASCII. If `in_blocks`, each of their items has a line
    of its own, and other characters are written as they are.
    """
    layout: dict[str, Any] = {"default_flow_style": False if in_blocks else None, "allow_unicode": in_blocks}
    return yaml.dump(mapping, Dumper=_Dumper, sort_keys=False, width=120, **layout)


class _Dumper(yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper):  # type: ignore[misc]  # one of the two
    """Writes YAML; texts that are numbers in YAML 1.2 are put in quotes, like those of YAML 1.1."""


_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(f"(?:{NUMBER.pattern})$"), [*"+-.0123456789"])
