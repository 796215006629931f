"""How likely random sequential insertion is to fail in a scene, estimated without inserting a disk.

Random sequential insertion of equal disks saturates at a packing fraction of 0.547 (E. L. Hinrichsen, J. Feder &
T. Jossang, J. Stat. Phys. 44, 793 (1986)). Here it ends earlier, at SATURATION, when a disk has found no place in
`insertion.TRIES` tries. Disks are inserted from large to small: to disks of radius r, a larger disk of radius R is an
obstacle of radius R + MARGIN r, and a wall an inaccessible strip of width MARGIN r. docs/decisions.md has the
measurements.
"""

import math
from typing import NamedTuple

from brownpipe.scene import Scene

SATURATION = 0.541  # packing fraction of equal disks at which insertion ends
MARGIN = 0.34  # in radii of the disk to be inserted
SCATTER = 0.26  # standard deviation of the number of disks that find a place, over the square root of their number
UNCERTAINTY = 0.003  # relative error of `places`


class Insertion(NamedTuple):
    """The disks of one radius that are to be inserted."""

    radius: float  # [length]
    number: int
    places: float  # number of disks that are expected to find a place
    failing: float  # probability that fewer find one


def insertions(scene: Scene) -> list[Insertion]:
    """Return the random insertions of a run, from large to small; none for a lattice or a list of disks."""
    if scene.placement != "random":
        return []
    counts: dict[float, int] = {}
    for species in scene.species:
        counts[species.radius] = counts.get(species.radius, 0) + species.count
    present = sorted(((radius, count) for radius, count in counts.items() if count), reverse=True)
    found: list[Insertion] = []
    for k, (radius, count) in enumerate(present):
        walls = 0.0 if scene.box.periodic else 2 * MARGIN * radius
        area = (scene.box.width - walls) * (scene.box.height - walls)
        area -= sum(before * math.pi * (larger + MARGIN * radius) ** 2 for larger, before in present[:k])
        places = SATURATION * max(area, 0.0) / (math.pi * radius**2)
        fails = 0.0 if k == 0 and count == 1 else _share_below(count, places)  # the first disk always finds a place
        found.append(Insertion(radius, count, places, fails))
    return found


def _share_below(count: int, places: float) -> float:
    """Return the probability that fewer than `count` disks find a place: normal, with a mean of `places`."""
    deviation = math.hypot(SCATTER * math.sqrt(places), UNCERTAINTY * places)
    return 0.5 * math.erfc((places - count + 0.5) / (math.sqrt(2) * deviation)) if deviation > 0 else 1.0


def share_failing(scene: Scene) -> float:
    """Return the expected share of runs that end because a disk finds no place by random insertion."""
    return 1.0 - math.prod(1.0 - insertion.failing for insertion in insertions(scene))


def placement_caution(scene: Scene, runs: int) -> str | None:
    """Return one line of caution if of `runs` runs of a scene at least one is likely to fail at placing its disks."""
    share = share_failing(scene)
    if 1.0 - (1.0 - share) ** runs < 0.5:
        return None
    worst = max(insertions(scene), key=lambda insertion: insertion.failing)
    failing = "every run" if share > 0.99 else f"some {100 * share:.2g} % of the runs"
    places = f"of {worst.number:,} disks of radius {worst.radius:g} some {worst.places:,.0f} find a place"
    cure = "must be fewer or smaller disks, or `placement: lattice` with `equilibrate`"
    return f"{scene.name}, N = {scene.particles}: random placement is expected to fail in {failing}: {places}; {cure}"
