"""Whether the disks of a scene find places: by random sequential insertion, and on a triangular
lattice.

Random sequential insertion of equal disks saturates at a packing fraction of 0.547 (E. L.
Hinrichsen, J. Feder & T. Jossang, J. Stat. Phys. 44, 793 (1986)). Here it ends earlier, at
SATURATION, when a disk has found no place in `insertion.TRIES` tries. Disks are inserted from large
to small: to disks of radius r, a larger disk of radius R is an obstacle of radius R + MARGIN r, and
a wall an inaccessible strip of width MARGIN r. docs/decisions.md has the measurements.
"""

import math

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.scene import Box, Scene

LIMIT = 0.547  # packing fraction that random insertion of equal disks approaches
SATURATION = 0.541  # at which it ends here
MARGIN = 0.34  # in radii of the disk to be inserted
# ratio of disks to places above which some runs, and all runs, fail
SOME_FAIL, ALL_FAIL = 0.95, 1.05
JAMMED = 0.84  # packing fraction at which disks pushed apart in disorder have no more room
# tries of insertion for each place, times the squared distance from LIMIT; measured
TRIES_NEAR_LIMIT = 0.09
# over growing disks, times the squared distance from JAMMED, at least CLOSEST; measured
SWEEPS_NEAR_JAMMED = 0.8
CLOSEST = 0.01  # where the number of sweeps comes near the most that are made
TRIES_PER_SWEEP = 3  # that take as long for each disk; measured
# of each disk of the scene, after which a raster tells failures (`insertion`): so many answers take
# as long as a try that is compared with other disks; measured
TRIES_COMPARED, ANSWERS_PER_TRY = 105, 7


# -- random insertion ------------------------------------------------------------------------------


def _insertions(scene: Scene) -> list[tuple[int, float]]:
    """Return for each radius, from large to small, how many disks are inserted at random, and how
    many find places.

    It is empty for a lattice, a list of disks, and a lone disk, which always find their places.
    """
    if scene.placement not in ("auto", "random") or scene.particles < 2:
        return []
    count_of_radius = _count_of_radius(scene)
    insertions = []
    larger: dict[float, int] = {}
    for radius, count in count_of_radius.items():
        walls = 2 * scene.box.margins(MARGIN * radius)
        area = float(np.prod(scene.box.size - walls))
        area -= sum(n * math.pi * (big + MARGIN * radius) ** 2 for big, n in larger.items())
        places = SATURATION * area / (math.pi * radius**2)
        if larger or count > 1:  # the first disk always finds a place
            insertions.append((count, max(places, 1e-3)))
        larger[radius] = count
    return insertions


def _count_of_radius(scene: Scene) -> dict[float, int]:
    """Return how many disks there are of each radius, from large to small."""
    counts: dict[float, int] = {}
    for species in sorted(scene.species, key=lambda species: species.radius, reverse=True):
        if species.count:
            counts[species.radius] = counts.get(species.radius, 0) + species.count
    return counts


def crowding(scene: Scene) -> float:
    """Return the ratio of the number of disks to that of places for them, the largest over all
    radii.

    It is 0 where none are inserted at random.
    """
    return max((count / places for count, places in _insertions(scene)), default=0.0)


def tries_to_place(scene: Scene) -> float:
    """Return how many tries it takes to place all disks of a scene, good to a factor of 2, as
    compared with other disks: those that a raster answers count less.

    For each place they grow as the inverse square of the distance from LIMIT (Hinrichsen et al.).
    For disks that grow, sweeps count as the tries that take as long; their number grows as the
    inverse square of the distance from JAMMED.
    """
    if is_grown(scene):
        sweeps = SWEEPS_NEAR_JAMMED / max(JAMMED - scene.packing_fraction, CLOSEST) ** 2
        return scene.particles * TRIES_PER_SWEEP * sweeps
    tries = 0.0
    for count, places in _insertions(scene):
        filled = SATURATION * min(count / places, 1.0)
        near_limit = (LIMIT - filled) ** -2 - LIMIT**-2
        tries_of_radius = places / SATURATION * TRIES_NEAR_LIMIT * near_limit
        compared = min(tries_of_radius, TRIES_COMPARED * scene.particles)
        tries += compared + (tries_of_radius - compared) / ANSWERS_PER_TRY
    return tries


def is_grown(scene: Scene) -> bool:
    """Return whether disks are grown in every run, as random insertion is certain to fail."""
    return scene.placement == "auto" and crowding(scene) > ALL_FAIL


def never_placed(scene: Scene) -> bool:
    """Return whether a disk is expected to find no place in every run; with `auto` disks grow up to
    JAMMED.
    """
    cannot_grow = scene.placement == "random" or scene.packing_fraction > JAMMED
    return crowding(scene) > ALL_FAIL and cannot_grow


def placement_caution(scene: Scene) -> str | None:
    """Return one line of caution if random insertion is expected to fail in some runs of a scene,
    or the box has no lattice for its disks; otherwise None.

    Disks that grow instead are no mistake where the scene then equilibrates.
    """
    if scene.placement == "lattice":
        try:
            lattice_sites(scene)
        except RequestError as error:
            return f"{scene.title}: {error}"
    share = crowding(scene)
    grows = scene.placement == "auto"
    if share < SOME_FAIL or (grows and scene.equilibrate.time > 0):
        return None
    runs = "every run" if share > ALL_FAIL else "some of the runs"
    where = f"{runs} (packing fraction {scene.packing_fraction:.3g})"
    case = scene.title
    if grows:
        return (
            f"{case}: smaller disks are inserted and grow in {where}: no equilibrium; add "
            "`equilibrate`"
        )
    return (
        f"{case}: random placement is expected to fail in {where}; must be fewer or smaller "
        f"disks{other_placements(scene)}"
    )


def other_placements(scene: Scene) -> str:
    """Return the end of a refusal of a scene whose disks find no places: what else may place them,
    if anything.

    example: ", or `placement: auto` with `equilibrate`"
    """
    placements = []
    if scene.placement == "random" and scene.packing_fraction <= JAMMED:
        placements.append(", or `placement: auto` with `equilibrate`")
    if has_lattice(scene):
        placements.append(", or `placement: lattice`")
    return "".join(placements)


def has_lattice(scene: Scene) -> bool:
    """Return whether some triangular lattice in the box has places for all disks of a scene."""
    try:
        lattice_sites(scene)
    except RequestError:
        return False
    return True


# -- a triangular lattice --------------------------------------------------------------------------


def lattice_sites(scene: Scene) -> np.ndarray:
    """Return the sites (at least as many as disks without a position, 2) of a lattice in the box of
    a scene.

    Around a fixed disk sites are lost: the lattice is refined until enough are left. Raises
    RequestError if there is no such lattice with places as large as the largest disk.
    """
    fixed = scene.tracer_position
    radius = scene.radius
    free = radius if fixed is None else radius[1:]
    if len(free) == 0:
        return np.zeros((0, 2))
    largest = free.max()
    low, size = scene.box.accessible(largest)
    wanted = len(free)
    sites = np.zeros((0, 2))
    while len(sites) < len(free):
        lattice, nearest = _lattice(scene.box, size, wanted)
        sites = low + lattice
        if nearest < 2 * largest * (1 - 1e-14):
            raise RequestError(
                f"disks: no triangular lattice in this box has {len(free)} places for disks of "
                f"radius {float(largest)!r}, the largest (packing fraction "
                f"{scene.packing_fraction:.4g}); must be fewer or smaller disks"
            )
        if fixed is not None:
            separation = scene.box.nearest_image(sites - fixed)
            sites = sites[np.hypot(*separation.T) >= radius[0] + largest]
        wanted += len(free) - min(len(sites), len(free))
    return sites


def _lattice(box: Box, size: np.ndarray, n: int) -> tuple[np.ndarray, float]:
    """Return the sites (at least n, 2) of a triangular lattice in a rectangle of a size (2,), and
    the distance of nearest neighbours.

    It has the number of rows for which this distance is greatest; between periodic sides this
    number is even, as every other row is shifted. It is stretched along x or y to fill the
    rectangle: its triangles need not be equilateral.
    """
    step = 2 if box.periodic_y else 1
    rows = np.arange(step, n + 1 + step, step)  # each possible number, of which one is chosen
    columns = -(-n // rows)
    across = size[0] / (columns if box.periodic_x else np.maximum(columns - 0.5, 0.5))
    up = size[1] / (rows if box.periodic_y else np.maximum(rows - 1, 0.5))
    # in the same row, in the next but one, and in the next
    nearest = np.minimum.reduce([across, 2 * up, np.hypot(across / 2, up)])
    best = np.argmax(nearest)
    row, column = np.divmod(np.arange(rows[best] * columns[best]), columns[best])
    shift = 0.5 * (row % 2)
    sites = np.stack([(column + shift) * across[best], row * up[best]], axis=1)
    return sites, float(nearest[best])
