"""The state of all disks at t = 0: drawn from the seed, then equilibrated by the exact engine if the scene says so.

All engines that move all disks start from these states.
"""

import numpy as np

from brownpipe.engines.exact.run import NOT_SAVED, PreparedScene, RunState, Saving, beginning, evolve, prepare_scene
from brownpipe.engines.initial_state import without_total_momentum
from brownpipe.engines.units import State
from brownpipe.errors import RunError
from brownpipe.scene import Scene


def prepare_equilibration(scene: Scene) -> PreparedScene | None:
    """Return what equilibrates the states of a scene; None if it has no time to equilibrate."""
    return prepare_scene(scene, scene.equilibrate.tracer == "pinned") if scene.equilibrate.time > 0 else None


def equilibrate(
    prepared: PreparedScene | None, state: State, stored: RunState | None = None, saving: Saving = NOT_SAVED
) -> State:
    """Run a drawn state for the scene's time to equilibrate, or continue a stored run; return the state at t = 0.

    `prepared` is from `prepare_equilibration`; if it is None, the drawn state is returned. A pinned tracer keeps its
    place and regains its velocity at t = 0. Raises RunError if the run fails its health check or makes no progress.
    """
    if prepared is None:
        return state
    scene = prepared.scene
    moving = np.arange(len(state.mass)) >= int(prepared.pinned)  # all disks, or all but the tracer
    start = beginning(prepared, state._replace(velocity=state.velocity * moving[:, None]))
    start = start._replace(equilibrating=True) if stored is None else stored
    result = evolve(prepared, start, np.array([scene.equilibrate.time]), {"all"}, saving)
    if result.observables["failed"]:
        raise RunError("the time to equilibrate failed its health check")
    position, velocity = result.whole.position[-1], result.whole.velocity[-1]
    if prepared.pinned:
        position[0] = state.position[0]
        velocity[0] = state.velocity[0]
    if scene.velocities.zero_momentum:
        velocity = without_total_momentum(velocity, state.mass)
    return state._replace(position=position, velocity=velocity)
