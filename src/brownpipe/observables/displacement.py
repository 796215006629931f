"""Squared displacement of the tracer in one run, also along x and y alone, its rate of change, and
its square. T sample times, M disks.
"""

import numpy as np

from brownpipe.observables.averages import (
    Factors,
    Product,
    Samples,
    averaged,
    averaged_by_component,
)
from brownpipe.observables.observable import Axis, Observable, RunArray, only_where_axes_differ
from brownpipe.observables.trajectory import Track
from brownpipe.scene import Scene


def square_displacement(scene: Scene, track: Track, average: str) -> dict[str, np.ndarray]:
    """Return the squared displacement and half its rate of change, (T,) each, of one run, and the
    squared displacements along x and y (2, T); where walls make the motion along x and y differ
    also half their rates of change (2, T).

    Means over runs of the first two are the MSD <r^2(t)>, for which eq. (12) is a model, and
    <v(t).(r(t) - r(0))>, which is (1/2) d<r^2>/dt without a difference quotient. `average`: of the
    tracer from t = 0 (`runs`), of the tracer from every sample as time origin (`origins`; Frenkel
    and Smit, Understanding Molecular Simulation, section 4.4.2), or of all disks equal to it
    (`disks`).
    """
    if scene.box.axes_differ:
        return averaged_by_component(scene, track, average, COMPONENT_PRODUCTS)
    along_x, along_y, growth = averaged(scene, track, average, (*SQUARES, GROWTH))
    return {
        "square_displacement": along_x + along_y,
        "displacement_velocity": growth,
        "component_square_displacement": np.stack([along_x, along_y]),
    }


def quartic_displacement(scene: Scene, track: Track, average: str) -> dict[str, np.ndarray]:
    """Return the fourth power of the displacement (T,) of one run, averaged like the squared
    displacement; where walls make the motion along x and y differ also those of its components (2,
    T).

    Means over runs of both make up the non-Gaussian parameter <r^4>/(2 <r^2>^2) - 1, along x alone
    <x^4>/(3 <x^2>^2) - 1.
    """
    if not scene.box.axes_differ:
        (quartic,) = averaged(scene, track, average, (QUARTIC,))
        return {"quartic_displacement": quartic}
    quartic, along_x, along_y = averaged(scene, track, average, (QUARTIC, *COMPONENT_QUARTICS))
    return {
        "quartic_displacement": quartic,
        "component_quartic_displacement": np.stack([along_x, along_y]),
    }


# -- products of two samples: displacements a and b from one point, r = b - a ----------------------


def _component_square(axis: int) -> Product:
    """Return the squared displacement along x (0) or y (1): a^2 + b^2 - 2 a b."""

    def factors(earlier: Samples, later: Samples) -> Factors:
        a = earlier.displacement[axis]
        b = later.displacement[axis]
        yield a * a, later.present
        yield earlier.present, b * b
        yield -2 * a, b

    return Product(lambda pairs: pairs.displacement[..., axis] ** 2, factors)


def _component_quartic(axis: int) -> Product:
    """Return the fourth power of the displacement along x (0) or y (1): a^4 - 4 a^3 b + 6 a^2 b^2 -
    4 a b^3 + b^4.
    """

    def factors(earlier: Samples, later: Samples) -> Factors:
        a = earlier.displacement[axis]
        b = later.displacement[axis]
        yield a**4, later.present
        yield -4 * a**3, b
        yield 6 * a**2, b**2
        yield -4 * a, b**3
        yield earlier.present, b**4

    return Product(lambda pairs: pairs.displacement[..., axis] ** 4, factors)


def _component_growth(axis: int) -> Product:
    """Return v x = v b - v a along x (0) or y (1), with the velocity v of the later sample."""

    def factors(earlier: Samples, later: Samples) -> Factors:
        v = later.velocity[axis]
        yield earlier.present, v * later.displacement[axis]
        yield -earlier.displacement[axis], v

    return Product(
        lambda pairs: pairs.displacement[..., axis] * pairs.later_velocity[..., axis], factors
    )


def _growth_factors(earlier: Samples, later: Samples) -> Factors:
    """v.r = v.b - v.a, with the velocity v of the later sample."""
    a_x, a_y = earlier.displacement
    b_x, b_y = later.displacement
    v_x, v_y = later.velocity
    yield earlier.present, v_x * b_x + v_y * b_y
    yield -a_x, v_x
    yield -a_y, v_y


def _quartic_factors(earlier: Samples, later: Samples) -> Factors:
    """r^4 = |a|^4 + |b|^4 + 4 |a|^2 |b|^2 + 2 (a_x^2 - a_y^2)(b_x^2 - b_y^2) + 8 a_x a_y b_x b_y -
    4 |a|^2 a.b - 4 |b|^2 a.b.
    """
    a_x, a_y = earlier.displacement
    b_x, b_y = later.displacement
    a2 = earlier.square
    b2 = later.square
    yield a2 * a2, later.present
    yield earlier.present, b2 * b2
    yield 4 * a2, b2
    yield 2 * (a_x * a_x - a_y * a_y), b_x * b_x - b_y * b_y
    yield 8 * a_x * a_y, b_x * b_y
    yield -4 * a2 * a_x, b_x
    yield -4 * a2 * a_y, b_y
    yield -4 * a_x, b2 * b_x
    yield -4 * a_y, b2 * b_y


def dot(vectors: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return scalar products (T, M) of vectors (T, M, 2) and velocities (T, M, 2) or (1, M, 2)."""
    return np.einsum("tmc,tmc->tm", vectors, velocity)


def squared(displacements: np.ndarray) -> np.ndarray:
    """Return squared lengths (T, M) of displacements (T, M, 2)."""
    squares = displacements**2
    # .sum(axis=-1) takes 20 times as long along an axis of two.
    return squares[..., 0] + squares[..., 1]


SQUARES = (_component_square(0), _component_square(1))  # whose sum is r^2
GROWTH = Product(lambda pairs: dot(pairs.displacement, pairs.later_velocity), _growth_factors)
COMPONENT_PRODUCTS = {
    "square_displacement": SQUARES,
    "displacement_velocity": (_component_growth(0), _component_growth(1)),
}
QUARTIC = Product(lambda pairs: squared(pairs.displacement) ** 2, _quartic_factors)
COMPONENT_QUARTICS = (_component_quartic(0), _component_quartic(1))
AXES = {"component": Axis("1", "Cartesian component", lambda _: ["x", "y"])}
SQUARE_DISPLACEMENT = Observable(
    square_displacement,
    {
        "square_displacement": RunArray(
            ("time",), "length^2", "squared displacement of the tracer (see `average`)"
        ),
        "displacement_velocity": RunArray(
            ("time",), "length^2/time", "v(t).(r(t) - r(0)) of the tracer"
        ),
        "component_square_displacement": RunArray(
            ("component", "time"), "length^2", "squared displacement of the tracer along x and y"
        ),
        "component_displacement_velocity": RunArray(
            ("component", "time"),
            "length^2/time",
            "where walls make the axes differ: v_x(t) (x(t) - x(0)) of the tracer, and along y",
        ),
    },
    tracks_needed="tracer",
    axes=AXES,
    absent=only_where_axes_differ("component_displacement_velocity"),
    seconds_per_disk_sample=3.6e-8,
)
QUARTIC_DISPLACEMENT = Observable(
    quartic_displacement,
    {
        "quartic_displacement": RunArray(
            ("time",), "length^4", "fourth power of the tracer's displacement"
        ),
        "component_quartic_displacement": RunArray(
            ("component", "time"),
            "length^4",
            "where walls make the axes differ: fourth power of the tracer's displacement along x "
            "and y",
        ),
    },
    tracks_needed="tracer",
    axes=AXES,
    absent=only_where_axes_differ("component_quartic_displacement"),
    seconds_per_disk_sample=3.6e-8,
)
