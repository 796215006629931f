"""How the disks stand to each other: distances of pairs, from which g(r) is made."""

from itertools import combinations_with_replacement

import numpy as np

from brownpipe import theory
from brownpipe.observables.species import SpeciesTable, species_table
from brownpipe.observables.time_origins import is_stationary
from brownpipe.scene import Scene

BINS_PER_CONTACT = 40  # of the smallest contact distance
FARTHEST = 5.0  # of the largest contact distance
AT_ONCE = 16  # samples around whose lone disks rings are measured: a third of the time of one by one


def species_pairs(kinds: SpeciesTable) -> list[tuple[int, int]]:
    """The P = K (K + 1)/2 pairs of kinds, a <= b."""
    return list(combinations_with_replacement(range(len(kinds.name)), 2))


def bins(scene: Scene) -> tuple[int, float]:
    """The number R of bins of distances and their width [length]; none if there are no two disks or no room for a bin.

    The smallest contact distance is 40 bins wide. They end at five times the largest, or before, at half the shorter
    side of a periodic box (beyond it a pair has more than one distance) or at how far the centres can get along the
    shorter side between walls.
    """
    kinds, box = species_table(scene), scene.box
    contacts = [kinds.radius[a] + kinds.radius[b] for a, b in species_pairs(kinds) if a != b or kinds.number[a] > 1]
    if not contacts:
        return 0, 0.0
    side, width = min(box.width, box.height), min(contacts) / BINS_PER_CONTACT
    reach = min(side / 2 if box.periodic else side - 2 * kinds.radius.max(), FARTHEST * max(contacts))
    return max(0, int(reach / width * (1 + 1e-12))), width


def distribution(scene: Scene, run, _) -> dict[str, np.ndarray | int]:
    """Counts (P, R) of pairs by kinds and distance, and the number of samples they are summed over.

    All samples if the run is stationary, the last one otherwise. Between walls also how many pairs with a lone disk an
    ideal gas would show in these samples: `expected_pairs`.
    """
    kinds, (number, width) = species_table(scene), bins(scene)
    which = np.zeros((len(kinds.name),) * 2, np.int64)
    for place, (a, b) in enumerate(species_pairs(kinds)):
        which[a, b] = which[b, a] = place
    position = run.whole.position[slice(None) if is_stationary(scene) else slice(-1, None)]
    counts = np.zeros(len(species_pairs(kinds)) * number, np.int64)
    for one in position:
        pair, distance = close_pairs(scene, one, number * width)
        place = (distance / width).astype(np.int64)
        inside = place < number
        a, b = kinds.label[pair[inside]].T
        counts += np.bincount(which[a, b] * number + place[inside], minlength=len(counts))
    found = {"pair_counts": counts.reshape(-1, number), "pair_snapshots": len(position)}
    lone = lone_pairs(scene, kinds)
    return found | ({"pair_expected": expected_pairs(scene, kinds, lone, position)} if lone else {})


def lone_pairs(scene: Scene, kinds: SpeciesTable) -> list[tuple[int, int, int]]:
    """(place among the pairs, lone, other) of the pairs of two kinds of which one, `lone`, is a single disk.

    None in a periodic box, where no wall cuts the rings around it.
    """
    found = [(place, *pair) for place, pair in enumerate(species_pairs(kinds)) if pair[0] != pair[1]]
    in_turn = [(place, a, b) if kinds.number[a] == 1 else (place, b, a) for place, a, b in found]
    return [] if scene.box.periodic else [each for each in in_turn if kinds.number[each[1]] == 1]


def expected_pairs(scene: Scene, kinds: SpeciesTable, pairs, position: np.ndarray) -> np.ndarray:
    """Pairs (P, R) that an ideal gas shows around the lone disks of samples `position` (T, N, 2), summed over them.

    Of N uniform points in the rectangle accessible to their kind, N times the share of it in a ring around where the
    lone disk is: it need not have spread over the box. NaN for all but `pairs`, which are `lone_pairs`.
    """
    size, (number, width) = np.array([scene.box.width, scene.box.height]), bins(scene)
    edges, expected = np.arange(number + 1) * width, np.full((len(species_pairs(kinds)), number), np.nan)
    for place, lone, other in pairs:
        room, disk = size - 2 * kinds.radius[other], np.flatnonzero(kinds.label == lone)[0]
        off_centre = position[:, disk, :, None] - (scene.box.origin + size / 2)[:, None]
        some = [off_centre[k : k + AT_ONCE].swapaxes(0, 1) for k in range(0, len(position), AT_ONCE)]
        area = sum(theory.disk_area_in_rectangle(edges, *each, *room).sum(axis=0) for each in some)
        expected[place] = kinds.number[other] * np.diff(area) / np.prod(room)
    return expected


def close_pairs(scene: Scene, position: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """All pairs (Q, 2) of disks that are nearer than `reach`, and their distances (Q,); some may be just beyond it."""
    from scipy.spatial import cKDTree

    size = np.array([scene.box.width, scene.box.height])
    inside = position - scene.box.origin
    if scene.box.periodic:
        inside = np.mod(inside, size)
        inside[inside >= size] = 0.0  # as the remainder of -1e-17 is
    tree = cKDTree(inside, boxsize=size if scene.box.periodic else None)
    pair = tree.query_pairs(reach * (1 + 1e-9), output_type="ndarray")
    apart = inside[pair[:, 0]] - inside[pair[:, 1]]
    if scene.box.periodic:
        apart -= size * np.rint(apart / size)
    return pair, np.sqrt(np.sum(apart**2, axis=1))
