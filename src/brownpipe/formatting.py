"""Times, sizes and counts as text."""


def in_time(seconds: float) -> str:
    """Return a time [s] with two digits in the largest unit of which it has two: 90 s, 2.5 min, 700 ms, 3 days."""
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("min", 60.0), ("s", 1.0)):
        if seconds >= 2 * size or (unit == "s" and seconds >= size):
            return f"{seconds / size:.2g} {unit}" if seconds < 100 * size else f"{seconds / size:,.0f} {unit}"
    return f"{1e3 * seconds:.0f} ms" if seconds >= 0.01 else f"{1e3 * seconds:.2g} ms"


def in_bytes(count: float) -> str:
    """Return a size in bytes: 512 B, 1.4 kB, 23 MB."""
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{float(f'{count / size:.2g}'):g} {unit}"
    return f"{count:.0f} B"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun: 1 run, 2,400 runs."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
