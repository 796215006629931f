"""Seeds on the command line and in study files, ranges of consecutive seeds, and batches of them."""

import re
from collections.abc import Sequence
from itertools import chain

import numpy as np

from brownpipe.scene import reading
from brownpipe.scene.reading import Entry, must_be

MOST_SEEDS = 10_000_000
LARGEST_SEED = 2**63 - 1
LONGEST_TEXT = 60  # characters of a brief list of seeds
RANGE = re.compile(r"([0-9]{1,19})(?:-([0-9]{1,19}))?")


def parse_seeds(text: str, entry: Entry | None = None) -> Sequence[int]:
    """Return the seeds of "0-2399", "17" or "3,5,9", ascending and without repeats; a `range` if there is no gap.

    Raises RequestError, naming `entry`, for any other text and for more than MOST_SEEDS seeds.
    """
    entry = entry or Entry(text, "", ("seeds",))
    parts = [RANGE.fullmatch(part.strip()) for part in text.split(",")]
    if None in parts:
        must_be(entry, "seeds like 17, 0-2399 or 3,5,9")
    ends = [(int(part[1]), int(part[2] or part[1])) for part in parts]
    if any(first > last for first, last in ends):
        must_be(entry, "ranges that ascend, like 0-2399")
    if any(last > LARGEST_SEED for _, last in ends):
        must_be(entry, "seeds below 2**63")
    merged = _merged(ends)
    if sum(last - first + 1 for first, last in merged) > MOST_SEEDS:
        must_be(entry, f"at most {MOST_SEEDS} seeds")
    seeds = [range(first, last + 1) for first, last in merged]
    return seeds[0] if len(seeds) == 1 else tuple(chain.from_iterable(seeds))


def _merged(ends: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return ranges (first, last) in ascending order, joined where they touch or overlap."""
    merged: list[tuple[int, int]] = []
    for first, last in sorted(ends):
        if merged and first <= merged[-1][1] + 1:
            first, last = merged[-1][0], max(last, merged.pop()[1])
        merged.append((first, last))
    return merged


def read_seeds(entry: Entry) -> Sequence[int]:
    """Return the seeds of a study: a number is a count (seeds 0, 1, ...), a string or a list names them."""
    if isinstance(entry.value, int) and not isinstance(entry.value, bool):
        return range(reading.integer(entry, 1, MOST_SEEDS))
    parts = entry.value if isinstance(entry.value, list | tuple) else [entry.value]
    if not parts or not all(isinstance(part, int | str) and not isinstance(part, bool) for part in parts):
        must_be(entry, "a count like 2400, a range like 0-2399, or a list of seeds and ranges")
    return parse_seeds(",".join(map(str, parts)), entry)


def seed_text(seeds: Sequence[int] | np.ndarray) -> str:
    """Return ascending seeds as `parse_seeds` reads them: [0, 1, 2, 7] is 0-2,7."""
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


def batches(seeds: Sequence[int], size: int) -> list[tuple[int, int]]:
    """Return first and last seed of each batch.

    Every range of consecutive seeds is cut at multiples of `size`: a study with more seeds keeps its complete batches.
    """
    cut = []
    for first, last in ranges(seeds):
        starts = [first, *range(first - first % size + size, last + 1, size)]
        cut += [(start, min(last, start - start % size + size - 1)) for start in starts]
    return cut
