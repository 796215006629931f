"""The user's own observables, tried on one run before a study makes all of them."""

from contextlib import suppress

from brownpipe.engines import Engine
from brownpipe.engines.definition import REFERENCE_NAME
from brownpipe.errors import PlacementError
from brownpipe.observables.own import is_own
from brownpipe.scene import Scene
from brownpipe.scene.reading import YamlValue
from brownpipe.study.study import Study

LONGEST = 2.0  # s of CPU that a run may take by its forecast; otherwise it is shortened


def refuse_mistakes(study: Study) -> None:
    """Call the user's own observables of a study once, for its cheapest case and its first seed.

    Raises RequestError for an exception in a function, and for arrays that cannot be used, such as
    those with a name that is taken. Nothing is tried if the disks of this run find no places.
    """
    own = tuple(filter(is_own, study.observables))
    cases = [use.case for use in study.uses if use.engine.moves_all_disks]
    if not own or not cases:
        return
    exact = Engine(REFERENCE_NAME)
    seconds = [exact.forecast(case, study.record, own, study.average).seconds for case in cases]
    cheapest = seconds.index(min(seconds))
    scene = shortened(cases[cheapest], LONGEST / seconds[cheapest])
    with suppress(PlacementError):
        exact.simulate(scene, study.seeds[:1], study.record, observables=own, average=study.average)


def shortened(scene: Scene, share: float) -> Scene:
    """Return a scene with all its times shorter by a factor, if that is below 1: its runs have as
    many samples.
    """
    if share >= 1:
        return scene
    times: dict[str, YamlValue] = {"duration": share * scene.duration}
    if scene.samples is None:
        times["sample_interval"] = share * scene.sample_interval
    else:
        first = share * scene.samples.first
        times["samples"] = {"per_decade": scene.samples.per_decade, "first": first}
    if scene.equilibrate.time > 0:
        before = scene.equilibrate
        times["equilibrate"] = {"time": share * before.time, "tracer": before.tracer}
    return scene.replace(None, **times)
