"""The run of each scene that the page of a study shows in motion: the typical one, whose squared
displacement at the end is the median of the good runs.

Runs of a study record no collisions. So the run of that seed is made again by the exact engine,
with its collisions, as far as a replay goes.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brownpipe.analysis.variables import VARIED, average_of
from brownpipe.engines import Engine, forecast
from brownpipe.engines.definition import REFERENCE_NAME
from brownpipe.figures.cases import cases_of, one_count, title_of
from brownpipe.provenance import source_digest
from brownpipe.report.replay import MOST_COLLISIONS, RECORD, Replay, replay_of
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.variation import value_of
from brownpipe.storage.trajectories import RunsRecord, Trajectories
from brownpipe.text import in_time

if TYPE_CHECKING:
    from xarray import Dataset

MOST_SCENES = 4  # on a page: some 1.5 MB
MOST_DISKS = 3000  # of a scene
MOST_SECONDS = 5.0  # of CPU time, forecast for a run
MARGIN = 1.2  # of the time until which a replay goes, over that forecast
EXACT = Engine(REFERENCE_NAME)
RECORDS = frozenset(RECORD.split(","))


class InMotion(NamedTuple):
    """A scene in motion, or why it is not shown so."""

    caption: str
    replay: Replay | None


def scenes_in_motion(dataset: Dataset, particles: int | None = None) -> list[InMotion]:
    """Return the typical run of each scene of exact runs, of the first MOST_SCENES: with
    `particles` disks, by default its largest number, and with the first values of varied keys.

    None of a dataset without values of single runs, such as a trade-off.
    """
    if "run_msd" not in dataset:
        return []
    first_cases: dict[str, Dataset] = {}
    for case in one_count(cases_of(dataset), particles):
        is_known = bool(case.run_msd.notnull().any())
        if case.engine == REFERENCE_NAME and is_known:
            first_cases.setdefault(case.scene.item(), case)
    shown = [*first_cases.values()][:MOST_SCENES]
    scenes = [(case, _record_of(dataset, case)) for case in shown]
    return [_in_motion(case, record) for case, record in scenes if record is not None]


def typical_seed(case: Dataset) -> int:
    """Return the seed of the good run whose squared displacement at the end is the median: of an
    even number of runs the smaller of the middle two. With averages within runs, which are not of
    the tracer at the end, it is the first good run.
    """
    good_runs = case.run_msd.dropna("seed")
    if average_of(case) != "runs":
        return int(good_runs.seed.values[0])
    order = np.argsort(good_runs.values, kind="stable")
    middle = order[(len(order) - 1) // 2]
    return int(good_runs.seed.values[middle])


def _record_of(dataset: Dataset, case: Dataset) -> RunsRecord | None:
    """Return the record of the exact runs of a case; None if the dataset does not have it."""
    keys = dataset.attrs.get(VARIED, "").split()
    paths = [dataset[key].attrs["long_name"] for key in keys]
    labels = [case[key].item() for key in keys]
    engine = f"--engine {EXACT.options}"
    for record in json.loads(dataset.attrs.get("made_from", "[]")):
        name = record.get("name", "")
        is_of_scene = name == case.scene or name.startswith(f"{case.scene.item()},")
        if is_of_scene and engine in record["command"]:
            scene = _scene_of(record)
            values = [value_of(scene, path) for path in paths]
            if scene.particles == case.particles and values == labels:
                return record
    return None


def _scene_of(record: RunsRecord, **keys: object) -> Scene:
    """Return the scene of a record of runs, with other values of some keys."""
    mapping = record["scene"] | keys
    return parse_scene(mapping, record["name"], name=record["name"])


def _in_motion(case: Dataset, record: RunsRecord) -> InMotion:
    """Return the replay of the typical run of a case, or why there is none."""
    title = title_of(case)
    if case.particles > MOST_DISKS:
        return InMotion(f"{title}: too many disks to be shown in motion on a page.", None)
    if record["source_digest"] != source_digest("simulate", REFERENCE_NAME):
        other = "not shown in motion, as its runs were made by another version of brownpipe"
        return InMotion(f"{title}: {other}.", None)
    scene = shortened(record)
    seconds = EXACT.forecast(scene, RECORDS, (), "runs").seconds
    if seconds > MOST_SECONDS:
        cost = f"making a run again takes {in_time(seconds)}"
        return InMotion(f"{title}: not shown in motion, as {cost}.", None)
    seed = typical_seed(case)
    ensemble = EXACT.simulate(scene, [seed], RECORDS)
    replay = replay_of(Trajectories(scene, EXACT, ensemble), seed)
    runs = "the only run"
    if int(case.runs) > 1 and average_of(case) == "runs":
        runs = "a typical run (of median squared displacement)"
    elif int(case.runs) > 1:
        runs = "the first run"
    end = replay.data["end"]
    whole = "" if end == case.duration else f", the first {end:.3g} of {float(case.duration):g}"
    return InMotion(f"{title}: {runs}, seed {seed}{whole}", replay)


def shortened(record: RunsRecord) -> Scene:
    """Return the scene of some runs, until its run has some MOST_COLLISIONS collisions, or to its
    end; sampled at t = 0 and at the end alone.
    """
    scene = _scene_of(record)
    rate = forecast.pair_rate(scene) + forecast.wall_rate(scene)
    duration = scene.duration
    if rate > 0:
        duration = min(duration, MARGIN * MOST_COLLISIONS / rate)
    return _scene_of(record, duration=duration, sample_interval=duration, samples=None)
