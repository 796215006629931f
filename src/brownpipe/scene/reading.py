"""Strict reading of YAML 1.2 (core schema), and checked access to the values.

Every refusal is one line that names the file, its line, the key, the value and the allowed values. Files may have
mappings, lists and scalars. Further features of YAML (anchors, aliases, tags, merge keys, several documents) are
refused, and so is any text that two programs may read differently (duplicate keys, numbers with leading zeros).
"""

import difflib
import math
import os
import re
import sys
from collections.abc import Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import yaml

from brownpipe.errors import RequestError
from brownpipe.opening import read_ordinary
from brownpipe.quoting import printable, shell_path

_HDF5 = b"\x89HDF"  # the first bytes of an HDF5 file
_DEEPEST = 10  # levels of nesting; a scene needs 4
_MOST_VALUES = 100_000  # of a key on a command line, whose words have at most 131,072 characters
_LONGEST_NUMBER = 64  # characters
_LONGEST_SHOWN = 80  # characters of a value in a message
_LONGEST_TEXT = 240  # characters of a part of a message
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|0o[0-7]+|0x[0-9a-fA-F]+")
_LIST = "a list has brackets: [{}]"
_SYNONYMS = {"runs": ["seeds"], "n": ["particles"], "kt": ["temperature"], "dt": ["time_step", "sample_interval"]}
_WORDS = dict.fromkeys(("", "~", "null", "Null", "NULL"))
_WORDS |= {word: word[0] in "tT" for word in ("true", "True", "TRUE", "false", "False", "FALSE")}
_WORDS |= {sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")}
_WORDS |= dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan)


# -- the file -------------------------------------------------------------------------------------------------------


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
    if data.startswith(_HDF5):
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
        _refuse_line(file, event, f"the tag {event.tag:.{_LONGEST_SHOWN}} is not allowed; write a plain value")
    if depth > _DEEPEST:
        _refuse_line(file, event, f"nested more than {_DEEPEST} levels deep")
    if isinstance(event, yaml.ScalarEvent):
        try:
            return _scalar(event.value) if event.implicit[0] else event.value
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
        _refuse_line(file, event, f"duplicate key {_shown(event.value)}; {cure}")
    return event.value


def _scalar(text: str) -> object:
    """Return the value of a plain scalar by the core schema: None, bool, int, float, otherwise str.

    Raises ValueError for a number that other programs may read differently, or that is too long or too large.
    """
    if text in _WORDS:
        return _WORDS[text]
    if not _NUMBER.fullmatch(text):
        return text
    if re.match(r"[-+]?0[0-9]", text):
        raise ValueError(f"{text[:_LONGEST_NUMBER]}: a number must not start with a superfluous zero")
    if len(text) > _LONGEST_NUMBER:
        raise ValueError(f"a number of {len(text)} characters; must be at most {_LONGEST_NUMBER}")
    if text[:2] in ("0o", "0x"):
        return int(text, 0)
    if text.lstrip("+-").isdigit():
        return int(text)
    if math.isinf(float(text)):
        raise ValueError(f"{text}: must be a finite number, below 1.8e308")
    return float(text)


def _refuse_line(file: str, event: yaml.Event, problem: str) -> NoReturn:
    raise RequestError(f"{file}: line {event.start_mark.line + 1}: {problem}")


def yaml_text(mapping: dict) -> str:
    """Return the text of a YAML file from which `read_yaml` returns an equal mapping; the keys keep their order."""
    return yaml.dump(mapping, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=120)


class _Dumper(yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper):  # type: ignore[misc]  # one of the two
    """Writes YAML; texts that are numbers in YAML 1.2 are put in quotes, like those of YAML 1.1."""


_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(f"(?:{_NUMBER.pattern})$"), [*"+-.0123456789"])


# -- values -----------------------------------------------------------------------------------------------------


class Origin(NamedTuple):
    """The text of a file, in which messages look up the line of a value."""

    text: str
    keys: Mapping[
        str, str | None
    ] = {}  # at its head, if another one than in paths; None: the value is not from the text


class Entry(NamedTuple):
    """A value with its file and key, which every message about it names."""

    value: object
    file: str
    path: tuple[str | int, ...] = ()  # ("disks", 3, "radius") is disks[3].radius
    origin: Origin | None = None

    def part(self, key: str | int, value: object) -> "Entry":
        """Return the entry of a value in this mapping or list."""
        return self._replace(value=value, path=(*self.path, key))

    @property
    def key(self) -> str:
        """The key as messages show it, disks[3].radius."""
        return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in self.path).lstrip(".")


def whole(mapping: object, file: str) -> Entry:
    """Return the entry of all that a file contains; for a `Document`, messages name lines, too."""
    return Entry(mapping, file, (), Origin(mapping.text) if isinstance(mapping, Document) else None)


def _line_of(entry: Entry) -> int | None:
    """Return the line, from 1, where the key of an entry or its item of a list begins; of a missing key, its mapping.

    None for a value that is not from a text. Looked up by parsing the text again, as only refusals need it.
    """
    if entry.origin is None:
        return None
    head: tuple[str | int | None, ...] = entry.path[:1]
    if head:
        head = (entry.origin.keys.get(str(head[0]), head[0]),)
    if None in head:
        return None
    events = _events(entry.origin.text)
    next(events), next(events)  # the starts of the stream and the document
    event: Any = next(events)
    line = event.start_mark.line + 1
    for part in (*head, *entry.path[1:]):
        is_mapping = isinstance(event, yaml.MappingStartEvent)
        if not isinstance(event, yaml.CollectionStartEvent) or is_mapping != isinstance(part, str):
            break  # it stands for a mapping or list
        for index in count():
            name: Any = next(events)  # of the item: its key, in a list its value
            if isinstance(name, yaml.CollectionEndEvent):
                return line if entry.value is None else None
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


def with_types(entry: Entry) -> object:
    """Return a value with every text in it, at any depth, read as a plain scalar of YAML.

    Raises RequestError for what files may not have either: some numbers, and deep nesting.
    """
    if len(entry.path) > _DEEPEST:
        refuse(entry._replace(path=entry.path[:1]), f"nested more than {_DEEPEST} levels deep")
    if isinstance(entry.value, dict):
        return {key: with_types(entry.part(key, value)) for key, value in entry.value.items()}
    if isinstance(entry.value, list):
        return [with_types(item) for item in items(entry)]
    try:
        return _scalar(entry.value) if isinstance(entry.value, str) else entry.value
    except ValueError as problem:
        refuse(entry, str(problem))


def refuse_huge(entry: Entry) -> None:
    """Refuse a value with more than _MOST_VALUES values in it, as aliases (*name) make of a short text."""
    waiting, number_of_values = [entry.value], 0
    while waiting:
        value = waiting.pop()
        parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        number_of_values += len(parts)
        if number_of_values > _MOST_VALUES:
            refuse(entry, f"more than {_MOST_VALUES} values; aliases (*name) are not allowed, write the value out")
        waiting.extend(parts)


def refuse(entry: Entry, problem: str, at: Entry | None = None) -> NoReturn:
    """Raise RequestError with file, line, key and problem; the line is that of `at`, if it is given."""
    line = _line_of(at or entry)
    place = "" if line is None else f"line {line}"
    raise RequestError(": ".join(part for part in (entry.file, place, entry.key, problem) if part))


def must_be(entry: Entry, allowed: str, hint: str = "") -> NoReturn:
    """Raise RequestError with file, key, the allowed values, the value, and a hint that follows it."""
    refuse(entry, f"must be {allowed}, not {_shown(entry.value)}{hint}")


def fields(entry: Entry, required: tuple[str, ...], optional: dict[str, object] | None = None) -> dict[str, Entry]:
    """Return the entries of a mapping by key, with defaults for optional keys; refuse unknown and missing keys."""
    allowed = (*required, *(optional or {}))
    if not isinstance(entry.value, dict):
        wanted = f"a mapping with the keys {', '.join(allowed)}"
        if not entry.path and isinstance(entry.value, str):  # maybe a wrong file, whose text is no business of ours
            refuse(entry, f"must be {wanted}, not a text")
        must_be(entry, wanted)
    for key, value in entry.value.items():
        if key not in allowed:
            hint = "a number has a decimal point; " if key.isdigit() else _did_you_mean(key, allowed)
            problem = f"unknown key {_shown(key)}; {hint}allowed: {', '.join(allowed)}"
            refuse(entry, problem, at=entry.part(key, value))
    for key in required:
        if key not in entry.value:
            refuse(entry.part(key, None), "missing; must be given")
    return {key: entry.part(key, value) for key, value in ((optional or {}) | entry.value).items()}


def items(entry: Entry, length: int | None = None, what: str = "a list") -> list[Entry]:
    """Return the entries of a list, of `length` if given; `what` says in the refusal what is allowed."""
    if not isinstance(entry.value, list | tuple) or length not in (None, len(entry.value)):
        must_be(entry, what)
    return [entry.part(index, value) for index, value in enumerate(entry.value)]


def number(entry: Entry, above: float | None = None, least: float | None = None) -> float:
    """Return a finite float, > `above` and >= `least` if given. (-0.0 becomes 0.0.)"""
    value = entry.value
    bound = f" > {above:g}" if above is not None else f" >= {least:g}" if least is not None else ""
    if isinstance(value, bool) or not isinstance(value, int | float):
        must_be(entry, f"a finite number{bound}", _number_hint(value))
    try:
        value = float(value) + 0.0
    except OverflowError:
        value = math.inf
    fits = math.isfinite(value) and (above is None or value > above) and (least is None or value >= least)
    return value if fits else must_be(entry, f"a finite number{bound}")


def integer(entry: Entry, least: int, most: int, otherwise: str = "") -> int:
    """Return an int from `least` to `most`; `otherwise` adds further allowed values to the refusal."""
    value = entry.value
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        must_be(entry, f"an integer from {least} to {most}{otherwise}", _integer_hint(value))
    return value


def flag(entry: Entry) -> bool:
    """Return a bool."""
    return entry.value if isinstance(entry.value, bool) else must_be(entry, "true or false")


def choice(entry: Entry, options: tuple[str, ...]) -> str:
    """Return a str that is one of the options."""
    if not isinstance(entry.value, str):
        must_be(entry, " or ".join(options))
    if entry.value not in options:
        is_list = entry.file and "," in entry.value and len(entry.value) <= _LONGEST_SHOWN
        hint = f"{_LIST.format(entry.value)}; " if is_list else _did_you_mean(entry.value, options)
        refuse(entry, f"{_shown(entry.value)} is unknown; {hint}must be {' or '.join(options)}")
    return entry.value


def current_name(entry: Entry, renamed: dict[str, str]) -> Entry:
    """Return the entry, a name of an earlier version replaced by the current one, with a line about it on stderr."""
    if not isinstance(entry.value, str) or entry.value not in renamed:
        return entry
    current = renamed[entry.value]
    place = ": ".join(filter(None, (entry.file, entry.key)))
    print("brownpipe:", printable(f"{place} {entry.value}: now called {current}"), file=sys.stderr)
    return entry._replace(value=current)


def name(entry: Entry) -> str:
    """Return a name that can be part of a path."""
    if not isinstance(entry.value, str) or not NAME.fullmatch(entry.value):
        must_be(entry, "a name: letters, digits, '.', '_', '-', the first a letter or digit, at most 64")
    return entry.value


def pair(entry: Entry) -> tuple[float, float]:
    """Return two finite numbers."""
    x, y = items(entry, 2, "two numbers [x, y]")
    return number(x), number(y)


def _did_you_mean(word: object, options: tuple[str, ...]) -> str:
    """Return a question about the most similar option, "" if none is similar."""
    near = [name for name in _SYNONYMS.get(str(word).lower(), ()) if name in options]
    near += difflib.get_close_matches(str(word)[:80].lower(), options, n=1)
    return f"did you mean {near[0]}? " if near else ""


def _number_hint(value: object) -> str:
    """Return what to change in a text that is nearly a number, "" otherwise."""
    text = value if isinstance(value, str) else ""
    if _NUMBER.fullmatch(text):
        return "; without quotes"
    if _NUMBER.fullmatch(text.replace("\N{MINUS SIGN}", "-")):
        return "; with the sign - for minus"
    if _NUMBER.fullmatch(text.replace(",", ".", 1)):
        return "; with a decimal point"
    if re.fullmatch(rf"({_NUMBER.pattern}) ?[^\W\d]+", text):
        return "; without a unit: all quantities are in reduced units"
    return ""


def _integer_hint(value: object) -> str:
    """Return what to write in place of a value that is nearly an integer or a list of them, "" otherwise."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return f"; write {int(value)}"
    text = value.strip("() ") if isinstance(value, str) else ""
    if re.fullmatch(r"[0-9]+(_[0-9]+)+", text):
        return f"; write {text.replace('_', '')}"
    is_list = len(text) <= _LONGEST_SHOWN and re.fullmatch(r"[0-9]+( *, *[0-9]+)+", text)
    return f"; {_LIST.format(text)}" if is_list else ""


def shortened(text: str) -> str:
    """Return a text of at most _LONGEST_TEXT characters, the middle of a longer one left out."""
    half = _LONGEST_TEXT // 2 - 2
    return text if len(text) <= _LONGEST_TEXT else f"{text[:half]}...{text[-half:]}"


def _shown(value: object) -> str:
    """Return the value as in YAML, on one line and shortened."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple) and len(value) > 4:
        return f"a list of {len(value)}"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    text = repr(list(value) if isinstance(value, tuple) else value)
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."
