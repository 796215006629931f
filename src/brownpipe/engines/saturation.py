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
JAMMED = 0.84  # packing fraction at which disks pushed apart in disorder have no more room
CERTAIN = 0.99  # share of runs, which is taken for all


class Insertion(NamedTuple):
    """The disks of one radius that are to be inserted."""

    radius: float  # [length]
    number: int
    places: float  # number of disks that are expected to find a place
    failing: float  # probability that fewer find one


def insertions(scene: Scene) -> list[Insertion]:
    """Return the random insertions of a run, from large to small; none for a lattice or a list of disks."""
    if scene.placement not in ("auto", "random"):
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


def share_stuck(scene: Scene) -> float:
    """Return the expected share of runs in which a disk finds no place by random insertion."""
    return 1.0 - math.prod(1.0 - insertion.failing for insertion in insertions(scene))


def share_failing(scene: Scene) -> float:
    """Return the expected share of runs that end because a disk finds no place; with `auto` disks grow up to JAMMED."""
    return share_stuck(scene) if scene.placement == "random" or scene.packing_fraction > JAMMED else 0.0


def is_grown(scene: Scene) -> bool:
    """Return whether disks are grown in every run, as random insertion is certain to fail."""
    return scene.placement == "auto" and share_stuck(scene) > CERTAIN


def placement_caution(scene: Scene, runs: int) -> str | None:
    """Return one line of caution if of `runs` runs of a scene random insertion is likely to fail in at least one."""
    share = share_stuck(scene)
    if scene.placement == "auto" or 1.0 - (1.0 - share) ** runs < 0.5:
        return growth_caution(scene, runs)
    cure = "must be fewer or smaller disks, or `placement: auto` with `equilibrate`"
    return f"{_case(scene)}: random placement is expected to fail in {_shortage(scene, share)}; {cure}"


def growth_caution(scene: Scene, runs: int) -> str | None:
    """Return one line of caution if disks grow in at least one of `runs` runs, probably; otherwise None."""
    share = share_stuck(scene)
    if scene.placement != "auto" or 1.0 - (1.0 - share) ** runs < 0.5:
        return None
    settled = "" if scene.equilibrate.time else "; add `equilibrate`"
    return f"{_case(scene)}: smaller disks are inserted and grow in {_shortage(scene, share)}: no equilibrium{settled}"


def _case(scene: Scene) -> str:
    return f"{scene.name}, N = {scene.particles}"


def _shortage(scene: Scene, share: float) -> str:
    """Return in how many runs places are short, and by how much."""
    worst = max(insertions(scene), key=lambda insertion: insertion.failing)
    which = "every run" if share > CERTAIN else f"some {100 * share:.2g} % of the runs"
    return f"{which}: of {worst.number:,} disks of radius {worst.radius:g} some {worst.places:,.0f} find a place"
