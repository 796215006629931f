"""Seeds of runs: texts of them, ranges of consecutive seeds, and batches of them."""

import re
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PlainValidator

from brownpipe.scene.reading import refuse

MOST_SEEDS = 10_000_000
LONGEST_TEXT = 60  # characters of a brief list of seeds
RANGE = re.compile(r"([0-9]{1,18})(?:-([0-9]{1,18}))?")


def _seeds(value: Any) -> Sequence[int]:
    """Return the seeds of a study or call: a number is a count (seeds 0, 1, ...), a text or a list
    names them.

    "0-2399", "17" or "3,5,9"; ascending and without repeats; one range is a `range`. Anything else
    is refused, and so are more than MOST_SEEDS seeds.
    """
    parts = (
        [f"0-{value - 1}"]
        if type(value) is int
        else value
        if isinstance(value, list | tuple)
        else [value]
    )
    found = [RANGE.fullmatch(word.strip()) for part in parts for word in str(part).split(",")]
    ends = [(int(one[1]), int(one[2] or one[1])) for one in found if one]
    sizes = [last + 1 - first for first, last in ends]
    if None in found or not 0 < min(sizes, default=0) <= sum(sizes) <= MOST_SEEDS:
        allowed = "seeds" if isinstance(value, str) else "a count like 2400, or seeds"
        refuse(
            f"must be {allowed} like 17, 0-2399 or 3,5,9, ascending, at most {MOST_SEEDS}, not "
            f"{value!r:.80}"
        )
    if len(ends) == 1:  # without 10 s of sorting for the most seeds
        return range(ends[0][0], ends[0][1] + 1)
    return tuple(
        np.unique(np.concatenate([np.arange(first, last + 1) for first, last in ends])).tolist()
    )


_Count = Annotated[int, Field(ge=1, le=MOST_SEEDS)]
Seed = Annotated[int, Field(strict=True, ge=0, le=10**18 - 1)]
_Range = Annotated[str, Field(pattern=rf"^\s*{RANGE.pattern}\s*(,\s*{RANGE.pattern}\s*)*$")]
Seeds = Annotated[
    Any, PlainValidator(_seeds, json_schema_input_type=_Count | _Range | list[Seed | _Range])
]


def seed_text(seeds: Sequence[int] | np.ndarray) -> str:
    """Return ascending seeds as `Seeds` are read: [0, 1, 2, 7] is 0-2,7."""
    return ",".join(
        f"{first}-{last}" if first < last else f"{first}" for first, last in ranges(seeds)
    )


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
    parts = np.split(seeds, np.flatnonzero(np.diff(seeds) != 1) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts if len(part)]
