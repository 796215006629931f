"""Hard disks between walls: density at contact, force and hits; density profiles of a thin gas and
a dense fluid.

Length in diameters. Both scenes have equal disks of diameter, mass and kT 1, whose centres have
room in a square.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq
from xarray import Dataset

from brownpipe import theory
from brownpipe.figures.style import DATA, GREY, MODEL, grid
from validation import fundamental_measure
from validation.comparison import Comparison
from validation.result import Result
from validation.transport import fixed_number

AT = (0, 10, 20, 30)  # bins of the profile of the gas that are compared
BULK = (2.0, 4.0)  # distances from the walls that count as bulk in the dense fluid
NODES = 80  # of the quadrature in each direction; 2e-4 of the third virial coefficient
FORCE = "force on the walls, same runs"


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons of both scenes."""
    gas, fluid = (_case(datasets["walls"], scene) for scene in ("walls_gas", "walls"))
    rows = [row for case, phi in ((gas, 0.05), (fluid, 0.4)) for row in _at_contact(case, phi)]
    z, n, error = _profile(gas)
    bulk, relative = _bulk_density(gas)
    series = gas_profile(z[list(AT)], bulk, _side(gas))
    for k, expected in zip(AT, series, strict=True):
        spread = np.hypot(error[k], relative * expected)
        name = f"$n/n_{{\\mathrm{{bulk}}}}$ at $z = {z[k]:.4g}$, $\\phi = 0.05$"
        source = "exact to second order in the density"
        rows.append(Comparison(name, expected / bulk, 0.0, n[k] / bulk, spread / bulk, source))
    (there, _), (middle, spread) = _bulk_density(fluid), _in_the_middle(fluid)
    name, source = (
        "$\\phi$ in the middle, mean $\\phi = 0.4$",
        "Luding (2001), from the force on the walls",
    )
    disk = np.pi / 4  # area
    rows.append(
        Comparison(name, disk * there, 0.0, disk * middle, disk * spread, source, approximate=True)
    )
    return [*rows, *_at_the_layers(fluid)]


def _case(data: Dataset, scene: str) -> Dataset:
    return (
        data.sel(scene=scene)
        .isel(engine=0)
        .dropna("particles", how="all", subset=["wall_pressure"])
        .squeeze()
    )


def _side(case: Dataset) -> float:
    """Side of the square in which the centres have room."""
    return float(case.box_width) - 1.0


def _density_by_force(case: Dataset) -> tuple[float, float]:
    """Density at the walls from the force on them, F/(kT length of the walls), and its standard
    error.
    """
    scale = (
        float(case.particles) / float(case.box_width) / _side(case)
    )  # N kT/A, box_width over _side
    return scale * float(case.wall_compressibility), scale * float(
        case.wall_compressibility_standard_error
    )


def _at_contact(case: Dataset, phi: float) -> list[Comparison]:
    """Density at the walls from the profile, and from the hits, over that from the force."""
    force, force_error = _density_by_force(case)
    hits = np.sqrt(2 * np.pi) / (4 * _side(case) * float(case.duration))
    measured = {
        "$n(0) kT \\ell_{\\mathrm{acc}}/F$": (
            case.contact_density,
            case.contact_density_standard_error,
        ),
        "$\\Gamma_{\\mathrm{wall}} \\sqrt{2 \\pi m kT}/F$": (
            hits * case.wall_collisions,
            hits * case.wall_collisions_standard_error,
        ),
    }
    return [
        Comparison(
            f"{name}, $\\phi = {phi}$",
            1.0,
            0.0,
            float(n) / force,
            np.hypot(float(error), force_error) / force,
            FORCE,
        )
        for name, (n, error) in measured.items()
    ]


def _profile(case: Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return distance (B,), density (B,) and its standard error."""
    case = case.dropna("wall_distance", subset=["density_profile"])
    return (
        case.wall_distance.values,
        case.density_profile.values,
        case.density_profile_standard_error.values,
    )


def _in_the_middle(case: Dataset) -> tuple[float, float]:
    """Return the density far from all walls and its standard error.

    The profile far from one wall is a mean along this wall, over the layers in front of the two
    walls beside it, too: the excess in these layers over the bulk is subtracted.
    """
    z, n, _ = _profile(case)
    far, error = _far_from_the_wall(case)
    layers = (n - far).sum() * (z[1] - z[0])
    return far - 2 * layers / _side(case), error


def _far_from_the_wall(case: Dataset) -> tuple[float, float]:
    """Return the mean density at the distances BULK, along the whole wall, and a bound on its
    standard error.
    """
    z, n, error = _profile(case)
    inside = (z > BULK[0]) & (z < BULK[1])
    return n[inside].mean(), error[inside].mean()


def _at_the_layers(case: Dataset) -> list[Comparison]:
    """Density in contact, and where theory has its first minimum and maximum, over that far from
    the wall.
    """
    z, n, error = _profile(case)
    far, far_error = _far_from_the_wall(case)
    layers = _layers_in_theory(case, z)
    low = int(np.argmin(layers))
    high = low + int(np.argmax(layers[low:]))
    (at_walls, spread), (in_contact,) = (
        _density_by_force(case),
        _layers_in_theory(case, np.zeros(1)),
    )
    rows = [("in contact", in_contact, at_walls, spread)]
    for name, k in (("minimum", low), ("maximum", high)):
        rows.append((f"at the first {name}, $z = {z[k]:.4g}$", layers[k], n[k], error[k]))
    source = "fundamental measure theory of Roth, Mecke and Oettel (2012)"
    return [
        Comparison(
            f"$n/n_{{\\mathrm{{far}}}}$ {where}, $\\phi = 0.4$",
            expected,
            0.0,
            found / far,
            np.hypot(spread, found / far * far_error) / far,
            source,
            approximate=True,
        )
        for where, expected, found, spread in rows
    ]


def _layers_in_theory(case: Dataset, z: np.ndarray) -> np.ndarray:
    """Return the density (B,) at distances `z` (B,), over that far from the wall, by fundamental
    measure theory.

    The layers in front of the two walls at right angles to this one raise both densities by the
    same factor, but not in the corners: these count in first order of the density.
    """
    bulk, side = _bulk_density(case)[0], _side(case)
    at, n = fundamental_measure.wall_profile(np.pi / 4 * bulk)
    far = n[(at > BULK[0]) & (at < BULK[1])].mean()
    beside = _missing_area(np.array([*z, BULK[0]]), side) - _missing_area(np.array([*z, BULK[0]]))
    in_contact = fundamental_measure.contact(n)
    return (
        np.interp(z, [0.0, *at], [in_contact, *n]) / far * (1 + bulk * (beside[:-1] - beside[-1]))
    )


def _bulk_density(case: Dataset) -> tuple[float, float]:
    """Return the density far from the walls that belongs to the force on them, and its relative
    standard error.

    F/(kT length) = n Z_N(n), Z by Luding's equation of state and the effect of a fixed number N of
    disks, plus the excess of the corners in the first order of n.
    """
    at_walls, error = _density_by_force(case)
    corners = _missing_area(np.zeros(1), _side(case))[0] - np.pi / 2

    def excess(n: float) -> float:
        phi = np.pi / 4 * n
        z_n = _compressibility(phi) + fixed_number(_compressibility, phi, int(case.particles))
        return float(n * z_n + corners * n**2 - at_walls)

    n = brentq(excess, 0.1 * at_walls, at_walls)
    slope = (excess(1.001 * n) - excess(0.999 * n)) / 0.002  # dF/d ln n
    return n, error / slope


def _compressibility(phi: float) -> float:
    return float(theory.compressibility(phi, theory.contact_value(phi)))


# --- theory of a thin gas


def gas_profile(z: np.ndarray, n: float, side: float = np.inf) -> np.ndarray:
    """Return the density (B,) at distances `z` (B,) from the walls, to second order in the bulk
    density n.

    ln n(z) - ln n is the change of the one-body direct correlation function, whose virial series
    has the clusters of two and of three disks (Mayer's f = -1 where two overlap). With the area a
    of the unit circle around z that is beyond the wall, it is

        n a(z) - n^2 [integral of a(z') over the rest of the circle] + n^2 M(z)/2,

    M the measure of pairs of points that overlap each other and the disk at z, not both of them
    inside. In first order a is averaged along a wall of length `side`, which includes its corners,
    and has the factor n - 1/side^2, as each of N disks has N - 1 others. At contact a = pi/2 and
    the second order gives the third virial coefficient, as it must, since n(0) kT is the pressure.
    """
    flat = _missing_area(z)
    node, weight = np.polynomial.legendre.leggauss(NODES)
    second, everywhere = np.empty(len(z)), _triples(-1)
    for k, at in enumerate(z):
        low = -min(at, 1.0)
        u, du = low + (node + 1) * (1 - low) / 2, weight * (1 - low) / 2
        chord = 2 * np.sqrt(1 - u**2)
        second[k] = (
            flat[k] ** 2 / 2
            - (du * chord * _missing_area(at + u)).sum()
            + (everywhere - _triples(low)) / 2
        )
    along = flat if np.isinf(side) else _missing_area(z, side)
    return n * (1 + (n - side**-2.0) * along + n**2 * second)


def _missing_area(z: np.ndarray, side: float = np.inf) -> np.ndarray:
    """Return the area of the unit circle around points at `z` (B,) from a wall that is beyond the
    walls.

    With a `side` it is the mean along a wall of that length between two others at right angles to
    it.
    """
    near = np.minimum(z, 1.0)
    flat = np.arccos(near) - near * np.sqrt(1 - near**2)
    if np.isinf(side):
        return flat
    node, weight = np.polynomial.legendre.leggauss(NODES)
    y = (node + 1) / 2  # up to a diameter from the corner
    inside = theory.disk_area_in_rectangle(1.0, z[:, None] - side / 2, y - side / 2, side, side)
    return flat + 2 / side * (weight / 2 * (np.pi - inside - flat[:, None])).sum(axis=1)


def _triples(low: float) -> float:
    """Return the measure of pairs of points with u > `low` that overlap each other and the disk at
    u = 0.
    """
    node, weight = np.polynomial.legendre.leggauss(NODES)
    u, du = low + (node + 1) * (1 - low) / 2, weight * (1 - low) / 2
    first, second = np.sqrt(1 - u**2)[:, None], np.sqrt(1 - u**2)
    apart = u[:, None] - u
    reach = np.sqrt(np.maximum(1 - apart**2, 0.0))
    beyond = np.maximum(first + second - reach, 0.0) ** 2
    cut = (
        beyond
        - np.maximum(second - first - reach, 0.0) ** 2
        - np.maximum(first - second - reach, 0.0) ** 2
    )
    area = np.where(
        np.abs(apart) < 1, 4 * first * second - cut, 0.0
    )  # of (x1, x2) within the strips and near another
    return float((du[:, None] * du * area).sum())


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw both profiles over the bulk density, with their theories and the contact density from
    the force.
    """
    figure, (panels,) = grid(1, 2, 4.6, 3.8)
    for axes, scene, phi in zip(panels, ("walls_gas", "walls"), (0.05, 0.4), strict=True):
        case = _case(datasets["walls"], scene)
        (z, n, error), (bulk, _) = _profile(case), _bulk_density(case)
        axes.errorbar(
            z,
            n / bulk,
            2 * error / bulk,
            fmt=".",
            color=DATA,
            markersize=3,
            label="brownpipe, 95 %",
        )
        axes.plot(
            0,
            _density_by_force(case)[0] / bulk,
            "D",
            color=MODEL,
            clip_on=False,
            label="from the force",
        )
        if scene == "walls_gas":
            line = np.linspace(0.001, 2, 41)
            axes.plot(
                line,
                gas_profile(line, bulk, _side(case)) / bulk,
                color=GREY,
                label="second order in $n$",
            )
        else:
            line = np.linspace(0, 5, 401)
            layers = _layers_in_theory(case, line) * _far_from_the_wall(case)[0] / bulk
            axes.plot(line, layers, color=GREY, label="fundamental measure theory")
        axes.set_title(f"$\\phi = {phi}$")
        axes.set_xlim(0, 2 if scene == "walls_gas" else 5)
        axes.set_xlabel("distance of the edge from the wall, diameters")
        axes.legend()
    panels[0].set_ylabel("$n(z)/n_{\\mathrm{bulk}}$")
    return figure


RESULT = Result(
    "walls",
    ("walls",),
    compare,
    draw,
    {"walls": {"seeds": 10}},  # fails if the force is 5 % off
)
