"""The exact engine: event-driven molecular dynamics of hard disks, exact up to round-off. Here is
its `Definition`.

`simulation` makes runs. Kernels advance the disks from collision to collision (`events`) in a
`workspace`.
"""

from brownpipe.engines import forecast
from brownpipe.engines.definition import REFERENCE_NAME, Definition

EXACT = Definition(
    name=REFERENCE_NAME,
    summary="event by event",
    simulation="brownpipe.engines.exact.simulation",
    model=lambda scenes, settings: "from collision to collision",
    caution=forecast.caution,
    forecast=lambda scene, settings, *recorded: forecast.run_cost(scene, *recorded),
    keeps_checkpoints=True,
)
