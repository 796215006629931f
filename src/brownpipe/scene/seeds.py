"""Seeds of runs: texts of them, ranges of consecutive seeds, and batches of them."""

import re
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, PlainValidator

from brownpipe.scene.reading import refuse

MOST_SEEDS = 10_000_000
LONGEST_TEXT = 60  # characters of a brief list of seeds
LARGEST = 10**18 - 1
RANGE = re.compile(r"([0-9]{1,18})(?:-([0-9]{1,18}))?")
TOO_LONG = re.compile(r"[0-9]{19,}")  # digits of a seed


def _seeds(value: object) -> Sequence[int]:
    """Return the seeds of a study or call: a number is a count (seeds 0, 1, ...), a text or a list
    names them.

    "0-2399", "17" or "3,5,9"; ascending and without repeats; one range is a `range`. Anything else
    is refused, and so are seeds above LARGEST and more than MOST_SEEDS of them.
    """
    words = _words_of(value)
    matches = [RANGE.fullmatch(word) for word in words]
    ends = [(int(match[1]), int(match[2] or match[1])) for match in matches if match]
    sizes = [last + 1 - first for first, last in ends]
    if any(TOO_LONG.search(word) for word in words):
        refuse(f"a seed must be at most {LARGEST}, not {value!r:.80}")
    if None in matches or min(sizes, default=0) < 1:
        allowed = "seeds" if isinstance(value, str) else "a count like 2400, or seeds"
        refuse(f"must be {allowed} like 17, 0-2399 or 3,5,9, ascending, not {value!r:.80}")
    if sum(sizes) > MOST_SEEDS:
        refuse(f"must be at most {MOST_SEEDS} seeds, not {sum(sizes)}: {value!r:.80}")
    if len(ends) == 1:  # without 10 s of sorting for the most seeds
        first, last = ends[0]
        return range(first, last + 1)
    seeds = np.concatenate([np.arange(first, last + 1) for first, last in ends])
    return tuple(np.unique(seeds).tolist())


def _words_of(value: object) -> list[str]:
    """Return the seeds and ranges of seeds that a value names, as texts: "0-9" for the count 10."""
    if type(value) is int:
        return [f"0-{min(value, LARGEST + 1) - 1}"]
    items = value if isinstance(value, list | tuple) else [value]
    return [word.strip() for item in items for word in str(item).split(",")]


_Count = Annotated[int, Field(ge=1, le=MOST_SEEDS)]
Seed = Annotated[int, Field(strict=True, ge=0, le=LARGEST)]
_Range = Annotated[str, Field(pattern=rf"^\s*{RANGE.pattern}\s*(,\s*{RANGE.pattern}\s*)*$")]
Seeds = Annotated[
    Sequence[int],
    PlainValidator(_seeds, json_schema_input_type=_Count | _Range | list[Seed | _Range]),
]


def seed_text(seeds: Sequence[int] | np.ndarray) -> str:
    """Return ascending seeds as `Seeds` are read: [0, 1, 2, 7] is 0-2,7."""
    words = [f"{first}-{last}" if first < last else f"{first}" for first, last in ranges(seeds)]
    return ",".join(words)


def brief_seed_text(seeds: Sequence[int] | np.ndarray) -> str:
    """Return `seed_text`, cut where it is longer than LONGEST_TEXT characters."""
    text = seed_text(seeds)
    return text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 4] + " ..."


def ranges(seeds: Sequence[int] | np.ndarray) -> list[tuple[int, int]]:
    """Return first and last seed (included) of each range of consecutive seeds; the seeds
    ascend.
    """
    if isinstance(seeds, range) and seeds.step == 1:  # never expanded, as it may be long
        return [(seeds[0], seeds[-1])] if seeds else []
    seeds = np.asarray(seeds, np.int64)
    consecutive = np.split(seeds, np.flatnonzero(np.diff(seeds) != 1) + 1)
    return [(int(block[0]), int(block[-1])) for block in consecutive if len(block)]
