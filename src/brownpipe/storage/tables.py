"""Tables of disks in text files: CSV with a heading, and frames of an extended XYZ.

Values are texts until they are asked for as numbers: a refusal shows the text and its line. Titles
of columns and keys may be written in capitals.
"""

import csv
import re
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.scene.reading import NAME

# in the comment of an extended XYZ; the value may be in quotes, with \" for a quote in it
KEY_AND_VALUE = re.compile(r"""([^\s="']+)\s*=\s*("(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*'|\S+)""")
NUMBER_OF_DISKS = re.compile("[0-9]{1,9}")
WIDTH = re.compile("[0-9]{1,4}")  # of a property of an XYZ: how many columns it has
PLAIN_XYZ = "species:S:1:pos:R:3"  # the columns of an XYZ that does not name them


class Table(NamedTuple):
    """A table of N disks, as texts."""

    file: Path
    heading: int  # the line of the file, from 1, that names the columns
    columns: dict[str, np.ndarray]  # (N,) texts, by title in small letters
    line: np.ndarray  # (N,) int64 of each disk in the file


class Frame(NamedTuple):
    """A frame of an extended XYZ."""

    line: int  # of its comment in the file, from 1
    number: int  # of disks
    comment: str


def read_csv(file: Path) -> Table:
    """Return a table with a heading; blank lines are left out."""
    rows = []
    lines = []
    with open(file, encoding="utf-8-sig", newline="") as text:
        reader = csv.reader(text, skipinitialspace=True, strict=True)
        try:
            for row in reader:
                if any(row):
                    rows.append(row)
                    lines.append(reader.line_num)
        except UnicodeDecodeError:
            raise RequestError(f"{file}: is no text") from None
        except csv.Error:
            place = f"{file}: line {reader.line_num}"
            raise RequestError(f"{place}: must be values separated by commas") from None
    if not rows:
        raise RequestError(f"{file}: holds no disks")
    titles = [title.strip() for title in rows[0]]
    if len(titles) == 1:
        allowed = "must be titles separated by commas, as in x,y,radius,mass"
        raise RequestError(f"{file}: line {lines[0]}: {allowed}, not {titles[0]:.60}")
    return _table(file, lines[0], titles, rows[1:], lines[1:])


def frames_of(file: Path) -> list[Frame]:
    """Return the frames of an extended XYZ."""
    frames = []
    line = 1
    with open(file, encoding="utf-8-sig") as lines:
        try:
            for text in lines:
                head = text.strip()
                if not head:
                    line += 1
                    continue
                if not NUMBER_OF_DISKS.fullmatch(head):
                    place = f"{file}: line {line}"
                    raise RequestError(f"{place}: must be the number of disks, not {head:.60}")
                frame = Frame(line + 1, int(head), next(lines, ""))
                present = sum(1 for _ in islice(lines, frame.number))
                if present < frame.number:
                    raise RequestError(f"{file}: ends after {present} of {frame.number} disks")
                frames.append(frame)
                line += frame.number + 2
        except UnicodeDecodeError:
            raise RequestError(f"{file}: is no text") from None
    if not frames:
        raise RequestError(f"{file}: holds no disks")
    return frames


def keys_of(frame: Frame) -> dict[str, str]:
    """Return the keys in the comment of a frame, in small letters, and their values, without
    quotes.

    >>> keys_of(Frame(2, 1, 'Lattice="4 0 0 0 4 0 0 0 1" Time = 0.5'))
    {'lattice': '4 0 0 0 4 0 0 0 1', 'time': '0.5'}
    """
    keys = {}
    for key, value in KEY_AND_VALUE.findall(frame.comment):
        is_quoted = value[0] in "\"'"
        keys[key.lower()] = value[1:-1] if is_quoted else value
    return keys


def read_frame(file: Path, frame: Frame) -> Table:
    """Return the table of a frame of an extended XYZ; its columns of vectors are `pos-0`, `pos-1`,
    ...
    """
    titles = _columns_of_properties(file, frame)
    first = frame.line + 1
    with open(file, encoding="utf-8-sig") as lines:
        rows = [text.split() for text in islice(lines, frame.line, frame.line + frame.number)]
    return _table(file, frame.line, titles, rows, list(range(first, first + frame.number)))


def _columns_of_properties(file: Path, frame: Frame) -> list[str]:
    """Return the title of each column: `radius`, or of vectors `pos-0`, `pos-1`, ..."""
    properties = keys_of(frame).get("properties", PLAIN_XYZ)
    words = properties.split(":")
    titles = []
    for name, width in zip(words[::3], words[2::3], strict=False):
        if not WIDTH.fullmatch(width):
            place = f"{file}: line {frame.line}: Properties"
            raise RequestError(f"{place}: must be name:type:width, not {properties:.60}")
        if width == "1":
            titles.append(name)
        else:
            titles += [f"{name}-{k}" for k in range(int(width))]
    return titles


def _table(
    file: Path, heading: int, titles: list[str], rows: list[list[str]], lines: list[int]
) -> Table:
    """Return a table of rows of texts, which are at these lines of the file."""
    names = [title.lower() for title in titles]
    for name in names:
        if name and names.count(name) > 1:
            place = f"{file}: line {heading}: {name}"
            raise RequestError(f"{place}: must be in one column, not in {names.count(name)}")
    for row, line in zip(rows, lines, strict=True):
        if len(row) != len(names):
            allowed = f"must have {len(names)} values, {', '.join(titles):.80}"
            raise RequestError(f"{file}: line {line}: {allowed}; not {len(row)}")
    texts = np.array(rows, object).reshape(len(rows), len(names))
    columns = {name: texts[:, k] for k, name in enumerate(names)}
    return Table(file, heading, columns, np.array(lines, np.int64))


def select_rows(table: Table, is_chosen: np.ndarray) -> Table:
    """Return the rows of a table for which is_chosen (N,) is true."""
    columns = {name: texts[is_chosen] for name, texts in table.columns.items()}
    return table._replace(columns=columns, line=table.line[is_chosen])


def numbers_in(table: Table, title: str) -> np.ndarray:
    """Return the numbers (N,) in a column of a table."""
    if title not in table.columns:
        present = ", ".join(filter(None, table.columns))
        place = f"{table.file}: line {table.heading}: {title}"
        raise RequestError(f"{place}: missing; the columns are {present:.80}")
    texts = table.columns[title]
    values = np.array([number_of(text) for text in texts], float)
    is_wrong = ~np.isfinite(values)
    if is_wrong.any():
        row = int(np.argmax(is_wrong))
        text = texts[row].strip()
        problem = f"must be a number, not {text:.40}" if text else "missing"
        raise RequestError(f"{table.file}: line {table.line[row]}: {title}: {problem}")
    return values


def number_of(text: str) -> float:
    """Return the number that a text is, NaN for others: 1_0, which Python reads as 10, is none."""
    try:
        return np.nan if "_" in text else float(text)
    except ValueError:
        return np.nan


def names_in(table: Table, title: str) -> np.ndarray:
    """Return the names of species (N,) in a column of a table."""
    names = np.array([text.strip() for text in table.columns[title]])
    for name, line in zip(names.tolist(), table.line, strict=True):
        if not NAME.fullmatch(name):
            allowed = "must be a name: letters, digits, '.', '_', '-', at most 64"
            problem = f"{allowed}, not {name:.80}" if name else "missing"
            raise RequestError(f"{table.file}: line {line}: {title}: {problem}")
    return names
