"""The exact engine: event-driven molecular dynamics of hard disks.

`simulation` makes a batch of runs: each is drawn, equilibrated (`equilibration`), run (`run`) and measured. Its kernels
advance the disks from collision to collision (`events`) on the arrays of a `workspace`.
"""

from brownpipe.engines import forecast
from brownpipe.engines.definition import Definition

EXACT = Definition(
    name="exact",
    summary="event by event",
    simulation="brownpipe.engines.exact.simulation",
    settings={},
    model=lambda scenes, settings: "from collision to collision",
    refuse_unfit=lambda scene, settings, record: None,  # every valid scene can be run and recorded
    caution=forecast.few_collisions,
    forecast=lambda scene, settings, *recorded: forecast.of_run(scene, *recorded),
    candidates=lambda scene: [{}],  # no settings
    keeps_checkpoints=True,
)
