"""Readers of the values of options, and options that several verbs have.

A reader raises ArgumentTypeError, which argparse shows with the name of the option.
"""

import json
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from brownpipe.errors import RequestError
from brownpipe.scene.reading import Count, scalar, validated, value_in
from brownpipe.scene.seeds import Seed
from brownpipe.verbs import AddOption

if TYPE_CHECKING:
    from typing_extensions import TypeForm

Value = TypeVar("Value")


def typed(kind: "TypeForm[Value]", form: str = "") -> Callable[[str], Value]:
    """Return the reader of a value of this type, which is read and refused as in a scene or study
    file.

    form: of a list of two values, such as T0:T1.
    """

    def read(text: str) -> Value:
        value: object = scalar(text)
        if form:
            words = text.split(":")
            if len(words) != len(form.split(":")):
                raise ArgumentTypeError(f"must be {form}, not {text!r}")
            value = [scalar(word) for word in words]
        try:
            return validated(kind, value)
        except RequestError as error:
            raise ArgumentTypeError(str(error)) from None

    return read


def several(read: Callable[[str], Value]) -> Callable[[str], list[Value]]:
    """Return the reader of values separated by commas, made from the reader of one value."""
    return lambda text: [read(word.strip()) for word in text.split(",")]


def key_value(text: str) -> tuple[str, object]:
    """Return the key and the value of KEY=VALUE; the value is JSON or, if it is not, read as in a
    file.
    """
    key, sign, value = text.partition("=")
    if not (sign and key.replace(".", "").replace("-", "").isidentifier()):
        raise ArgumentTypeError(
            f"must be KEY=VALUE, like seeds=100 or disks.tracer.mass=10, not {text!r}"
        )
    try:
        return key, json.loads(value)
    except (ValueError, RecursionError):
        return key, value_in(value)


def refuse_together(arguments: Namespace, *options: str, but: Sequence[str] = ()) -> None:
    """Raise RequestError if several of these options are given, unless they are just those in
    `but`.
    """
    chosen = []
    for name in options:
        value = getattr(arguments, name)
        if value is not None and value is not False:
            chosen.append(name)
    if len(chosen) > 1 and chosen != but:
        first, second, *_ = chosen
        raise RequestError(f"--{first}: must not be given with --{second}".replace("_", "-"))


def add_particles(add: AddOption, help: str = "number of disks instead of the scene's") -> None:
    add("--particles", type=typed(Count), metavar="N", help=help)


def add_seed(add: AddOption, help: str) -> None:
    add("--seed", type=typed(Seed), metavar="SEED", help=help)


def add_config(add: AddOption) -> None:
    replaced = "other values of the study's keys, as for `snakemake --config`"
    add("--config", nargs="+", type=key_value, default=[], metavar="KEY=VALUE", help=replaced)
