"""Distances of pairs of disks in one run, counted in histograms from which g(r) is estimated.

N disks, P pairs of species, R bins of distances.
"""

from collections.abc import Iterator
from itertools import combinations_with_replacement

import numpy as np

from brownpipe import theory
from brownpipe.observables.observable import Axis, Observable, RunArray, centres, counted_bins
from brownpipe.observables.trajectory import Track
from brownpipe.scene import Scene
from brownpipe.scene.species import SpeciesTable, species_table

BINS_PER_CONTACT = 40  # bins per smallest contact distance
FARTHEST = 5.0  # end of the histogram, in units of the largest contact distance
MOST_COUNTS = 1_000_000  # bins of all histograms of a run
DISKS_PER_SAMPLE, PAIRS_PER_DISK = 100, 17  # that take as long as a sample, and as a disk
# from a sample, with which memory is filled to some 0.1 GB
PAIRS_AT_ONCE = 1_000_000
BYTES_PER_PAIR = 150  # two disks, distance and its components, bin, pair of species
# samples whose rings are intersected with the box in one call, three times as fast as one by one
SAMPLES_AT_ONCE = 16


def species_pairs(species: SpeciesTable) -> list[tuple[int, int]]:
    """Return the P = K (K + 1)/2 pairs (a, b) of species, a <= b."""
    return list(combinations_with_replacement(range(len(species.name)), 2))


def bins(scene: Scene) -> tuple[int, float]:
    """Return the number R of bins of distances and their width [length]; R = 0 if no pair can be in
    any.

    The smallest contact distance is 40 bins wide. The last bin ends at five times the largest
    contact distance, but not beyond half a periodic side, where the distance of a pair is no longer
    unique, nor, in a box of walls, beyond the shorter side less the largest diameter.
    """
    if scene.particles < 2:
        return 0, 0.0
    radius = np.sort(scene.radius)
    smallest_contact = radius[0] + radius[1]
    largest_contact = radius[-1] + radius[-2]
    _, accessible = scene.box.accessible(radius[-1])
    if not accessible.all():
        return 0, 0.0
    farthest = np.where(scene.box.periodic_axes, accessible / 2, accessible)
    if scene.box.is_channel:  # across which the ideal gas is known at any distance
        farthest = farthest[scene.box.periodic_axes]
    reach = min(farthest.min(), FARTHEST * largest_contact)
    return counted_bins(reach, smallest_contact / BINS_PER_CONTACT)


def pairs_in_reach(scene: Scene) -> float:
    """Return how many pairs per disk are expected at distances up to the end of the histogram."""
    number, width = bins(scene)
    reach = number * width
    share = np.pi * reach**2 / scene.box.area
    if scene.box.is_channel:
        # the length of the channel within reach
        share = min(share, 2 * reach / scene.box.size[scene.box.periodic_axes].item())
    return scene.particles / 2 * min(share, 1.0)


def pair_names(scene: Scene) -> list[str]:
    """Return a name for each pair of species, "tracer:bath"."""
    species = species_table(scene)
    return [f"{species.name[a]}:{species.name[b]}" for a, b in species_pairs(species)]


def why_unfit(scene: Scene) -> str | None:
    """Return why the scene has no such histograms, None if it has."""
    number, _ = bins(scene)
    kinds = len(species_table(scene).name)
    if number < 1:
        return "needs two disks, and room for them to be apart"
    if number * kinds * (kinds + 1) / 2 > MOST_COUNTS:
        return f"would have more than {MOST_COUNTS} bins for so many kinds or sizes of disks"
    return None


def pair_distribution(scene: Scene, track: Track, _: str) -> dict[str, np.ndarray]:
    """Return the counts (P, R) of pairs by species and distance, and the number of samples they are
    summed over.

    All samples of a stationary run are counted, otherwise the last one. Between walls, those of a
    channel too, the counts that an ideal gas would have around lone disks (`expected_pairs`) are
    returned as well.
    """
    species = species_table(scene)
    number, width = bins(scene)
    pairs = species_pairs(species)
    row = np.zeros((len(species.name),) * 2, np.int64)  # of a pair of species in the counts
    for p, (a, b) in enumerate(pairs):
        row[a, b] = row[b, a] = p
    counts = np.zeros(len(pairs) * number, np.int64)
    for sample in track.position:
        for disks, distance in blocks_of_pairs(scene, sample, number * width):
            column = (distance / width).astype(np.int64)
            inside = column < number
            a, b = species.species_index.take(disks.T)
            bins_of_pairs = (row[a, b] * number + column)[inside]
            counts += np.bincount(bins_of_pairs, minlength=len(counts))
    samples = np.array(len(track.position))
    arrays = {"pair_counts": counts.reshape(-1, number), "pair_snapshots": samples}
    if scene.box.has_walls and len(pairs) > 1 and species.number.min() == 1:
        arrays["pair_expected"] = expected_pairs(scene, species, track.position)
    return arrays


def expected_pairs(scene: Scene, species: SpeciesTable, position: np.ndarray) -> np.ndarray:
    """Return the counts (P, R) that an ideal gas has around lone disks, summed over samples
    `position` (T, N, 2).

    N_k points, uniform in the rectangle accessible to the centres of species k, are expected in a
    ring in proportion to the part of its area inside the rectangle. The ring is centred at the
    position of the lone disk in each sample, so that nothing is assumed about the distribution of
    that disk. Along the periodic axis of a channel the lone disk is always in the middle of the
    nearest images, whose ends the rings do not pass. NaN for pairs of species of which none is a
    single disk.
    """
    middle = scene.box.origin + scene.box.size / 2
    pairs = species_pairs(species)
    number, width = bins(scene)
    edges = np.arange(number + 1) * width
    expected = np.full((len(pairs), number), np.nan)
    for row, (a, b) in enumerate(pairs):
        lone, other = (a, b) if species.number[a] == 1 else (b, a)
        if a == b or species.number[lone] > 1:
            continue
        _, accessible = scene.box.accessible(species.radius[other])
        (disk,) = np.flatnonzero(species.species_index == lone)
        off_centre = np.where(scene.box.periodic_axes, 0.0, position[:, disk] - middle)
        area = _area_inside(off_centre, edges, accessible)
        expected[row] = species.number[other] * np.diff(area) / np.prod(accessible)
    return expected


def _area_inside(off_centre: np.ndarray, edges: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return the area of circles of radius `edges` (R,) inside a rectangle with these sides (2,),
    summed over the samples (T, 2) of their centre, which is measured from that of the rectangle.
    """
    width, height = sides
    area = np.zeros(len(edges))
    for first in range(0, len(off_centre), SAMPLES_AT_ONCE):
        x, y = off_centre[first : first + SAMPLES_AT_ONCE].T[:, :, None]
        area += theory.disk_area_in_rectangle(edges, x, y, width, height).sum(axis=0)
    return area


def blocks_of_pairs(
    scene: Scene, position: np.ndarray, reach: float
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield all pairs (Q, 2) of disks closer than `reach`, and their distances (Q,); a few may
    exceed it by round-off.

    position: (N, 2). Along periodic axes the distance is that of the nearest images. If more than
    PAIRS_AT_ONCE pairs are expected, as in a mixture with a disk much larger than the others, they
    come in blocks of about so many.
    """
    from scipy.spatial import cKDTree

    inside = _from_corner(scene, position)
    period = np.where(scene.box.periodic_axes, scene.box.size, 0.0)  # 0: not periodic
    boxsize = period if scene.box.has_images else None
    tree = cKDTree(inside, boxsize=boxsize)
    farthest = reach * (1 + 1e-9)
    partners = 2 * pairs_in_reach(scene)  # of a disk
    if partners * len(inside) < 2 * PAIRS_AT_ONCE:
        pair = tree.query_pairs(farthest, output_type="ndarray")
        yield pair, _distances(scene, inside, pair)
        return
    disks_at_once = max(1, int(PAIRS_AT_ONCE / partners))
    for first in range(0, len(inside), disks_at_once):
        block = cKDTree(inside[first : first + disks_at_once], boxsize=boxsize)
        near = block.sparse_distance_matrix(tree, farthest, output_type="ndarray")
        pair = np.stack([first + near["i"], near["j"]], axis=1)
        del near
        pair = pair[pair[:, 0] < pair[:, 1]]  # each pair once
        yield pair, _distances(scene, inside, pair)


def _from_corner(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return positions (N, 2) from the lower left corner of the box, inside it along periodic
    axes.
    """
    box = scene.box
    from_corner = position - box.origin
    if not box.has_images:
        return from_corner
    inside = np.mod(from_corner, box.size)
    inside[inside >= box.size] = 0.0  # as the remainder of -1e-17 is
    return np.where(box.periodic_axes, inside, from_corner)


def _distances(scene: Scene, inside: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Return the distances (Q,) of pairs (Q, 2) of disks, along periodic axes of the nearest
    images.
    """
    a, b = pair.T
    x, y = inside.T
    dx = x.take(a) - x.take(b)  # much faster than inside[a] - inside[b]
    dy = y.take(a) - y.take(b)
    if scene.box.periodic_x:
        dx -= scene.box.width * np.rint(dx / scene.box.width)
    if scene.box.periodic_y:
        dy -= scene.box.height * np.rint(dy / scene.box.height)
    return np.sqrt(dx * dx + dy * dy)


def working_memory(scene: Scene) -> float:
    """Return the bytes of memory that the pairs of a sample take while they are counted."""
    pairs = min(pairs_in_reach(scene) * scene.particles, PAIRS_AT_ONCE)
    return BYTES_PER_PAIR * pairs


DISTRIBUTION = Observable(
    pair_distribution,
    {
        "pair_counts": RunArray(
            ("species_pair", "distance"), "1", "histogram of the distances of pairs of disks"
        ),
        "pair_snapshots": RunArray((), "1", "number of samples that pair_counts is summed over"),
        "pair_expected": RunArray(
            ("species_pair", "distance"), "1", "pair_counts of an ideal gas around a lone disk"
        ),
    },
    axes={
        "species_pair": Axis("1", "species of the two disks", pair_names),
        "distance": Axis(
            "length", "distance between the centres", lambda scene: centres(*bins(scene))
        ),
    },
    seconds_per_disk_sample=6e-7,
    is_over_samples=True,
    relative_cost=lambda scene: (
        1 + DISKS_PER_SAMPLE / max(scene.particles, 1) + pairs_in_reach(scene) / PAIRS_PER_DISK
    ),
    working_memory=working_memory,
    why_unfit=why_unfit,
)
