"""An estimator of the user's own: what is refused, in one line that names it and its variable."""

from collections.abc import Collection, Mapping
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis.estimator import Estimator
from brownpipe.analysis.variables import CASE_DIMS, Variable, with_uncertainties
from brownpipe.errors import AnalysisError
from brownpipe.provenance import module_of


def title_with_source(estimator: Estimator) -> str:
    """Return the name of an estimator, with its module and the digest of that in brackets; the name
    alone if it is of no file, as in a notebook.
    """
    module, source = module_of(estimator.columns)
    return f"{estimator.name} [{module} {source[:12]}]" if source else estimator.name


def refuse_unfit(
    estimator: Estimator, variables: Mapping[str, Variable], coordinates: Mapping[str, Variable]
) -> None:
    """Refuse an estimator whose names the `variables` and `coordinates` of a dataset have already,
    and one whose variables have other dimensions than those of a case and of coordinates.
    """
    refuse_names(estimator, {*variables, *coordinates})
    own_variables = with_uncertainties(estimator.variables)
    for name in own_variables.keys() & estimator.coordinates.keys():
        _refuse(estimator, name, "must be a variable or a coordinate, not both")
    for name, coordinate in estimator.coordinates.items():
        if len(coordinate.dims) != 1:
            _refuse(estimator, name, f"must have one dimension, not {coordinate.dims}")
    dimensions = {*coordinates, *estimator.coordinates}
    for name, variable in estimator.variables.items():
        if variable.dims[: len(CASE_DIMS)] != CASE_DIMS:
            _refuse(estimator, name, f"dimensions must begin with {CASE_DIMS}, not {variable.dims}")
        for dimension in variable.dims:
            if dimension not in dimensions:
                _refuse(estimator, name, f"dimension {dimension} must be among its coordinates")


def refuse_names(estimator: Estimator, taken_names: Collection[str]) -> None:
    """Refuse an estimator whose names are taken."""
    for name in (*with_uncertainties(estimator.variables), *estimator.coordinates):
        if name in taken_names:
            _refuse(estimator, name, "is a name in datasets; choose another")


def refuse_misshapen(estimator: Estimator, values: Mapping[str, ArrayLike]) -> None:
    """Refuse values of an estimator's variables that are not as long as those of their dimensions,
    among all `values` of a case.
    """
    for name, variable in with_uncertainties(estimator.variables).items():
        if name not in values:
            continue
        for dimension in variable.dims:
            if dimension not in values:
                _refuse(estimator, name, f"{dimension}, its dimension, has no values")
        expected = tuple(
            np.size(values[dimension]) for dimension in variable.dims[len(CASE_DIMS) :]
        )
        shape = np.shape(values[name])
        if shape != expected:
            own_dimensions = variable.dims[len(CASE_DIMS) :]
            _refuse(
                estimator, name, f"must have {expected} values along {own_dimensions}, not {shape}"
            )


def _refuse(estimator: Estimator, name: str, problem: str) -> NoReturn:
    raise AnalysisError(f"estimator {estimator.name}: {name}: {problem}")
