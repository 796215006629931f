"""The arrays on which the time-stepping kernels work, in the engine's units, one array per
quantity.

Real numbers are float64. Disks are stored roughly in the order of their cells, big ones first;
`disk` has the engine's number of the disk at each place in memory.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.engines.compiled.records import SampleArrays, by_reference

# w.counters: steps done, samples taken, the tracer's place in memory, pairs listed within the box
# and across its sides, disks that reach beyond a wall, whether a list is too short for its pairs,
# how often lists were built
STEP, SAMPLE, TRACER, WITHIN, ACROSS, BEYOND, OVERFULL, LISTS_BUILT, COUNTERS = range(9)
# w.count: collisions of pairs, of the tracer, with walls, and missed ones
PAIRS, TRACER_PAIRS, WALLS, MISSED, COUNTS = range(5)
# w.tally: the distance a disk may move before the lists are checked, an upper bound on all speeds,
# the skin, by how much the squared distance of candidates may exceed sigma^2, the least squared
# distance of a pair / sigma^2, the virial, the impulses given to the walls left, right, bottom, top
BUDGET, FASTEST, SKIN, SLACK, NEAREST, VIRIAL, WALL_IMPULSE = range(7)
TALLY = WALL_IMPULSE + 4

DONE, PAUSED, LISTS_FULL = range(3)  # why `advance` returned


@by_reference
class EngineBox(NamedTuple):
    """The box in the engine's units, and its walls; those of a periodic axis are at infinity."""

    x: float  # lower left corner
    y: float
    width: float
    height: float
    left: float  # x coordinates of walls
    right: float
    bottom: float  # y coordinates of walls
    top: float
    periodic_x: bool
    periodic_y: bool


@by_reference
class PairList(NamedTuple):
    """Pairs of disks that may touch before the list is built again; w.counters has their number.
    Shape (capacity,).
    """

    a: np.ndarray  # uint32, places of the disks in memory
    b: np.ndarray  # uint32
    contact: np.ndarray  # sigma^2
    shift_x: np.ndarray  # from disk b to its image; unused for pairs within the box
    shift_y: np.ndarray


@by_reference
class Workspace(NamedTuple):
    """All that a run reads and writes, except the samples. N disks; capacity C of each list of
    pairs.
    """

    box: EngineBox
    step: float  # the time step
    # disks collide where they overlap each other or a wall at the end of a step, not at contact
    late: bool
    skin: float  # listed pairs are closer than contact plus this; more if disks are very fast
    common_radius: float  # the largest radius except those of big disks, which are numbered first
    big: int  # number of big disks
    tracer: int  # the engine's number of the tracer
    x: np.ndarray  # (N,) centres
    y: np.ndarray
    vx: np.ndarray
    vy: np.ndarray
    radius: np.ndarray  # (N,)
    disk: np.ndarray  # (N,) int32, the engine's number of the disk at each place
    image_x: (
        np.ndarray
    )  # (N,) int32, net number of times it left the box at a periodic side to the right
    image_y: np.ndarray  # and at the top
    mass: np.ndarray  # (N,) float64, by the engine's number
    straight_since: np.ndarray  # (N,) float64, by the engine's number: time of the last collision
    x_at_build: np.ndarray  # (N,) positions when the lists were built
    y_at_build: np.ndarray
    order: np.ndarray  # (N,) int32, places sorted by cell
    sorted_x: np.ndarray  # (N,) copies in this order
    sorted_y: np.ndarray
    sorted_radius: np.ndarray
    cell: np.ndarray  # (N,) int32, the cell of each disk
    cell_start: np.ndarray  # (4 N + 9,) int32, where each cell starts in `order`
    scratch: np.ndarray  # (N,) int32
    within: PairList  # pairs of disks in the box
    across: PairList  # pairs of a disk and a periodic image
    candidate: np.ndarray  # (2 C,) uint32, listed pairs close enough to have met
    # (2 C,) float64, time of contact of pairs that met, 0 at the end of the step
    contact_time: np.ndarray
    contact_key: np.ndarray  # (2 C,) int64, the numbers i, k of both disks in one: i N + k
    contact_pair: np.ndarray  # (2 C,) uint32
    counters: np.ndarray  # (COUNTERS,) int64
    count: np.ndarray  # type: ignore[assignment]  # (COUNTS,) int64; hides tuple.count
    tally: np.ndarray  # (TALLY,) float64


@by_reference
class Recorder(NamedTuple):
    """Where samples are written; T of them."""

    step: np.ndarray  # (T,) int64, the last step before each sample
    rest: np.ndarray  # (T,) float64, the time from that step to the sample
    track: SampleArrays  # of the tracer, M = 1
    whole: SampleArrays  # of all disks, M = N, or M = 0
