"""The initial state of a run, drawn from its seed before any equilibration: velocities, then
positions.

Disks are placed by random sequential insertion or, in dense scenes, grown or placed on a triangular
lattice.
"""

import math
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from brownpipe.engines.start.insertion import (
    FIELDS_PER_CELL,
    NEXT,
    NOTHING_PLACED,
    OUT_OF_NUMBERS,
    ROWS,
    STUCK,
    TRIES,
    Places,
    insert_disks,
    push_apart,
    register,
)
from brownpipe.engines.start.placement import JAMMED, is_grown, lattice_sites, other_placements
from brownpipe.engines.units import State, common_radius
from brownpipe.errors import PlacementError
from brownpipe.scene import Scene, motion
from brownpipe.text import counted

ROOT_SEED = 2020  # of all streams of random numbers; the year of Harrison's note
BEFORE_GROWTH = 0.4  # packing fraction of the smaller disks that are inserted, and then grow
# share of the room between disks that they leave to each other when they are pushed apart
SPARE = 0.1
MOST_SWEEPS = 5_000  # over all disks
# pushes of given disks in all sweeps, 3 min; rounded coordinates need some 10 sweeps, and crystals
# at a packing fraction of 0.9 some 400
MOST_PUSHES = 200_000_000
GAP_LEFT = 1e-10  # in contact distances, between given disks that are pushed apart
# of the kernel: their random numbers fit the cache; between two calls Python handles Ctrl-C
TRIES_PER_CALL = 16_000


def draw_state(scene: Scene, seed: int) -> State:
    """Return the initial state of one run. It depends on the scene and the seed alone.

    Velocities are drawn first, each component with the scene's standard deviation or with variance
    kT/m, and then positions (`place_disks`), the tracer first; what the scene gives is not drawn.
    `zero_momentum` is applied here only if the scene has no time to equilibrate, else at the end of
    that time. The random numbers are a Philox stream, seeded by (ROOT_SEED, N, seed). Raises
    RequestError if the disks cannot be placed.
    """
    stream = _stream(ROOT_SEED, scene, seed)
    velocity = motion.given_velocities(scene)
    velocity = _velocities(scene, scene.mass, stream) if velocity is None else velocity.copy()
    return State(place_disks(scene, stream), velocity, scene.radius, scene.mass)


def draw_tracer(
    scene: Scene, seed: int, stream: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return initial position (2,) and velocity (2,) of disk 0 alone.

    The velocity is that of `draw_state` for the same seed, where the tracer's is drawn first. With
    `zero_momentum` the other disks' velocities are drawn, too, to subtract that of the centre of
    mass, with the speeds that they have after equilibration (`motion.speed_ratios`). If the scene
    gives no position of the tracer, it is drawn from `stream`, uniform over the accessible box.
    """
    velocity = _tracer_velocity(scene, seed)
    if scene.tracer_position is not None:
        return np.array(scene.tracer_position), velocity
    low, size = scene.box.accessible(float(scene.radius[0]))
    return low + np.maximum(size, 0.0) * stream.random(2), velocity


def _tracer_velocity(scene: Scene, seed: int) -> np.ndarray:
    """Return the velocity (2,) of disk 0 at t = 0, its own or that drawn from the seed."""
    if scene.tracer_velocity is not None:
        return np.array(scene.tracer_velocity)
    zero_momentum = motion.starts_with_zero_momentum(scene)
    mass = scene.mass
    drawn = mass if zero_momentum else mass[:1]
    velocity = _velocities(scene, drawn, _stream(ROOT_SEED, scene, seed))
    if zero_momentum and scene.equilibrate.time > 0:
        velocity = velocity * motion.speed_ratios(scene)[:, None]
        velocity = with_zero_momentum(scene, velocity)
    return velocity[0]


def noise_stream(scene: Scene, seed: int) -> np.random.Generator:
    """Return the stream of random numbers for the noise of one run, independent of that of
    `draw_state`.
    """
    return _stream((ROOT_SEED, 1), scene, seed)


def _stream(root: int | tuple[int, ...], scene: Scene, seed: int) -> np.random.Generator:
    """Return the Philox stream of (root, N, seed)."""
    sequence = np.random.SeedSequence(root, spawn_key=(scene.particles, seed))
    return np.random.Generator(np.random.Philox(sequence))


def _velocities(scene: Scene, mass: np.ndarray, stream: np.random.Generator) -> np.ndarray:
    """Return velocities (n, 2) as the scene draws them, of disks of the given masses (n,); a tracer
    with a velocity of its own has that.
    """
    distribution = scene.velocities
    assert distribution is not None
    shape = (len(mass), 2)
    if distribution.distribution == "uniform":  # of variance 1
        components = math.sqrt(3.0) * (2.0 * stream.random(shape) - 1.0)
    else:
        components = stream.standard_normal(shape)
    if distribution.temperature is None:
        velocity = motion.common_deviation(scene) * components
    else:
        velocity = np.sqrt(distribution.temperature / mass)[:, None] * components
    if scene.tracer_velocity is not None:
        velocity[0] = scene.tracer_velocity
    if distribution.zero_momentum and scene.equilibrate.time == 0:
        return with_zero_momentum(scene, velocity)
    return velocity


def with_zero_momentum(scene: Scene, velocity: np.ndarray) -> np.ndarray:
    """Return velocities (N, 2) at t = 0 of zero total momentum, in a channel along its periodic
    axis; a tracer with a velocity of its own keeps it.
    """
    if not len(velocity):
        return velocity
    first = 0 if scene.tracer_velocity is None else 1
    balanced = remove_total_momentum(velocity, scene.mass, first)
    return np.where(motion.axes_of_zero_momentum(scene), balanced, velocity)


def remove_total_momentum(velocity: np.ndarray, mass: np.ndarray, first: int = 0) -> np.ndarray:
    """Return velocities (N, 2) of zero total momentum: one vector is subtracted from those of the
    disks from `first` on; from 0 on it is the velocity of the centre of mass.
    """
    exponent = math.frexp(mass.max(initial=0.0))[1]
    share = np.ldexp(mass, -exponent)  # exact, and the sum of the masses cannot overflow
    total = math.fsum(share[first:])
    excess = [math.fsum(share * component) / total for component in velocity.T]
    balanced = velocity.copy()
    balanced[first:] -= excess
    return balanced


# -- positions -------------------------------------------------------------------------------------


def place_disks(scene: Scene, stream: np.random.Generator) -> np.ndarray:
    """Return the centres (N, 2) [length] of the disks of a scene: those that it gives, or of
    disks of its species.

    A tracer is placed where the scene says, if it gives a position; all other disks by the scene's
    `placement`: `random`: random sequential insertion (B. Widom, J. Chem. Phys. 44, 3888 (1966)):
    each centre is uniform over the positions where the disk lies in the box and overlaps no disk
    inserted before. Larger disks are inserted first, as they find no gap among many small ones, and
    equal disks in the scene's order. The packing fraction can reach 0.5. `auto`: the same where it
    succeeds; otherwise smaller disks are inserted, and grow and push each other apart. The packing
    fraction can reach 0.75; the places are not those of equilibrium.
    `lattice`: random sites of a triangular lattice that fills the box.
    Raises RequestError if the disks do not fit, PlacementError if random insertion ends before all
    have a place.
    """
    if scene.configuration is not None:
        return separated(scene).position.copy()
    if not scene.particles:
        return np.zeros((0, 2))
    if scene.placement == "lattice":
        return _on_lattice(scene, stream)
    if not is_grown(scene):
        try:
            return _insert_at_random(scene, stream)
        except PlacementError:
            if scene.placement == "random":
                raise
    return _grow(scene, stream)


@lru_cache(maxsize=2)
def _insertion(scene: Scene, scale: float) -> tuple[Places, np.ndarray]:
    """Return the box before the insertion of disks of `scale` times their radii; kept for the next
    run of the scene.

    A tracer of given position is in it. And of each of the scene's disks (N,) its place in the
    order of insertion.
    """
    n = scene.particles
    fixed = scene.tracer_position
    sequence = np.argsort(-scene.radius, kind="stable")
    if fixed is not None:
        sequence = np.concatenate([[0], sequence[sequence > 0]])
    radius = scale * scene.radius[sequence]
    places = _places(scene, np.zeros((n, 2)), radius, most=1 + math.isqrt(4 * n))
    if fixed is not None:
        places.position[0] = np.array(fixed) - scene.box.origin
        register(places, 0)
    return places, np.argsort(sequence)


def _places(
    scene: Scene, position: np.ndarray, radius: np.ndarray, most: int | None = None
) -> Places:
    """Return disks in the box of a scene with empty cells, at most `most` along each side."""
    common = common_radius(radius)
    size = np.array((scene.box.width, scene.box.height))
    big = np.flatnonzero(radius > common)
    cells = np.clip((size / (2 * common)).astype(np.int64), 1, most)
    grid = np.full(cells, -1, np.int64)
    following = np.full(len(radius), -1, np.int64)
    is_open = np.ones(FIELDS_PER_CELL * cells, np.bool_)
    return Places(
        position,
        radius,
        common,
        big,
        size,
        scene.box.periodic_x,
        scene.box.periodic_y,
        grid,
        following,
        is_open,
    )


def _insert_at_random(scene: Scene, stream: np.random.Generator, scale: float = 1.0) -> np.ndarray:
    """Return centres (N, 2) by random sequential insertion of disks of `scale` times their
    radii.
    """
    empty, back = _insertion(scene, scale)
    p = empty._replace(
        position=empty.position.copy(),
        grid=empty.grid.copy(),
        following=empty.following.copy(),
        is_open=empty.is_open.copy(),
    )
    n = scene.particles
    batch = 2 * n + 64  # rows of random numbers: the stream ends with a whole number of batches
    progress = np.array(NOTHING_PLACED)
    progress[NEXT] = scene.tracer_position is not None
    start = stream.bit_generator.state
    outcome = OUT_OF_NUMBERS
    rows = batch
    while outcome == OUT_OF_NUMBERS:
        rows = min(rows, TRIES_PER_CALL)
        outcome = insert_disks(p, stream.random((rows, 2)), progress)
        rows *= 2
    if outcome == STUCK:
        stream.bit_generator.state = start
        _skip(stream, 2 * batch * math.ceil(progress[ROWS] / batch))
        tries = f"{TRIES} tries (packing fraction {scene.packing_fraction:.3g})"
        raise PlacementError(
            f"disks: only {progress[NEXT]} of {n} disks found a place by random insertion in "
            f"{tries}; must be fewer or smaller disks{other_placements(scene)}"
        )
    return (p.position + scene.box.origin).take(back, axis=0)


def _skip(stream: np.random.Generator, numbers: int) -> None:
    """Go on in a Philox stream by so many uniform random numbers, a multiple of 4, without drawing
    them.

    Philox makes numbers in blocks of 4, and its state counts blocks. The last block is made again,
    and used as far as the first one had been.
    """
    philox = cast(np.random.Philox, stream.bit_generator)
    used_of_block = philox.state["buffer_pos"]
    philox.advance(numbers // 4 - 1)
    stream.random(used_of_block)


def _grow(scene: Scene, stream: np.random.Generator) -> np.ndarray:
    """Return centres (N, 2) by random insertion of smaller disks, which grow and push each other
    apart.
    """
    fixed = scene.tracer_position
    small = math.sqrt(BEFORE_GROWTH / scene.packing_fraction)
    position = _insert_at_random(scene, stream, small) - scene.box.origin
    margins = scene.box.margins(scene.radius[:, None])
    position = np.clip(position, margins, scene.box.size - margins)
    p = _places(scene, position, scene.radius.copy())
    held = -1 if fixed is None else 0
    room = math.sqrt(max(JAMMED / scene.packing_fraction, 1.0)) - 1.0
    apart = 1.0 + SPARE * room
    for _ in range(MOST_SWEEPS):
        if push_apart(p, held, apart) == 0 and push_apart(p, held, 0.0) == 0:
            return p.position + scene.box.origin
    raise PlacementError(
        f"disks: {scene.particles} disks still overlap after they were pushed apart {MOST_SWEEPS} "
        f"times (packing fraction {scene.packing_fraction:.3g}); must be fewer or smaller "
        f"disks{other_placements(scene)}"
    )


class Separation(NamedTuple):
    """Given disks after those that overlapped were pushed apart."""

    position: np.ndarray  # (N, 2) centres [length]
    moved: int  # disks that were moved
    farthest: float  # that a disk was moved [length]


@lru_cache(maxsize=2)
def separated(scene: Scene) -> Separation:
    """Return the given disks of a scene; where they may overlap, `push_apart`, the disks that do
    are pushed apart, and those over an edge of the box are taken into it.

    The others stay where they are. Raises PlacementError if disks still overlap after MOST_SWEEPS
    or, of many disks, MOST_PUSHES.
    """
    assert scene.configuration is not None
    given = scene.configuration.position
    if not scene.push_apart or not len(given):
        return Separation(given, 0, 0.0)
    start = given - scene.box.origin
    inside = _inside(scene, start)
    number = len(given)
    p = _places(scene, inside.copy(), scene.radius.copy(), most=1 + math.isqrt(4 * number))
    sweeps = min(MOST_SWEEPS, math.ceil(MOST_PUSHES / number))
    for _ in range(sweeps):
        if push_apart(p, -1, 1.0 + GAP_LEFT) == 0 and push_apart(p, -1, 0.0) == 0:
            break
    else:
        raise PlacementError(
            f"disks: {number} disks still overlap after they were pushed apart {sweeps} times "
            f"(packing fraction {scene.packing_fraction:.3g}); must be fewer "
            "or smaller disks"
        )
    step = scene.box.nearest_image(p.position - start)
    distance = np.hypot(*step.T)
    is_moved = np.any(p.position != start, axis=1)
    position = np.where(is_moved[:, None], p.position + scene.box.origin, given)
    position.flags.writeable = False
    return Separation(position, int(np.count_nonzero(distance)), float(distance.max()))


def _inside(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return centres (N, 2) relative to a corner of the box, those over its edge taken into it."""
    size = scene.box.size
    wrapped = position - size * np.floor(position / size)
    wrapped = np.where(wrapped < size, wrapped, 0.0)  # round-off of a tiny negative coordinate
    margin = scene.radius[:, None]
    clipped = np.clip(position, margin, size - margin)
    return np.where(scene.box.periodic_axes, wrapped, clipped)


def separation_in_words(scene: Scene) -> str | None:
    """Return one line on disks that are pushed apart before the runs; None where there are none."""
    if scene.configuration is None or not scene.push_apart:
        return None
    separation = separated(scene)
    if not separation.moved:
        return None
    found = scene.overlaps
    pairs = (
        "no pairs overlapped" if found is None else f"{counted(found.number, 'pair')} overlapped"
    )
    depth = "" if found is None else f", by {found.depth:.2g} contact distances at most"
    moved = f"{counted(separation.moved, 'disk')} moved by {separation.farthest:.2g} at most"
    return f"{scene.name}: {pairs}{depth}; {moved}"


def _on_lattice(scene: Scene, stream: np.random.Generator) -> np.ndarray:
    """Return centres (N, 2) on random sites of a lattice; a tracer of given position is off the
    lattice.
    """
    sites = lattice_sites(scene)
    order = stream.permutation(len(sites))
    fixed = scene.tracer_position
    if fixed is None:
        return sites[order[: scene.particles]]
    return np.concatenate([[fixed], sites[order[: scene.particles - 1]]])
