"""Initial positions of the disks: random sequential insertion, or a triangular lattice for dense scenes."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from brownpipe.engines.growth import push_apart
from brownpipe.engines.insertion import OUT_OF_NUMBERS, STUCK, TRIES, insert, register
from brownpipe.engines.lattice import lattice_sites
from brownpipe.engines.saturation import JAMMED, is_grown
from brownpipe.engines.units import common_radius
from brownpipe.errors import PlacementError
from brownpipe.scene import Scene

BEFORE_GROWTH = 0.4  # packing fraction of the smaller disks that are inserted, and then grow
SPARE = 0.1  # share of the room between disks that they leave to each other when they are pushed apart
MOST_SWEEPS = 5_000  # over all disks
TRIES_PER_CALL = 1_000_000  # of the kernel; between two calls Python handles signals such as Ctrl-C


class Insertion(NamedTuple):
    """Random sequential insertion into the box of a scene: what is the same for every run."""

    radius: np.ndarray  # (N,) [length], in the order of insertion, like the next two
    common: float  # largest radius without those of a few big disks [length]
    big: np.ndarray  # int64, which disks are big
    back: np.ndarray  # (N,) int64, place in the order of insertion of each of the scene's disks
    low: np.ndarray  # (2,) lower left corner of the box [length]
    size: np.ndarray  # (2,) of the box [length]
    placed: int  # disks that the scene itself places: 1 or 0
    position: np.ndarray  # (N, 2) relative to `low`, and the next two with these disks, as `insert` takes them
    grid: np.ndarray  # (columns, rows) int64
    following: np.ndarray  # (N,) int64


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
def _insertion(scene: Scene, scale: float) -> Insertion:
    """Return what insertion of disks of `scale` times their radii needs of a scene; kept for its next run."""
    sequence, fixed = np.argsort(-scene.radius, kind="stable"), scene.species[0].position
    if fixed is not None:
        sequence = np.concatenate([[0], sequence[sequence > 0]])
    radius = scale * scene.radius[sequence]
    n, common, (low, size) = len(radius), common_radius(radius), scene.box.accessible(0.0)
    cells = np.clip((size / (2 * common)).astype(np.int64), 1, 1 + math.isqrt(4 * n))
    position, grid, following = np.zeros((n, 2)), np.full(cells, -1, np.int64), np.full(n, -1, np.int64)
    if fixed is not None:
        position[0] = np.array(fixed) - low
        register(grid, following, position, size, 0)
    big, back, placed = np.flatnonzero(radius > common), np.argsort(sequence), int(fixed is not None)
    return Insertion(radius, common, big, back, low, size, placed, position, grid, following)


def _insert(scene: Scene, stream: np.random.Generator, scale: float = 1.0) -> np.ndarray:
    """Return centres (N, 2) by random sequential insertion of disks of `scale` times their radii."""
    radius, common, big, back, low, size, placed, *unfilled = _insertion(scene, scale)
    position, grid, following = (array.copy() for array in unfilled)
    n, progress = len(radius), np.array([placed, 0])  # disks placed, failed tries for the next one
    outcome = OUT_OF_NUMBERS
    while outcome == OUT_OF_NUMBERS:
        numbers = stream.random((2 * n + 64, 2))
        for first in range(0, len(numbers), TRIES_PER_CALL):
            tried = numbers[first : first + TRIES_PER_CALL]
            outcome = insert(position, radius, common, big, size, scene.box.periodic, tried, grid, following, progress)
            if outcome != OUT_OF_NUMBERS:
                break
    if outcome == STUCK:
        raise PlacementError(
            f"disks: only {progress[0]} of {n} disks found a place by random insertion in {TRIES} tries (packing "
            f"fraction {scene.packing_fraction:.3g}); must be fewer or smaller disks, or `placement: auto` or `lattice`"
        )
    return (position + low).take(back, axis=0)


def _grow(scene: Scene, stream: np.random.Generator) -> np.ndarray:
    """Return centres (N, 2) by random insertion of smaller disks, which grow and push each other apart."""
    fixed = scene.species[0].position
    small = math.sqrt(BEFORE_GROWTH / scene.packing_fraction)
    position = _insert(scene, stream, small) - scene.box.origin
    size = np.array((scene.box.width, scene.box.height))
    if not scene.box.periodic:
        position = np.clip(position, scene.radius[:, None], size - scene.radius[:, None])
    radius, common = scene.radius, common_radius(scene.radius)
    big, held = np.flatnonzero(radius > common), -1 if fixed is None else 0
    grid = np.zeros(np.clip((size / (2 * common)).astype(np.int64), 1, None), np.int64)
    given = (position, radius, common, big, size, scene.box.periodic, grid, np.zeros(len(radius), np.int64), held)
    apart = 1.0 + SPARE * (math.sqrt(max(JAMMED / scene.packing_fraction, 1.0)) - 1.0)
    for _ in range(MOST_SWEEPS):
        if push_apart(*given, apart) == 0 and push_apart(*given, 0.0) == 0:
            return position + scene.box.origin
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
