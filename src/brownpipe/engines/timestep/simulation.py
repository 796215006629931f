"""Runs of the time-stepping engine: all disks fly for a fixed time, then the pairs that met
collide.

A collision is computed at the moment of contact, in closed form; only encounters of three disks
within a step are approximate. Alternatively collisions are late, as in simpler programs: disks that
overlap at the end of a step collide there, up to a step after contact and displaced from it, and
short encounters are missed. Energy and momentum, including that given to the walls, are conserved
as by the exact engine.
"""

import math
from collections.abc import Collection, Sequence
from functools import partial
from typing import Any, NamedTuple, TypedDict

import numpy as np

from brownpipe import progress
from brownpipe.engines.compiled.kernels import compile_all
from brownpipe.engines.ensemble import Ensemble, make_runs, new_batch
from brownpipe.engines.exact.simulation import equilibrate, prepare_equilibration
from brownpipe.engines.recording import (
    blank_samples,
    can_count_images,
    conservation,
    report_in_scene_units,
    report_nothing,
    tracks_of,
)
from brownpipe.engines.start.initial_state import draw_state
from brownpipe.engines.start.insertion import insert_nothing
from brownpipe.engines.timestep import Settings, refuse_unfit
from brownpipe.engines.timestep import workspace as ws
from brownpipe.engines.timestep.steps import advance, reaches_beyond
from brownpipe.engines.timestep.workspace import EngineBox, PairList, Workspace
from brownpipe.engines.units import Frame, State, common_radius, engine_frame, motion_of, rms_speed
from brownpipe.observables.trajectory import Run
from brownpipe.scene import Scene

# paths of the fastest disk in a step: a disk further beyond a wall has escaped and the run has
# failed
REACHES = 4.0
REAL_ARRAYS = (
    "x",
    "y",
    "vx",
    "vy",
    "x_at_build",
    "y_at_build",
    "sorted_x",
    "sorted_y",
    "sorted_radius",
)
INT_ARRAYS = ("disk", "image_x", "image_y", "order", "cell", "scratch")
SKIN_FACTOR = 3.2  # measured factor of `skin_of`
DISK_STEPS_PER_CALL = 100_000_000  # between two chances for Python to handle signals


class SteppingSetup(NamedTuple):
    """A scene with the workspace for its runs, which every run overwrites."""

    scene: Scene
    frame: Frame
    settings: Settings
    workspace: Workspace


def simulate(
    scene: Scene,
    seeds: Sequence[int],
    record: Collection[str] = frozenset({"tracer"}),
    *,
    observables: Collection[str] = (),
    average: str = "runs",
    **settings: Any,
) -> Ensemble:
    """Run the scene once for every seed, from the same initial states as the exact engine.

    `record`: "tracer" (disk 0) and "all" (every disk). `collisions`: "at_contact", where a pair met
    within the step, or "late", where it overlaps at the end of the step. A sample is a free flight
    from the last step before it, so that no step depends on the sample times. A run whose disks
    find no place at random or whose equilibration fails counts as failed (`stopped`: the reason).
    Raises RequestError for a time step or record that the engine refuses, and if the scene leaves
    no place for its disks in any run.
    """
    own_settings = Settings(**settings)
    refuse_unfit(scene, own_settings, record)
    batch = new_batch(scene, seeds, record, observables, average)
    equilibrator = prepare_equilibration(scene)
    setup = prepare_scene(scene, own_settings)

    def run_of(column: int) -> Run:
        drawn = draw_state(scene, int(batch.ensemble.seeds[column]))
        return run_steps(setup, equilibrate(equilibrator, drawn), scene.times, batch.needed_record)

    return make_runs(batch, run_of)


def prepare_scene(scene: Scene, settings: Settings) -> SteppingSetup:
    """Return the setup for runs of a scene, with its kernels compiled."""
    frame = engine_frame(scene)
    w = new_workspace(scene, frame, settings)
    no_samples = new_recorder(scene, frame, settings.time_step, scene.times[:0], ())
    compile_all(insert_nothing, report_nothing, partial(advance, w, no_samples, 0))
    return SteppingSetup(scene, frame, settings, w)


def run_steps(
    setup: SteppingSetup, state: State, times: np.ndarray, record: Collection[str] = frozenset()
) -> Run:
    """Run from a state and sample at the given times (T,). Full lists are replaced by lists of
    twice the capacity.
    """
    scene = setup.scene
    frame = setup.frame
    w = setup.workspace
    time_step = setup.settings.time_step
    samples = new_recorder(scene, frame, time_step, times, record)
    first = motion_of(state, frame)
    begin_run(w, first)
    steps = 1 + DISK_STEPS_PER_CALL // max(scene.particles, 1)
    while (outcome := advance(w, samples, steps)) != ws.DONE:
        elapsed = scene.equilibrate.time + int(w.counters[ws.STEP]) * time_step
        progress.within(elapsed / (scene.equilibrate.time + scene.duration))
        if outcome == ws.LISTS_FULL:
            w = _with_twice_the_capacity(w)
    tracer, whole, finite = tracks_of(scene, frame, samples)
    return Run(tracer, whole, None, report_of(scene, frame, w, first, finite))


def _with_twice_the_capacity(w: Workspace) -> Workspace:
    """Return the workspace in its present state with lists of twice the capacity."""
    return w._replace(**_empty_lists(2 * len(w.within.a), len(w.across.a) > 0))


# -- the workspace of a scene ----------------------------------------------------------------------


def new_workspace(scene: Scene, frame: Frame, settings: Settings) -> Workspace:
    """Return a workspace for the runs of a scene."""
    n = scene.particles
    box = scene.box
    radius = scene.radius[frame.order] / frame.length
    common = common_radius(radius) if n else 0.5
    x, y = ((np.array((box.x[0], box.y[0])) - frame.origin) / frame.length).tolist()
    width = box.width / frame.length
    height = box.height / frame.length
    real_arrays = {name: np.zeros(n) for name in REAL_ARRAYS}
    int_arrays = {name: np.zeros(n, np.int32) for name in INT_ARRAYS}
    return Workspace(
        box=EngineBox(
            x,
            y,
            width,
            height,
            left=-math.inf if box.periodic_x else x,
            right=math.inf if box.periodic_x else x + width,
            bottom=-math.inf if box.periodic_y else y,
            top=math.inf if box.periodic_y else y + height,
            periodic_x=box.periodic_x,
            periodic_y=box.periodic_y,
        ),
        step=settings.time_step / frame.time,
        late=settings.collisions == "late",
        skin=2 * common * skin_of(scene, settings.time_step),
        common_radius=float(common),
        big=int(np.count_nonzero(radius > common)),
        tracer=int(frame.back[0]) if n else 0,
        **real_arrays,
        radius=radius,
        **int_arrays,
        mass=scene.mass[frame.order] / frame.mass,
        straight_since=np.zeros(n),
        cell_start=np.zeros(4 * n + 9, np.int32),
        **_empty_lists(16 * n + 64, box.has_images),
        counters=np.zeros(ws.COUNTERS, np.int64),
        count=np.zeros(ws.COUNTS, np.int64),
        tally=np.zeros(ws.TALLY),
    )


class Lists(TypedDict):
    """The fields of a workspace that depend on the capacity of its lists of pairs."""

    within: PairList
    across: PairList
    candidate: np.ndarray
    contact_time: np.ndarray
    contact_key: np.ndarray
    contact_pair: np.ndarray


def _empty_lists(capacity: int, has_images: bool) -> Lists:
    """Return lists of so many pairs within the box and across its periodic sides, and of twice as
    many candidates.
    """
    candidates = 2 * capacity
    return {
        "within": _empty_pairs(capacity),
        "across": _empty_pairs(capacity if has_images else 0),
        "candidate": np.zeros(candidates, np.uint32),
        "contact_time": np.zeros(candidates),
        "contact_key": np.zeros(candidates, np.int64),
        "contact_pair": np.zeros(candidates, np.uint32),
    }


def _empty_pairs(capacity: int) -> PairList:
    """Return a list of pairs with room for so many."""
    a = np.zeros(capacity, np.uint32)
    b = np.zeros(capacity, np.uint32)
    contact = np.zeros(capacity)
    return PairList(a, b, contact, shift_x=np.zeros(capacity), shift_y=np.zeros(capacity))


def skin_of(scene: Scene, time_step: float) -> float:
    """Return the skin of the lists, in contact distances, at which a run costs least.

    Per step, listed pairs cost in proportion to phi skin, and building lists costs in proportion to
    (path per step)/skin. The sum is least for a skin in proportion to sqrt(path per step/phi).
    """
    sigma = 2 * common_radius(scene.radius) if scene.particles else 1.0
    path = rms_speed(scene) * time_step / sigma
    most = 0.5 * min(scene.box.width, scene.box.height) / sigma
    cheapest = SKIN_FACTOR * math.sqrt(path / max(scene.packing_fraction, 1e-6))
    return min(cheapest, most)


def begin_run(w: Workspace, motion: np.ndarray) -> None:
    """Set a workspace to the start of a run with positions and velocities (N, 4), as
    `engines.units.motion_of` returns.

    BUDGET is negative, so that the first step builds the lists.
    """
    w.x[:], w.y[:], w.vx[:], w.vy[:] = motion.T
    w.x_at_build[:] = w.x
    w.y_at_build[:] = w.y
    w.radius[:] = w.radius[np.argsort(w.disk, kind="stable")]
    w.disk[:] = np.arange(len(w.disk))
    w.image_x[:] = 0
    w.image_y[:] = 0
    w.straight_since[:] = 0.0
    w.counters[:] = 0
    w.counters[ws.TRACER] = w.tracer
    w.count[:] = 0
    w.tally[:] = 0.0
    w.tally[ws.BUDGET] = -1.0
    w.tally[ws.NEAREST] = 1.0


# -- samples and reports ---------------------------------------------------------------------------


def new_recorder(
    scene: Scene, frame: Frame, time_step: float, times: np.ndarray, record: Collection[str]
) -> ws.Recorder:
    """Return memory for samples, free flights after the last step before each: no step depends on
    sample times.
    """
    steps = times / time_step
    nearest = np.rint(steps)
    is_whole = np.abs(steps - nearest) <= 1e-9 + 1e-12 * steps
    last = np.where(is_whole, nearest, np.floor(steps))
    rest = (times - last * time_step) / frame.time
    track = blank_samples(len(times), 1)
    whole = blank_samples(len(times), scene.particles if "all" in record else 0)
    return ws.Recorder(last.astype(np.int64), rest, track, whole)


def report_of(
    scene: Scene, frame: Frame, w: Workspace, first: np.ndarray, finite: bool
) -> dict[str, np.typing.ArrayLike]:
    """Return the report of a run from its workspace at the end and its motion (N, 4) at the
    beginning.

    The run fails, too, if its samples are not `finite`.
    """
    last = np.empty((len(w.disk), 4))
    last[w.disk] = np.stack([w.x, w.y, w.vx, w.vy], axis=1)
    count = w.count.tolist()
    impulses = w.tally[ws.VIRIAL :]
    elapsed = float(w.counters[ws.STEP] * w.step)
    conserved = conservation(w.mass, first, last, impulses[1:])
    sound = finite and math.isfinite(conserved.momentum_residual) and _none_escaped(w)
    sound = sound and can_count_images(scene, frame, elapsed / w.step, conserved.fastest * elapsed)
    collisions = [count[ws.PAIRS], count[ws.WALLS], count[ws.TRACER_PAIRS]]
    overlap = 1.0 - math.sqrt(w.tally[ws.NEAREST])
    values = report_in_scene_units(scene, frame, conserved, collisions, impulses, overlap, sound)
    if w.late:
        values["missed_collisions"] = count[ws.MISSED]
    return values


def _none_escaped(w: Workspace) -> bool:
    """Whether no disk has escaped beyond walls: REACHES."""
    box = w.box
    far = REACHES * w.tally[ws.FASTEST] * w.step + 1e-6 * max(box.width, box.height)
    left = box.left - far
    right = box.right + far
    bottom = box.bottom - far
    top = box.top + far
    has_escaped = reaches_beyond(w.x, w.y, w.radius, left, right, bottom, top)
    finite = np.isfinite(w.x + w.y + far)
    return bool(np.all(finite & ~has_escaped))
