"""What displacements and autocorrelations are averaged over: over runs alone, or within each run
also over time origins, over disks equal to the tracer, or over both.

Both are written as a list, `average: [origins, disks]`, and as one text, `origins,disks`, on the
command line and in files.
"""

from collections.abc import Sequence

ORIGINS = "origins"
DISKS = "disks"
ORIGINS_AND_DISKS = f"{ORIGINS},{DISKS}"
AVERAGES = ("runs", ORIGINS, DISKS, ORIGINS_AND_DISKS)


def over_origins(average: str) -> bool:
    """Return whether every sample of a run is a time origin, not that at t = 0 alone.

    >>> [over_origins(average) for average in AVERAGES]
    [False, True, False, True]
    """
    return ORIGINS in average.split(",")


def over_disks(average: str) -> bool:
    """Return whether all disks equal to the tracer count, not the tracer alone.

    >>> [over_disks(average) for average in AVERAGES]
    [False, False, True, True]
    """
    return DISKS in average.split(",")


def average_named(words: str | Sequence[str]) -> str:
    """Return the average of one word, of a list of words in any order, or of a text with commas;
    what is none is left for `observables.problems` to refuse.

    >>> average_named(["disks", "origins"])
    'origins,disks'
    """
    names = words.split(",") if isinstance(words, str) else words
    text = ",".join(str(name).strip() for name in names)
    return ORIGINS_AND_DISKS if text == f"{DISKS},{ORIGINS}" else text
