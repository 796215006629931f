"""A batch of runs: an ensemble that any engine fills, run by run."""

from typing import NamedTuple

import numpy as np

from brownpipe.scene import Scene
from brownpipe.state import Ensemble, Events, Track


class Run(NamedTuple):
    """What an engine hands back of one run."""

    tracer: Track  # M = 1
    whole: Track | None  # M = N
    events: Events | None
    observables: dict[str, float | int]


def room_for(scene: Scene, seeds: np.ndarray) -> Ensemble:
    """Return an ensemble to be filled."""
    shape = (len(scene.times), len(seeds), 2)
    image = np.empty(shape, np.int32) if scene.box.periodic else None
    return Ensemble(seeds, scene.times, Track(np.empty(shape), None, image), {}, {}, {})


def enter(batch: Ensemble, column: int, one: Run) -> None:
    """Enter a run that is finished."""
    seed = int(batch.seeds[column])
    batch.tracer.position[:, column] = one.tracer.position[:, 0]
    if one.tracer.image is not None:
        batch.tracer.image[:, column] = one.tracer.image[:, 0]
    for name, value in one.observables.items():
        value = np.asarray(value)
        values = batch.observables.setdefault(name, np.empty((len(batch.seeds), *value.shape), value.dtype))
        values[column] = value
    if one.whole is not None:
        batch.whole[seed] = one.whole
    if one.events is not None:
        batch.events[seed] = one.events


def filled(scene: Scene, batch: Ensemble, record) -> Ensemble:
    """Return the ensemble with what `record` asks for."""
    return batch if scene.particles and "tracer" in record else batch._replace(tracer=None)
