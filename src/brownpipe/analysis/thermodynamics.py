"""Collision counts."""

from brownpipe.analysis.measure import Columns, Measure, with_error
from brownpipe.analysis.variables import EACH, error_of

COLLISIONS = ("pair_collisions", "wall_collisions", "tracer_collisions")


def _sample(case, runs):
    return Columns({name: runs.observables[name] for name in COLLISIONS if name in runs.observables})


def _estimate(case, found):
    counted = [with_error(name, found.estimate(name)) for name in COLLISIONS if name in found]
    return {name: value for values in counted for name, value in values.items()}


MEASURE = Measure(
    _sample,
    _estimate,
    {
        **error_of("pair_collisions", EACH, "1", "mean number of collisions between disks in a run"),
        **error_of("wall_collisions", EACH, "1", "mean number of collisions with walls in a run"),
        **error_of("tracer_collisions", EACH, "1", "mean number of collisions of the tracer with other disks in a run"),
    },
)
