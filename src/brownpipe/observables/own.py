"""The user's own observables: functions in a module, named `folder/my_module:my_function`.

A function of scene and run, with the tracks `run.tracer` (M = 1) and `run.whole` (M = N) of
`trajectory.Track` and, if they are recorded, the collisions `run.events`, returns named arrays as
xarray takes variables: a number, `(dims, values)`, or `(dims, values, attributes)` with `units` and
`long_name`. An array along the dimension of its own name is the coordinate of this dimension, and
the same in all runs. The bytes of the module's file are part of what determines the runs. Files of
runs describe these arrays completely: reading a file runs no module.
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
from typing import NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.observables.observable import Axis, Observable, RunArray
from brownpipe.observables.reserved_names import RESERVED_NAMES
from brownpipe.observables.trajectory import Events, Run
from brownpipe.scene import Scene

# CPU, of a few operations of NumPy; what a function really takes is not known before
SECONDS_PER_DISK_SAMPLE = 1e-7


OwnFunction = Callable[[Scene, Run], Mapping[str, object]]  # arrays by name
OwnArrays = Mapping[str, RunArray]  # by the name of the array
NO_OWN_ARRAYS: OwnArrays = MappingProxyType({})


def own_arrays(attributes: Mapping) -> dict[str, RunArray]:
    """Return the descriptions (JSON) of the user's own arrays in the attributes of runs, or in a
    checkpoint.
    """
    stored = json.loads(attributes.get("own_arrays", "{}"))
    arrays = {}
    for name, fields in stored.items():
        array = RunArray(*fields)  # with lists, as JSON has no tuples
        arrays[name] = array._replace(
            dims=tuple(array.dims),
            shape=tuple(array.shape),
            coordinates=tuple(array.coordinates),
        )
    return arrays


def is_coordinate(name: str, array: RunArray) -> bool:
    """Return whether an array is the coordinate of the dimension of its name."""
    return array.dims == (name,)


def own_coordinates(arrays: OwnArrays) -> dict[str, RunArray]:
    """Return the coordinates of the user's own among arrays."""
    return {name: array for name, array in arrays.items() if is_coordinate(name, array)}


class Function(NamedTuple):
    """A function that measures, and where it stands."""

    call: OwnFunction
    file: str
    source: str  # SHA-256 of the file; of one given in Python a random number


class Variable(NamedTuple):
    """An array that a function has returned."""

    dims: tuple[str, ...]
    values: np.ndarray
    units: str
    long_name: str


# given in Python, by `my_module:my_function@id`; none is ever removed
_functions: dict[str, Function] = {}


def is_own(name: str) -> bool:
    """Return whether a name is that of a function in a module."""
    return ":" in name


def title_of(name: str) -> str:
    """Return a name as it is shown: "my_module:my_function" for "sub/my_module:my_function" and for
    "my_module:my_function@7f3a", a function given in Python.
    """
    return re.sub(r"@\w+$", "", name.rpartition("/")[2])


def relative_name(folder: Path, name: str) -> str:
    """Return an observable's name from the current folder, as a study in `folder` names it.

    In "sub" "my_module:my_function" is "sub/my_module:my_function" here; "square_displacement" has
    one name everywhere.
    """
    return os.path.relpath(folder / name) if is_own(name) else name


def observable_name(observable: str | OwnFunction) -> str:
    """Return the name of an observable that is given in Python, by name or as a function.

    A function gets an `@id`: others may have its name, and its file may have changed. Raises
    RequestError for other objects.
    """
    if not callable(observable):
        return str(observable).strip()
    if not isinstance(observable, FunctionType):
        raise RequestError(f"observables: {observable!r:.60}: must be a function, made by def")
    name = f"{observable.__module__}:{observable.__name__}@{id(observable):x}"
    if name not in _functions:
        file = observable.__code__.co_filename
        _functions[name] = Function(observable, file, source=os.urandom(16).hex())
    return name


def identity(name: str) -> str:
    """Return what tells an observable from others: its name, and for one of the user's own the
    digest of its module, "my_module:my_function 3fe2...".

    Raises RequestError if its function is not found.
    """
    return f"{title_of(name)} {_find_function(name).source}" if is_own(name) else name


def own_observable(name: str) -> Observable:
    """Return the record of a function in a module, which need not be there: then `why_unfit` says
    "cannot be used: my_module.py has no function my_function".
    """

    def why_unfit(_: Scene) -> str | None:
        try:
            _find_function(name)
        except RequestError as error:
            return str(error).removeprefix(f"{name} ")
        return None

    # `measure` alone knows its arrays.
    return Observable(lambda *_: {}, {}, SECONDS_PER_DISK_SAMPLE, why_unfit=why_unfit)


def _find_function(name: str) -> Function:
    """Return a function in a module. Raises RequestError, which begins with its name, if it is not
    there.
    """
    if name in _functions:
        return _functions[name]
    module, _, function = name.rpartition(":")
    file = f"{module}.py"
    try:
        source = Path(file).read_bytes()
        call = _definitions(file, source).get(function)
    except Exception as error:
        raise RequestError(f"{name} cannot be used: {_describe_error(error, file)}") from error
    if not callable(call):
        raise RequestError(f"{name} cannot be used: {file} has no function {function}")
    return Function(call, file, hashlib.sha256(source).hexdigest())


@lru_cache(maxsize=8)
def _definitions(file: str, source: bytes) -> dict[str, object]:
    """Return what a module defines. It is run from these bytes: a compiled copy of it could be of
    older ones.
    """
    variables: dict[str, object] = {"__name__": Path(file).stem, "__file__": file}
    exec(compile(source, file, "exec"), variables)
    return variables


def _describe_error(error: Exception, file: str) -> str:
    """Return an exception with the last line of a file that it passed."""
    words = f"{type(error).__name__}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if frame.filename == file]
    return f"{words} ({file}, line {lines[-1]})" if lines else words


def measure(
    name: str, scene: Scene, run: Run, axes: Mapping[str, Axis], known: dict[str, RunArray]
) -> dict[str, np.ndarray]:
    """Return the arrays of a function in a module for a run, and add their descriptions to `known`.

    `axes` are the dimensions with coordinates. Raises RequestError for whatever goes wrong in a
    function, and for arrays that are not numbers, or are unlike those of the runs before.
    """
    function = _find_function(name)
    arrays: dict[str, np.ndarray] = {}
    try:
        returned = function.call(scene, _read_only(run))
        if not isinstance(returned, Mapping):
            raise TypeError(f"must return a mapping of names to arrays, not {returned!r:.40}")
        if not returned:
            raise ValueError("must return an array, not an empty mapping")
        for array, value in returned.items():
            variable = _as_variable(array, value)
            _refuse_misfit(array, variable, scene, axes)
            description = RunArray(
                variable.dims, variable.units, variable.long_name, shape=variable.values.shape
            )
            if is_coordinate(array, description):  # several functions may have it
                description = description._replace(coordinates=_as_coordinates(array, variable))
            else:
                arrays[array] = variable.values
                description = description._replace(
                    averaged=True, observable=title_of(name), source=function.source
                )
            before = known.setdefault(array, description)
            if before != description:
                raise ValueError(
                    f"{array}: must be alike in all runs; {_change(before, description)}"
                )
        _refuse_unused_coordinates({array: known[array] for array in returned})
        _refuse_lengths(known)
    except Exception as error:
        raise RequestError(f"{title_of(name)}: {_describe_error(error, function.file)}") from error
    return arrays


def _change(before: RunArray, description: RunArray) -> str:
    """Return how an array is described differently from a run before."""
    if before[:5] == description[:5] and before.coordinates:
        return "its values have changed"
    return f"was {before[:5]}, is {description[:5]}"


def _as_coordinates(name: str, variable: Variable) -> tuple[float, ...]:
    """Return the values of a coordinate. Raises ValueError if they do not ascend."""
    values = variable.values
    if not np.isfinite(values).all() or np.any(np.diff(values) <= 0):
        raise ValueError(f"{name}: must be finite and ascending, as the coordinate of {name}")
    return tuple(values.tolist())


def _refuse_unused_coordinates(arrays: OwnArrays) -> None:
    """Raise ValueError for a coordinate that none of a function's arrays has."""
    for coordinate in own_coordinates(arrays):
        with_dimension = [name for name, array in arrays.items() if coordinate in array.dims]
        if with_dimension == [coordinate]:
            raise ValueError(f"{coordinate}: is a coordinate, and no array is along it")


def _refuse_lengths(arrays: OwnArrays) -> None:
    """Raise ValueError for an array that is not as long as the coordinate of a dimension."""
    for coordinate, values in own_coordinates(arrays).items():
        for name, array in arrays.items():
            lengths = dict(zip(array.dims, array.shape, strict=True))
            if lengths.get(coordinate) not in (None, *values.shape):
                raise ValueError(
                    f"{name}: must have {values.shape} values along ('{coordinate}',), not "
                    f"{array.shape}"
                )


def _read_only(run: Run) -> Run:
    """Return the tracks and collisions of a run in arrays that cannot be written to."""
    tracer = run.tracer.transformed(_not_writable)
    whole = run.every_disk.transformed(_not_writable)
    events = None if run.events is None else Events(*map(_not_writable, run.events))
    return Run(tracer, whole, events)


def _not_writable(values: np.ndarray) -> np.ndarray:
    """Return a view of an array that cannot be written to."""
    return np.broadcast_to(values, values.shape)


def _refuse_misfit(name: str, variable: Variable, scene: Scene, axes: Mapping[str, Axis]) -> None:
    """Raise ValueError for an array whose length along a dimension of `axes` is another, and for
    names that runs or datasets have already.
    """
    dims = variable.dims
    shape = variable.values.shape
    lengths = tuple(len(axes[dim].coordinates(scene)) if dim in axes else None for dim in dims)
    for length, size in zip(lengths, shape, strict=True):
        if length not in (None, size):
            raise ValueError(f"{name}: must have {lengths} values along {dims}, not {shape}")
    own_dims = {dim for dim in dims if dim not in axes}
    clashes = RESERVED_NAMES & {name, *own_dims}
    if clashes:
        raise ValueError(f"{name}: {min(clashes)} is a name in runs or datasets; choose another")


def _as_variable(name: object, value: object) -> Variable:
    """Return a variable from what xarray takes as one: `3.0`, `("time", values)`, or `(["time"],
    values, {"units": "1"})`. Raises ValueError for any other, and without any value.
    """
    along, numbers, *attributes = value if isinstance(value, tuple) else ((), value)
    dims = (along,) if isinstance(along, str) else tuple(along)
    try:
        array = np.asarray(numbers, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: must be numbers: {error}") from error
    is_word = re.compile(r"[A-Za-z_]\w*", re.ASCII).fullmatch
    if not all(is_word(str(word)) for word in (name, *dims)):
        raise ValueError(
            f"{name}: names of arrays and dimensions must be words of letters, digits and _"
        )
    is_misnamed = name in dims and dims != (name,)
    if len(dims) != array.ndim or len({*dims}) != len(dims) or is_misnamed:
        raise ValueError(
            f"{name}: must be (dims, values) with a dimension for each of {array.ndim} axes, not "
            f"{dims}"
        )
    if not array.size:
        raise ValueError(f"{name}: must have values, and is of shape {array.shape}")
    described = dict[str, object](*attributes)
    units = str(described.get("units", "1"))
    long_name = str(described.get("long_name", name))
    return Variable(dims, array, units, long_name)
