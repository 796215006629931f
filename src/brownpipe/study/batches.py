"""How `batch: auto` divides the seeds of a case into jobs: from the forecast of one run alone.

Neither the number of cores nor that of seeds enters: the same study has the same jobs on every machine, and complete
jobs stay valid when seeds are added. So that a small study keeps many cores busy and a large one has few files, the
first jobs are short, and their length doubles as often as the number of runs before them.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from brownpipe.engines import forecast
from brownpipe.scene.seeds import ranges

SHORTEST = 18.0  # CPU seconds of the first jobs: starting one takes some 3 % of its time
LONGER = 20.0  # they are longer by so many times what a job calculates once: that takes some 5 % at most
LONGEST = 600.0  # CPU seconds of a job, unless there are very many
LARGEST = 1e9  # bytes of memory of a job, unless there are very many
SHORT_JOBS = 32  # of equal length before the length is doubled, while it is below LONGEST
LONG_JOBS = 256  # the same from LONGEST on, so that a year of CPU time has some 2,500 jobs


def automatic_batches(seeds: Sequence[int] | np.ndarray, cost: forecast.Cost) -> list[tuple[int, int]]:
    """Return first and last seed of each batch, for ascending seeds of runs with this forecast.

    Every range of consecutive seeds begins with batches of SHORTEST.
    """
    lengths = shortest_and_longest(cost)
    return [batch for first, last in ranges(seeds) for batch in _batches(first, last, *lengths)]


def shortest_and_longest(cost: forecast.Cost) -> tuple[int, int]:
    """Return the runs of a job of SHORTEST and of one of LONGEST and LARGEST, rounded down to powers of two."""
    per_run = cost.seconds + cost.storing
    most = max(1, min(int(LONGEST / per_run), forecast.most_runs(cost, LARGEST)))
    first = (SHORTEST + LONGER * cost.once) / per_run
    return _power_of_two(min(most, int(first))), _power_of_two(most)


def _batches(first: int, last: int, shortest: int, longest: int) -> Iterator[tuple[int, int]]:
    """Yield the batches of one range of consecutive seeds."""
    start = first
    while start <= last:
        before = start - first
        length = min(shortest * _power_of_two(before // (SHORT_JOBS * shortest)), longest)
        if before >= LONG_JOBS * longest:
            length = longest * _power_of_two(before // (LONG_JOBS * longest))
        yield start, min(start + length - 1, last)
        start += length


def _power_of_two(number: int) -> int:
    """Return the largest power of two up to a number; 1 for 0."""
    return 1 << max(number.bit_length() - 1, 0)
