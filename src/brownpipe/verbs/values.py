"""Readers of the values of options.

Each raises ArgumentTypeError, which argparse shows with the name of the option.
"""

import argparse
import json
from collections.abc import Callable
from typing import TypeVar

Value = TypeVar("Value")

ALL = 10**9  # more runs than there can be
SCENE = "config/scenes/harrison2020.yaml"  # of the examples


def several(read: Callable[[str], Value]) -> Callable[[str], list[Value]]:
    """Return the reader of values that are separated by commas, from that of one value."""
    return lambda text: [read(part.strip()) for part in text.split(",")]


def key_value(text: str) -> tuple[str, object]:
    """Return the key and the value of KEY=VALUE; the value is JSON or, if it is not, a text."""
    key, sign, value = text.partition("=")
    if not (sign and key.isidentifier()):
        raise argparse.ArgumentTypeError(f"must be KEY=VALUE, with a key of the study, like seeds=100, not {text!r}")
    try:
        return key, json.loads(value)
    except (ValueError, RecursionError):
        return key, value


def window(text: str) -> tuple[float, float]:
    """Return the start and end [time] of T0:T1."""
    try:
        start, end = map(float, text.split(":"))
    except ValueError:
        start = end = float("nan")
    if not 0 <= start < end < float("inf"):
        raise argparse.ArgumentTypeError(f"must be T0:T1 with 0 <= T0 < T1, like 0.1:1, not {text!r}")
    return start, end


def positive(text: str) -> float:
    """Return a finite number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value < float("inf"):
        hint = "; without a unit" if text[:1].isdigit() and text[-1:].isalpha() else ""
        hint = "; with a decimal point" if "," in text else hint
        raise argparse.ArgumentTypeError(f"must be a finite number > 0, not {text!r}{hint}")
    return value


def seconds(text: str) -> float:
    """Return the seconds of 60s, 5min, 2h or 60."""
    number = text.rstrip("abcdefghijklmnopqrstuvwxyz")
    units = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}
    if text[len(number) :] not in units:
        raise argparse.ArgumentTypeError(f"must be a time like 60s, 5min or 2h, not {text!r}")
    return positive(number) * units[text[len(number) :]]


def integer(text: str, least: int = 0, most: int = 999_999_999) -> int:
    """Return an integer written in at most nine ASCII digits, from `least` to `most`."""
    if not (text.isascii() and text.isdigit() and len(text) <= 9 and least <= int(text) <= most):
        raise argparse.ArgumentTypeError(f"must be an integer from {least} to {most}, not {text!r}")
    return int(text)


def number_or_all(text: str) -> int:
    """Return a number of runs, 0 or more; `all` is more than there can be."""
    if text != "all" and not text.isdigit():
        raise argparse.ArgumentTypeError(f"must be a number of runs or all, not {text!r}")
    return ALL if text == "all" else integer(text)


def seed(text: str) -> int:
    """Return one seed of the range that runs may have."""
    from brownpipe.scene.seeds import LARGEST_SEED

    if not (text.isascii() and text.isdigit() and len(text) <= 19 and int(text) <= LARGEST_SEED):
        raise argparse.ArgumentTypeError(f"must be one seed, an integer from 0 to {LARGEST_SEED}, not {text!r}")
    return int(text)
