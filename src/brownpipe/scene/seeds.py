"""Seeds of runs: texts of them, ranges of consecutive seeds, and batches of them."""

import re
from collections.abc import Sequence
from itertools import chain
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PlainValidator

from brownpipe.scene.reading import refuse, shown, validated

MOST_SEEDS = 10_000_000
LARGEST_SEED = 10**18 - 1
LONGEST_TEXT = 60  # characters of a brief list of seeds
RANGE = re.compile(r"([0-9]{1,18})(?:-([0-9]{1,18}))?")


def read_seeds(value: object) -> Sequence[int]:
    """Return the seeds of a study or call: a number is a count (seeds 0, 1, ...), a text or a list names them.

    "0-2399", "17" or "3,5,9"; ascending and without repeats, a `range` if there is no gap. Raises RequestError for
    anything else, and for more than MOST_SEEDS seeds.
    """
    return validated(Seeds, value, key="seeds")


def _seeds(value: Any) -> Sequence[int]:
    """Return the seeds of a value, within a validator."""
    if isinstance(value, int) and not isinstance(value, bool):
        return range(value) if 1 <= value <= MOST_SEEDS else _must_be(f"an integer from 1 to {MOST_SEEDS}", value)
    parts = value if isinstance(value, list | tuple) else [value]
    found = [RANGE.fullmatch(word.strip()) for part in parts for word in str(part).split(",")]
    ends = [(int(part[1]), int(part[2] or part[1])) for part in found if part]
    if None in found or not ends:
        counted = "a count like 2400, a range like 0-2399, or a list of seeds and ranges"
        _must_be("seeds like 17, 0-2399 or 3,5,9" if isinstance(value, str) else counted, value)
    if any(first > last for first, last in ends):
        _must_be("ranges that ascend, like 0-2399", value)
    if sum(last - first + 1 for first, last in ends) > MOST_SEEDS:
        _must_be(f"at most {MOST_SEEDS} seeds", value)
    if len(ends) == 1:
        return range(ends[0][0], ends[0][1] + 1)
    seeds = sorted({*chain.from_iterable(range(first, last + 1) for first, last in ends)})
    return range(seeds[0], seeds[-1] + 1) if seeds[-1] - seeds[0] < len(seeds) else tuple(seeds)


def _must_be(allowed: str, value: object) -> Any:
    refuse(f"must be {allowed}, not {shown(value)}")


_Count = Annotated[int, Field(ge=1, le=MOST_SEEDS)]
Seed = Annotated[int, Field(strict=True, ge=0, le=LARGEST_SEED)]
_Range = Annotated[str, Field(pattern=rf"^\s*{RANGE.pattern}\s*(,\s*{RANGE.pattern}\s*)*$")]
Seeds = Annotated[Any, PlainValidator(_seeds, json_schema_input_type=_Count | _Range | list[Seed | _Range])]


def seed_text(seeds: Sequence[int] | np.ndarray) -> str:
    """Return ascending seeds as `read_seeds` reads them: [0, 1, 2, 7] is 0-2,7."""
    return ",".join(f"{first}-{last}" if first < last else f"{first}" for first, last in ranges(seeds))


def brief_seed_text(seeds: Sequence[int] | np.ndarray) -> str:
    """Return `seed_text`, cut where it is longer than LONGEST_TEXT characters."""
    text = seed_text(seeds)
    return text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 4] + " ..."


def ranges(seeds: Sequence[int] | np.ndarray) -> list[tuple[int, int]]:
    """Return first and last seed (included) of each range of consecutive seeds; the seeds ascend."""
    if isinstance(seeds, range) and seeds.step == 1:
        return [(seeds[0], seeds[-1])] if seeds else []
    seeds = np.asarray(seeds, np.int64)
    gaps = np.flatnonzero(np.diff(seeds) != 1)
    first, last = np.insert(seeds[gaps + 1], 0, seeds[:1]), np.append(seeds[gaps], seeds[-1:])
    return list(zip(first.tolist(), last.tolist(), strict=True))
