"""Checked access to the values of a scene or study file, of options and of arguments.

Every refusal is one line that names the file, its line, the key, the value and the allowed values.
"""

import difflib
import math
import re
import sys
from collections.abc import Mapping
from typing import NamedTuple, NoReturn

from brownpipe.errors import RequestError
from brownpipe.quoting import printable
from brownpipe.scene.yaml_file import DEEPEST, LONGEST_SHOWN, NUMBER, Document, line_in, scalar, shown

MOST_VALUES = 100_000  # of a key on a command line, whose words have at most 131,072 characters
LONGEST_TEXT = 240  # characters of a part of a message
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_LIST = "a list has brackets: [{}]"
_SYNONYMS = {"runs": ["seeds"], "n": ["particles"], "kt": ["temperature"], "dt": ["time_step", "sample_interval"]}


class SourceText(NamedTuple):
    """The text of a file, in which messages look up the line of a value."""

    text: str
    keys: Mapping[str, str | None] = {}  # first key of a path: that in the text, or None if it has none


class Entry(NamedTuple):
    """A value with its file and key, which every message about it names."""

    value: object
    file: str
    path: tuple[str | int, ...] = ()  # ("disks", 3, "radius") is disks[3].radius
    origin: SourceText | None = None

    def part(self, key: str | int, value: object) -> "Entry":
        """Return the entry of a value in this mapping or list."""
        return self._replace(value=value, path=(*self.path, key))

    @property
    def key(self) -> str:
        """The key as messages show it, disks[3].radius."""
        return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in self.path).lstrip(".")


def whole(mapping: object, file: str) -> Entry:
    """Return the entry of all that a file contains; for a `Document`, messages name lines, too."""
    return Entry(mapping, file, (), SourceText(mapping.text) if isinstance(mapping, Document) else None)


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
    return line_in(entry.origin.text, (*head, *entry.path[1:]), is_missing=entry.value is None)


def with_types(entry: Entry) -> object:
    """Return a value with every text in it, at any depth, read as a plain scalar of YAML.

    Raises RequestError for what files may not have either: some numbers, and deep nesting.
    """
    if len(entry.path) > DEEPEST:
        refuse(entry._replace(path=entry.path[:1]), f"nested more than {DEEPEST} levels deep")
    if isinstance(entry.value, dict):
        return {key: with_types(entry.part(key, value)) for key, value in entry.value.items()}
    if isinstance(entry.value, list):
        return [with_types(item) for item in items(entry)]
    try:
        return scalar(entry.value) if isinstance(entry.value, str) else entry.value
    except ValueError as problem:
        refuse(entry, str(problem))


def refuse_huge(entry: Entry) -> None:
    """Refuse a value with more than MOST_VALUES values in it, as aliases (*name) make of a short text."""
    waiting, number_of_values = [entry.value], 0
    while waiting:
        value = waiting.pop()
        parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        number_of_values += len(parts)
        if number_of_values > MOST_VALUES:
            refuse(entry, f"more than {MOST_VALUES} values; aliases (*name) are not allowed, write the value out")
        waiting.extend(parts)


def refuse(entry: Entry, problem: str, at: Entry | None = None) -> NoReturn:
    """Raise RequestError with file, line, key and problem; the line is that of `at`, if it is given."""
    line = _line_of(at or entry)
    place = "" if line is None else f"line {line}"
    raise RequestError(": ".join(part for part in (entry.file, place, entry.key, problem) if part))


def must_be(entry: Entry, allowed: str, hint: str = "") -> NoReturn:
    """Raise RequestError with file, key, the allowed values, the value, and a hint that follows it."""
    refuse(entry, f"must be {allowed}, not {shown(entry.value)}{hint}")


def fields(entry: Entry, required: tuple[str, ...], optional: Mapping[str, object] | None = None) -> dict[str, Entry]:
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
            problem = f"unknown key {shown(key)}; {hint}allowed: {', '.join(allowed)}"
            refuse(entry, problem, at=entry.part(key, value))
    for key in required:
        if key not in entry.value:
            refuse(entry.part(key, None), "missing; must be given")
    return {key: entry.part(key, value) for key, value in (dict(optional or {}) | entry.value).items()}


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
        is_list = entry.file and "," in entry.value and len(entry.value) <= LONGEST_SHOWN
        hint = f"{_LIST.format(entry.value)}; " if is_list else _did_you_mean(entry.value, options)
        refuse(entry, f"{shown(entry.value)} is unknown; {hint}must be {' or '.join(options)}")
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
    if NUMBER.fullmatch(text):
        return "; without quotes"
    if NUMBER.fullmatch(text.replace("\N{MINUS SIGN}", "-")):
        return "; with the sign - for minus"
    if NUMBER.fullmatch(text.replace(",", ".", 1)):
        return "; with a decimal point"
    if re.fullmatch(rf"({NUMBER.pattern}) ?[^\W\d]\S*", text):
        return "; without a unit: all quantities are in reduced units"
    return ""


def _integer_hint(value: object) -> str:
    """Return what to write in place of a value that is nearly an integer or a list of them, "" otherwise."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return f"; write {int(value)}"
    text = value.strip("() ") if isinstance(value, str) else ""
    if re.fullmatch(r"[0-9]+(_[0-9]+)+", text):
        return f"; write {text.replace('_', '')}"
    is_list = len(text) <= LONGEST_SHOWN and re.fullmatch(r"[0-9]+( *, *[0-9]+)+", text)
    return f"; {_LIST.format(text)}" if is_list else ""


def shortened(text: str) -> str:
    """Return a text of at most LONGEST_TEXT characters, the middle of a longer one left out."""
    half = LONGEST_TEXT // 2 - 2
    return text if len(text) <= LONGEST_TEXT else f"{text[:half]}...{text[-half:]}"
