"""What the time-stepping kernels work on: numbers and arrays in the engine's units, by structure of arrays.

`real` is float64 or float32, the precision of a run. Disks stand roughly in the order of their cells, much bigger
ones first; `disk` says which is where.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.engines.records import by_reference

# w.clock
STEP, SAMPLE, TRACER, WITHIN, ACROSS, BEYOND, OVERFULL, LISTS_MADE, CLOCK = range(9)
# w.count
PAIRS, TRACER_PAIRS, WALLS, MISSED, COUNTS = range(5)
# w.tally; the last four are the impulses given by the walls left, right, bottom, top
BUDGET, FASTEST, SKIN, NEAREST, VIRIAL, WALL_IMPULSE = range(6)
TALLY = WALL_IMPULSE + 4
# w.real
DT, SLACK, FAR, LEFT, RIGHT, BOTTOM, TOP, REALS = range(8)

DONE, PAUSED, NO_ROOM = range(3)


@by_reference
class Room(NamedTuple):
    """The box."""

    x: float  # lower left corner
    y: float
    width: float
    height: float
    periodic: bool


@by_reference
class Pairs(NamedTuple):
    """Pairs of disks that may touch before the lists are made anew, as many as the clock says."""

    a: np.ndarray  # uint32, places in the order of the disks
    b: np.ndarray
    contact: np.ndarray  # real, sigma^2
    shift_x: np.ndarray  # real, from disk b to its image; not filled for pairs within the box
    shift_y: np.ndarray


@by_reference
class Workspace(NamedTuple):
    """A run."""

    box: Room
    step: float  # the time step
    late: bool  # whether pairs and walls are met where they are found, and not at contact
    skin: float  # by how much pairs on the lists may be further apart than contact; more for very fast disks
    largest: float  # radius of all but the big disks, which are the first `big`
    big: int
    tracer: int  # the engine's number
    x: np.ndarray  # (N,) real
    y: np.ndarray
    vx: np.ndarray
    vy: np.ndarray
    radius: np.ndarray  # (N,) real
    disk: np.ndarray  # (N,) int32, the engine's number of each
    image_x: np.ndarray  # (N,) int32, how often it went round the box
    image_y: np.ndarray
    mass: np.ndarray  # (N,) float64, by the engine's number
    course: (
        np.ndarray
    )  # (N,) float64, by the engine's number: the time of its last collision, from where it flies straight
    made_x: np.ndarray  # (N,) real, where each was when the lists were made
    made_y: np.ndarray
    order: np.ndarray  # (N,) int32, by cells
    near_x: np.ndarray  # (N,) real, copies in this order
    near_y: np.ndarray
    near_radius: np.ndarray
    cell: np.ndarray  # (N,) int32, the cell of each disk
    first: np.ndarray  # int32, of each cell the first of its disks in the order
    spare: np.ndarray  # (N,) int32
    real: np.ndarray  # the time step, the walls, and by how much the squared distance of a pair that has just passed
    # may exceed that of contact
    within: Pairs
    across: Pairs
    hit: np.ndarray  # uint32, pairs that are looked at more closely
    contact_time: np.ndarray  # float64, pairs that met: when
    contact_key: np.ndarray  # int64, the numbers of their disks in one
    contact_pair: np.ndarray  # uint32
    clock: np.ndarray
    count: np.ndarray
    tally: np.ndarray


@by_reference
class Recorder(NamedTuple):
    """Where samples go; the names of exact.workspace.Recorder."""

    tracer: int
    step: np.ndarray  # (T,) int64, the last step before a sample
    rest: np.ndarray  # (T,) the time from there
    position: np.ndarray  # (T, 1, 2)
    velocity: np.ndarray
    image: np.ndarray
    whole_position: np.ndarray  # (T, M, 2), M = N or 0
    whole_velocity: np.ndarray
    whole_image: np.ndarray
