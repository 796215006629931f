"""The time-stepping engine, for comparison: all disks fly for a fixed time, then the pairs that met collide.

This file has its `Definition`; `simulation` says how it works.
"""

from collections.abc import Collection

from brownpipe.engines import forecast
from brownpipe.engines.definition import Definition, Setting, one_of
from brownpipe.engines.timestep.settings import COLLISIONS, largest_step, refuse_unfit
from brownpipe.scene.reading import Positive
from brownpipe.scene.scene import Scene

SECONDS_PER_DISK_STEP = 1.5e-9  # CPU seconds per disk and time step
SECONDS_PER_CROSSING = 5e-7  # CPU seconds for lists of pairs while a disk moves by the distance of neighbours
TRIAL_STEPS = (0.5, 0.15, 0.05)  # that `brownpipe plan` tries, in units of the largest allowed step; to one digit


def _forecast(
    scene: Scene, settings: dict, record: Collection[str], observables: Collection[str], average: str
) -> forecast.Cost:
    """Return the cost of a run: that of an exact one, plus that of the time steps and of the lists of pairs."""
    exact = forecast.of_run(scene, record, observables, average)
    steps = scene.duration / settings["time_step"]
    seconds = SECONDS_PER_DISK_STEP * scene.particles * steps
    seconds += SECONDS_PER_CROSSING * scene.duration * forecast.crossing_rate(scene, forecast.mixture_of(scene))
    return exact._replace(seconds=exact.seconds + seconds)


TIMESTEP = Definition(
    name="timestep",
    summary="in steps",
    simulation="brownpipe.engines.timestep.simulation",
    settings={
        "time_step": Setting(Positive, "DT", "must be given"),
        "collisions": one_of(COLLISIONS, "WHEN", "at_contact (default) or late", default="at_contact"),
    },
    model=lambda scenes, settings: "all disks, in time steps",
    refuse_unfit=refuse_unfit,
    caution=forecast.few_collisions,
    forecast=_forecast,
    candidates=lambda scene: [{"time_step": float(f"{largest_step(scene) * part:.1g}")} for part in TRIAL_STEPS],
)
