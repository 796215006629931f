"""YAML 1.2 (core schema), read and written, and the lines at which values stand."""

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from brownpipe.errors import RequestError
from brownpipe.quoting import shell_path

NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
WORDS = dict.fromkeys(("", "~", "null", "Null", "NULL"))
WORDS |= {word: word[0] in "tT" for word in ("true", "True", "TRUE", "false", "False", "FALSE")}
WORDS |= {sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")}
WORDS |= dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan)
LOADER = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader


class Document(dict[str, object]):
    """A mapping with the lines that it was read from, of which some keys may be replaced by other values."""

    lines: Mapping[tuple[str | int, ...], int] = {}  # from 1, of each value by its path of keys and indices
    replaced: tuple[str, ...] = ()

    def with_values(self, values: dict[str, Any]) -> "Document":
        """Return the mapping with other values of some keys; a key of value None is left out."""
        document = Document({key: value for key, value in {**self, **values}.items() if value is not None})
        document.lines, document.replaced = self.lines, tuple(values)
        return document

    def line_of(self, path: Sequence[str | int]) -> int | None:
        """Return the line of a value: of its key, or of its item in a list.

        That of the mapping that lacks it if it is missing; None if it is not from the text.
        """
        if path and path[0] in self.replaced:
            return None
        parts = (tuple(path[:length]) for length in range(len(path), -1, -1))
        return next((self.lines[part] for part in parts if part in self.lines), None)


def read_yaml(path: str | Path) -> Any:
    """Return the contents of a YAML file as dicts with str keys, lists, str, int, float, bool and None.

    A mapping is returned as a `Document`. Raises RequestError if the file cannot be read or is not such YAML.
    """
    try:
        lines: dict[tuple[str | int, ...], int] = {}
        events = yaml.parse(Path(path).read_text("utf-8-sig"), Loader=LOADER)
        next(events)  # the start of the stream
        if isinstance(next(events), yaml.StreamEndEvent):
            raise ValueError("empty; must be a mapping of keys to values")
        value, _ = _value(events, next(events), (), lines), next(events)  # the end of the document
        if not isinstance(next(events), yaml.StreamEndEvent):
            raise ValueError("more than one YAML document; must be one")
    except OSError as error:
        hint = f"; did you mean {Path(path).name}.yaml?" if os.path.isfile(f"{path}.yaml") else ""
        raise RequestError(f"{path}: cannot be read: {error.strerror}{hint}") from None
    except UnicodeDecodeError as error:
        cure = f"if it is an HDF5 file: brownpipe inspect {shell_path(path)}"
        raise RequestError(f"{path}: not text: byte {error.start} is not UTF-8; {cure}") from None
    except (ValueError, RecursionError) as error:
        raise RequestError(f"{path}: {error}") from None
    except yaml.YAMLError as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
        line = f"line {mark.line + 1}: " if mark else ""
        problem = (problem or "a character that is not allowed").replace("found char", "found a tab or another char")
        raise RequestError(f"{path}: {line}not valid YAML: {problem}") from None
    if isinstance(value, dict):
        value = Document(value)
        value.lines = lines
    return value


def _value(events: Iterator[Any], event: Any, path: tuple[str | int, ...], lines: dict) -> object:
    """Return the value that begins with `event`, and add its line and those of all in it to `lines`.

    A list or mapping takes its parts from the following `events`.
    """
    lines.setdefault(path, event.start_mark.line + 1)
    if event.anchor is not None or event.tag is not None:
        raise ValueError(f"line {event.start_mark.line + 1}: anchors, aliases and tags are not allowed")
    if isinstance(event, yaml.ScalarEvent):
        return scalar(event.value) if event.implicit[0] else event.value
    if isinstance(event, yaml.SequenceStartEvent):
        values: list[object] = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            values.append(_value(events, event, (*path, len(values)), lines))
        return values
    mapping: dict[str, object] = {}
    while not isinstance(event := next(events), yaml.MappingEndEvent):
        key = getattr(event, "value", None)
        if key is None or key in mapping:
            problem = "a key must be a plain word" if key is None else f"duplicate key {key!r}; must be given once"
            raise ValueError(f"line {event.start_mark.line + 1}: {problem}")
        lines[*path, key] = event.start_mark.line + 1
        mapping[key] = _value(events, next(events), (*path, key), lines)
    return mapping


def scalar(text: str) -> object:
    """Return the value of a plain scalar: None, bool, int, float, otherwise str. (010 is 10.)"""
    if text in WORDS:
        return WORDS[text]
    if not NUMBER.fullmatch(text):
        return text
    return int(text) if text.lstrip("+-").isdigit() else float(text)


def yaml_text(mapping: dict) -> str:
    """Return the text of a YAML file from which `read_yaml` returns an equal mapping; the keys keep their order.

    Innermost lists and mappings are in brackets.
    """
    return yaml.dump(mapping, Dumper=_Dumper, sort_keys=False, width=120, default_flow_style=None, allow_unicode=True)


class _Dumper(yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper):  # type: ignore[misc]  # one of the two
    """Writes YAML; texts that are numbers in YAML 1.2 are put in quotes, like those of YAML 1.1."""


_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(f"(?:{NUMBER.pattern})$"), [*"+-.0123456789"])
_Dumper.add_representer(Document, yaml.SafeDumper.represent_dict)
