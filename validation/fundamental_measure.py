"""Density profile of hard disks at a hard wall by the fundamental measure theory of Roth, Mecke and
Oettel (2012).

The excess free energy, over kT, is the integral of

    Phi = -n0 ln(1 - n2) + (C0 n1^2 + C1 n1v . n1v + C2 n1t : n1t) / (4 pi (1 - n2)),
    C0 = (a + 2)/3, C1 = (a - 4)/3, C2 = (2 - 2a)/3, a = 11/4,

with weighted densities: n2 is the density averaged over a disk, times its area; n1, the vector n1v
and the tensor n1t are its integrals over the circumference, weighted with 1, the unit vector r and
r r; n0 = n1/(2 pi R). In a homogeneous fluid this is scaled-particle theory. Its direct correlation
function is that of Thorneywork et al. (2018); with any other `a` it is not. Length in diameters.
"""

import numpy as np

A = 11 / 4
C0, C1, C2 = (A + 2) / 3, (A - 4) / 3, (2 - 2 * A) / 3
RADIUS = 0.5
CELLS = 100  # in a radius; contact density within 3e-5 at phi = 0.4
DEPTH = 8.0  # distance from the wall where the fluid counts as homogeneous
MIXING, STEPS, CHANGE = (
    0.2,
    1000,
    1e-10,
)  # of the iteration; largest change of ln n in its last step


def wall_profile(phi: float) -> tuple[np.ndarray, np.ndarray]:
    """Return distances (B,) of the edge from the wall and the density (B,) there over that in the
    bulk.

    `phi` is the packing fraction in the bulk. The distances are the centres of equal cells, in
    which the density is constant. With the one-body direct correlation function c, ln n(z) = ln
    n_bulk + c(z) - c_bulk.
    """
    bulk, cells = phi / (np.pi * RADIUS**2), round(DEPTH / RADIUS) * CELLS
    z = (np.arange(cells) + 0.5) * RADIUS / CELLS
    weights = projected_weights()
    rest = np.full(2 * CELLS, bulk)  # a diameter beyond the end
    far = direct_correlation(np.full(4 * CELLS + 1, bulk), weights)[-1]
    log_ratio = np.zeros(cells)
    for _ in range(STEPS):
        c = direct_correlation(np.concatenate([bulk * np.exp(log_ratio), rest]), weights)
        change = c - far - log_ratio
        log_ratio += MIXING * change
        if np.max(np.abs(change)) < CHANGE:
            return z, np.exp(log_ratio)
    raise RuntimeError(f"no density profile at phi = {phi} after {STEPS} steps")


def contact(profile: np.ndarray) -> float:
    """Return the profile at contact, by the straight line through its first two cells."""
    return float(1.5 * profile[0] - 0.5 * profile[1])


def direct_correlation(density: np.ndarray, weights: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return the one-body direct correlation function (B,) for a density (B + 2 CELLS,), but not in
    its last diameter.

    The wall is in front of the first cell: no density there.
    """
    n1, v, n2 = (np.convolve(density, weight)[: len(density)] for weight in weights)
    along, across = n2 / RADIUS, n1 - n2 / RADIUS  # n1t_yy, n1t_zz: along and across the wall
    free = 1 - n2
    quadratic = C0 * n1**2 + C1 * v**2 + C2 * (along**2 + across**2)
    by_n1 = -np.log(free) / (2 * np.pi * RADIUS) + (C0 * n1 + C2 * across) / (2 * np.pi * free)
    by_v = C1 * v / (2 * np.pi * free)
    by_n2 = n1 / (2 * np.pi * RADIUS * free) + quadratic / (4 * np.pi * free**2)
    by_n2 += C2 * (along - across) / (2 * np.pi * RADIUS * free)
    slopes = zip((by_n1, by_v, by_n2), weights, strict=True)
    return -np.sum([np.convolve(slope, weight[::-1], "valid") for slope, weight in slopes], axis=0)


def projected_weights() -> tuple[np.ndarray, ...]:
    """Return the weights (2 CELLS + 1,) of n1, n1v and n2, projected on the normal of the wall,
    integrated over cells.

    With the distance R sin t along the normal, both halves of the circumference have 2R dt, the
    unit vector sin t. n1t_yy has cos^2 t, so that it is n2/R; n1t_zz is the rest of n1.
    """
    edges = np.clip((np.arange(2 * CELLS + 2) - CELLS - 0.5) / CELLS, -1, 1)
    t = np.arcsin(edges)
    return (
        2 * RADIUS * np.diff(t),
        -2 * RADIUS * np.diff(np.cos(t)),
        RADIUS**2 * np.diff(t + np.sin(2 * t) / 2),
    )
