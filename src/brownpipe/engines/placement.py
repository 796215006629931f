"""Initial positions of the disks: random sequential insertion, or a triangular lattice for dense scenes."""

import math
from functools import lru_cache

import numpy as np

from brownpipe.engines.growth import push_apart
from brownpipe.engines.insertion import OUT_OF_NUMBERS, STUCK, TRIES, Places, insert, register
from brownpipe.engines.lattice import lattice_sites
from brownpipe.engines.saturation import JAMMED, is_grown
from brownpipe.engines.units import common_radius
from brownpipe.errors import PlacementError
from brownpipe.scene import Scene

BEFORE_GROWTH = 0.4  # packing fraction of the smaller disks that are inserted, and then grow
SPARE = 0.1  # share of the room between disks that they leave to each other when they are pushed apart
MOST_SWEEPS = 5_000  # over all disks
TRIES_PER_CALL = 1_000_000  # of the kernel; between two calls Python handles signals such as Ctrl-C


def place(scene: Scene, stream: np.random.Generator) -> np.ndarray:
    """Return the centres (N, 2) [length] of the disks of a scene of species.

    A tracer is placed where the scene says, if it gives a position; all other disks by the scene's `placement`:
    `random`: random sequential insertion (B. Widom, J. Chem. Phys. 44, 3888 (1966)): each centre is uniform over the
    positions where the disk lies in the box and overlaps no disk inserted before. Larger disks are inserted first, as
    they find no gap among many small ones, and equal disks in the scene's order. The packing fraction can reach 0.5.
    `auto`: the same where it succeeds; otherwise smaller disks are inserted, and grow and push each other apart. The
    packing fraction can reach 0.75; the places are not those of equilibrium.
    `lattice`: random sites of a triangular lattice that fills the box.
    Raises RequestError if the disks do not fit, PlacementError if random insertion ends before all have a place.
    """
    fixed = scene.species[0].position if scene.species else None
    if scene.placement == "lattice":
        return _on_lattice(scene, fixed, stream)
    if not scene.particles:
        return np.zeros((0, 2))
    if is_grown(scene):
        return _grow(scene, stream)
    try:
        return _insert(scene, stream)
    except PlacementError:
        if scene.placement == "random":
            raise
        return _grow(scene, stream)


@lru_cache(maxsize=2)
def _insertion(scene: Scene, scale: float) -> tuple[Places, np.ndarray]:
    """Return the box before the insertion of disks of `scale` times their radii; kept for the next run of the scene.

    A tracer of given position is in it. And of each of the scene's disks (N,) its place in the order of insertion.
    """
    sequence, fixed = np.argsort(-scene.radius, kind="stable"), scene.species[0].position
    if fixed is not None:
        sequence = np.concatenate([[0], sequence[sequence > 0]])
    places = _places(
        scene, np.zeros((scene.particles, 2)), scale * scene.radius[sequence], 1 + math.isqrt(4 * scene.particles)
    )
    if fixed is not None:
        places.position[0] = np.array(fixed) - scene.box.origin
        register(places, 0)
    return places, np.argsort(sequence)


def _places(scene: Scene, position: np.ndarray, radius: np.ndarray, most: int | None = None) -> Places:
    """Return disks in the box of a scene with empty cells, along each side at most so many."""
    common, size, n = common_radius(radius), np.array((scene.box.width, scene.box.height)), len(radius)
    cells = np.clip((size / (2 * common)).astype(np.int64), 1, most)
    grid, big = np.full(cells, -1, np.int64), np.flatnonzero(radius > common)
    return Places(position, radius, common, big, size, scene.box.periodic, grid, np.full(n, -1, np.int64))


def _insert(scene: Scene, stream: np.random.Generator, scale: float = 1.0) -> np.ndarray:
    """Return centres (N, 2) by random sequential insertion of disks of `scale` times their radii."""
    empty, back = _insertion(scene, scale)
    p = empty._replace(**{name: getattr(empty, name).copy() for name in ("position", "grid", "following")})
    n, fixed = scene.particles, scene.species[0].position is not None
    outcome, progress = OUT_OF_NUMBERS, np.array([int(fixed), 0])  # disks placed, failed tries for the next one
    while outcome == OUT_OF_NUMBERS:
        numbers = stream.random((2 * n + 64, 2))
        for first in range(0, len(numbers), TRIES_PER_CALL):
            outcome = insert(p, numbers[first : first + TRIES_PER_CALL], progress)
            if outcome != OUT_OF_NUMBERS:
                break
    if outcome == STUCK:
        raise PlacementError(
            f"disks: only {progress[0]} of {n} disks found a place by random insertion in {TRIES} tries (packing "
            f"fraction {scene.packing_fraction:.3g}); must be fewer or smaller disks, or `placement: auto` or `lattice`"
        )
    return (p.position + scene.box.origin).take(back, axis=0)


def _grow(scene: Scene, stream: np.random.Generator) -> np.ndarray:
    """Return centres (N, 2) by random insertion of smaller disks, which grow and push each other apart."""
    fixed = scene.species[0].position
    small = math.sqrt(BEFORE_GROWTH / scene.packing_fraction)
    position = _insert(scene, stream, small) - scene.box.origin
    size = np.array((scene.box.width, scene.box.height))
    if not scene.box.periodic:
        position = np.clip(position, scene.radius[:, None], size - scene.radius[:, None])
    p, held = _places(scene, position, scene.radius.copy()), -1 if fixed is None else 0
    apart = 1.0 + SPARE * (math.sqrt(max(JAMMED / scene.packing_fraction, 1.0)) - 1.0)
    for _ in range(MOST_SWEEPS):
        if push_apart(p, held, apart) == 0 and push_apart(p, held, 0.0) == 0:
            return p.position + scene.box.origin
    raise PlacementError(
        f"disks: {scene.particles} disks still overlap after they were pushed apart {MOST_SWEEPS} times (packing "
        f"fraction {scene.packing_fraction:.3g}); must be fewer or smaller disks, or `placement: lattice`"
    )


def _on_lattice(scene: Scene, fixed: tuple[float, float] | None, stream: np.random.Generator) -> np.ndarray:
    """Return centres (N, 2) on random sites of a lattice; disk 0 is at `fixed`, if not None, off the lattice."""
    if not scene.species:
        return np.zeros((0, 2))
    sites = lattice_sites(scene)
    position = sites[stream.permutation(len(sites))[: scene.particles - (fixed is not None)]]
    return position if fixed is None else np.concatenate([[fixed], position])
