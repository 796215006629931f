"""The user's own observables: functions in a module, named `folder/my_module:my_function`.

A function of scene and run, with the tracks `run.tracer` (M = 1) and `run.whole` (M = N) of
`observable.Track`, returns named arrays as xarray takes variables: a number, `(dims, values)`, or
`(dims, values, attributes)` with `units` and `long_name`. The bytes of the module's file are part
of what determines the runs. Files of runs describe these arrays
completely: reading a file runs no module.
"""

import hashlib
import json
import os
import re
import traceback
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from types import FunctionType, MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.observables.observable import Observable, Run, RunArray, Track
from brownpipe.scene import Scene

# CPU, of a few operations of NumPy; what a function really takes is not known before
SECONDS_PER_DISK_SAMPLE = 1e-7


Own = Mapping[str, RunArray]  # by the name of the array
NO_OWN: Own = MappingProxyType({})


def own_arrays(attributes: Mapping) -> dict[str, RunArray]:
    """Return the descriptions (JSON) of the user's own arrays in the attributes of runs, or in a
    checkpoint.
    """
    said = json.loads(attributes.get("own_arrays", "{}"))
    return {
        name: RunArray(tuple(dims), units, long_name, averaged, tuple(shape), *origin)
        for name, (dims, units, long_name, averaged, shape, *origin) in said.items()
    }


class Function(NamedTuple):
    """A function that measures, and where it stands."""

    call: Callable
    file: str
    source: str  # SHA-256 of the file; of one given in Python a random number


taken: set[str] = set()  # names that no array and dimension may have: `analysis.dataset` knows them
_given: dict[
    str, Function
] = {}  # given in Python, by `my_module:my_function@id`; none is ever removed


def is_own(name: str) -> bool:
    """Return whether a name is that of a function in a module."""
    return ":" in name


def title_of(name: str) -> str:
    """Return a name without the folder of its module and without the `@id` of a function given in
    Python.
    """
    return re.sub(r"@\w+$", "", name.rpartition("/")[2])


def beside(folder: Path, name: str) -> str:
    """Return the name in the current folder of an observable that a study in another folder
    names.
    """
    return os.path.relpath(folder / name) if is_own(name) else name


def named(observable: str | Callable) -> str:
    """Return the name of an observable that is given in Python, by name or as a function.

    A function gets an `@id`: others may have its name, and its file may have changed. Raises
    RequestError for other objects.
    """
    if not callable(observable):
        return str(observable).strip()
    if not isinstance(observable, FunctionType):
        raise RequestError(f"observables: {observable!r:.60}: must be a function, made by def")
    name = f"{observable.__module__}:{observable.__name__}@{id(observable):x}"
    _given.setdefault(
        name, Function(observable, observable.__code__.co_filename, os.urandom(16).hex())
    )
    return name


def identity(name: str) -> str:
    """Return the name of an observable, of the user's own with the source's digest; RequestError if
    it is not found.
    """
    return f"{title_of(name)} {_found(name).source}" if is_own(name) else name


def observable_of(name: str) -> Observable:
    """Return the record of a function in a module, which need not be there: `unfit` says why it
    cannot be used.
    """

    def unfit(_: Scene) -> str | None:
        try:
            _found(name)
        except RequestError as error:
            return str(error).removeprefix(f"{name} ")
        return None

    return Observable(
        lambda *_: {}, {}, SECONDS_PER_DISK_SAMPLE, unfit=unfit
    )  # `measure` alone knows its arrays


def _found(name: str) -> Function:
    """Return a function in a module. Raises RequestError, which begins with its name, if it is not
    there.
    """
    if name in _given:
        return _given[name]
    module, _, function = name.rpartition(":")
    file = f"{module}.py"
    try:
        source = Path(file).read_bytes()
        call = _defined_in(file, source).get(function)
    except Exception as error:
        raise RequestError(f"{name} cannot be used: {_in_words(error, file)}") from error
    if not callable(call):
        raise RequestError(f"{name} cannot be used: {file} has no function {function}")
    return Function(call, file, hashlib.sha256(source).hexdigest())


@lru_cache(maxsize=8)
def _defined_in(file: str, source: bytes) -> dict[str, Any]:
    """Return what a module defines. It is run from these bytes: a compiled copy of it could be of
    older ones.
    """
    variables = {"__name__": Path(file).stem, "__file__": file}
    exec(compile(source, file, "exec"), variables)
    return variables


def _in_words(error: Exception, file: str) -> str:
    """Return an exception with the last line of a file that it passed."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == file
    ]
    return f"{type(error).__name__}: {error}" + (f" ({file}, line {lines[-1]})" if lines else "")


def measure(
    name: str, scene: Scene, run: Run, axes: Mapping, known: dict[str, RunArray]
) -> dict[str, np.ndarray]:
    """Return the arrays of a function in a module for a run, and add their descriptions to `known`.

    `axes` are the dimensions with coordinates. Raises RequestError for whatever goes wrong in a
    function, and for arrays that are not numbers, or are unlike those of the runs before.
    """
    function, measured = _found(name), dict[str, np.ndarray]()
    tracer, whole = (Track(*map(_read_only, track)) for track in (run.tracer, run.whole))
    try:
        returned = function.call(scene, Run(tracer, whole))
        if not isinstance(returned, Mapping):
            raise TypeError(f"must return a mapping of names to arrays, not {returned!r:.40}")
        for array, value in returned.items():
            dims, measured[array], attributes = _taken_apart(array, value)
            shape = tuple(len(axes[d].coordinates(scene)) if d in axes else None for d in dims)
            own = RunArray(
                dims, *attributes, True, measured[array].shape, title_of(name), function.source
            )
            if any(size not in (None, found) for size, found in zip(shape, own.shape, strict=True)):
                raise ValueError(f"{array}: must have {shape} values along {dims}, not {own.shape}")
            if clash := taken & {array, *(dim for dim in dims if dim not in axes)}:
                raise ValueError(
                    f"{array}: {min(clash)} is a name in runs or datasets; choose another"
                )
            if known.setdefault(array, own) != own:
                raise ValueError(
                    f"{array}: must be alike in all runs; was {known[array][:5]}, is {own[:5]}"
                )
    except Exception as error:
        raise RequestError(f"{title_of(name)}: {_in_words(error, function.file)}") from error
    return measured


def _read_only(values: np.ndarray | None) -> np.ndarray | None:
    return None if values is None else np.broadcast_to(values, values.shape)


def _taken_apart(name: object, value: Any) -> tuple[tuple[str, ...], np.ndarray, tuple[str, str]]:
    """Return dims, values, and units and meaning of a variable as xarray takes it. Raises
    ValueError for any other.
    """
    given, numbers, *attributes = value if isinstance(value, tuple) else ((), value)
    dims, array = (given,) if isinstance(given, str) else tuple(given), np.asarray(numbers, float)
    if not all(re.fullmatch(r"[A-Za-z_]\w*", str(word), re.ASCII) for word in (name, *dims)):
        raise ValueError(
            f"{name}: names of arrays and dimensions must be words of letters, digits and _"
        )
    if len(dims) != array.ndim or len({*dims, name}) != len(dims) + 1:
        raise ValueError(
            f"{name}: must be (dims, values) with a dimension for each of {array.ndim} axes, not "
            f"{dims}"
        )
    described = dict[str, object](*attributes)
    return dims, array, (str(described.get("units", "1")), str(described.get("long_name", name)))
