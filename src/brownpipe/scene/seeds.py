"""Seeds as people write them, and batches of them."""

import re
from collections.abc import Sequence
from itertools import chain, groupby

from brownpipe.scene import reading
from brownpipe.scene.reading import Entry, must_be

MOST_SEEDS = 10_000_000
LARGEST_SEED = 2**63 - 1


def parse_seeds(text: str, entry: Entry | None = None) -> Sequence[int]:
    """Return the seeds of "0-2399", "17" or "3,5,9", ascending and without repeats; a range where there is no gap."""
    entry = entry or Entry(text, "", ("seeds",))
    parts = [re.fullmatch(r"([0-9]{1,19})(?:-([0-9]{1,19}))?", part.strip(), re.ASCII) for part in text.split(",")]
    if None in parts:
        must_be(entry, "seeds like 17, 0-2399 or 3,5,9")
    ends = [(int(part[1]), int(part[2] or part[1])) for part in parts]
    if any(first > last for first, last in ends):
        must_be(entry, "ranges that ascend, like 0-2399")
    if any(last > LARGEST_SEED for _, last in ends):
        must_be(entry, "seeds below 2**63")
    runs = _merged(ends)
    if sum(last - first + 1 for first, last in runs) > MOST_SEEDS:
        must_be(entry, f"at most {MOST_SEEDS} seeds")
    ranges = [range(first, last + 1) for first, last in runs]
    return ranges[0] if len(ranges) == 1 else tuple(chain.from_iterable(ranges))


def _merged(runs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return runs of consecutive seeds in ascending order, joined where they touch or overlap."""
    merged = []
    for first, last in sorted(runs):
        if merged and first <= merged[-1][1] + 1:
            first, last = merged[-1][0], max(last, merged.pop()[1])
        merged.append((first, last))
    return merged


def read_seeds(entry: Entry) -> Sequence[int]:
    """A number is a count (seeds 0, 1, ...); a string or a list names the seeds themselves."""
    if isinstance(entry.value, int) and not isinstance(entry.value, bool):
        return range(reading.integer(entry, 1, MOST_SEEDS))
    parts = entry.value if isinstance(entry.value, list | tuple) else [entry.value]
    if not parts or not all(isinstance(part, int | str) and not isinstance(part, bool) for part in parts):
        must_be(entry, "a count like 2400, a range like 0-2399, or a list of seeds and ranges")
    return parse_seeds(",".join(map(str, parts)), entry)


def batches(seeds: Sequence[int], size: int) -> list[tuple[int, int]]:
    """Return first and last seed of each batch, cut at multiples of `size`: more seeds leave whole batches alone."""
    return [cut for first, last in stretches(seeds) for cut in _cuts(first, last, size)] if seeds else []


def stretches(seeds: Sequence[int]) -> list[tuple[int, int]]:
    """Return first and last of each stretch of seeds without a gap."""
    if isinstance(seeds, range):
        return [(seeds[0], seeds[-1])]
    found = (list(group) for _, group in groupby(enumerate(seeds), lambda pair: pair[1] - pair[0]))
    return [(stretch[0][1], stretch[-1][1]) for stretch in found]


def _cuts(first: int, last: int, batch: int) -> list[tuple[int, int]]:
    starts = [first, *range(first - first % batch + batch, last + 1, batch)]
    return [(start, min(last, start - start % batch + batch - 1)) for start in starts]
