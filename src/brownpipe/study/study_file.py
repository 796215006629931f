"""Study files: strict reading, with every refusal in one line (config/README.md describes the keys).

Each key has a function here that takes its `Entry` (value, file and key) and returns the value for the `Study`, or
raises a RequestError that names file, key, value and what is allowed. A new key needs its default in DEFAULTS (messages
list the keys in this order), such a function, its argument in `read_study`, a field of `Study`, and a row in
config/README.md.
"""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from brownpipe import observables as measures
from brownpipe.engines import read_engine
from brownpipe.engines.units import thermal_speed
from brownpipe.errors import RequestError
from brownpipe.figures.catalogue import COLLISIONS, FIGURES, FOLLOWED, SEVERAL_COUNTS, SPREADING, TRACKED
from brownpipe.quoting import shell_path
from brownpipe.scene import Scene, parse_scene, reading
from brownpipe.scene.reading import Entry, must_be, refuse
from brownpipe.scene.sample_times import default_fit_windows
from brownpipe.scene.scene_file import MOST_BYTES, MOST_DISKS, is_study
from brownpipe.scene.scene_file import REQUIRED as SCENE_KEYS
from brownpipe.scene.schema import key_names, scene_schema
from brownpipe.scene.seeds import MOST_SEEDS, read_seeds
from brownpipe.scene.yaml_file import read_yaml
from brownpipe.study.study import EngineUse, Study

MOST_STUDY_BYTES = 2**20  # larger files are refused
SMALLEST_TOLERANCE = MOST_SEEDS**-0.5  # a relative error
MOST_RINGS = 100_000
MOST_JOBS = 10_000  # Snakemake plans these in half a minute, and needs 0.03 s of CPU time to start each

AUTO = "auto"  # batch: from the forecast
RECORDS = ("tracer", "none")
TARGETS = ("msd", "d", "displacement_distribution")  # quantities that a tolerance can be given for
PERCENTAGE = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+) ?%")
LISTS = ("particles", "engines", "observables", "figures", "displacement_times")  # keys of plain lists
REPLACED = {"seeds": ("tolerance", "target", "observable"), "tolerance": ("seeds",)}  # by a new value of these keys
RENAMED_KEYS = {"observable": "target"}
RENAMED_TARGETS = {"displacement": "displacement_distribution"}
DEFAULTS = {
    "seeds": None,  # either these
    "tolerance": None,  # or this
    "target": None,  # with a tolerance: the first of TARGETS
    "particles": None,  # those of each scene file
    "engines": ["exact"],
    "batch": AUTO,
    "record": "tracer",
    "observables": [],
    "average": "runs",
    "figures": None,  # all whose needs are met
    "displacement_times": [],  # the end of each run
    "fit_windows": None,  # from 0.1 and from 0.5 of the shortest duration to its end
    "rings": None,  # from the data
    "instead_of": {},
    "allow_failed": 0,
}


def read_study(path: str | Path, overrides: dict | None = None) -> Study:
    """Return the study in a YAML file; paths of scenes are relative to the folder of that file.

    `overrides` replaces top-level keys; seeds also replace a tolerance, and a tolerance the seeds. Raises RequestError,
    one line, for any mistake in the study, or in any of its scenes with any of its particle counts.
    """
    mapping, file = read_yaml(path, MOST_STUDY_BYTES), str(path)
    if isinstance(mapping, dict) and not is_study(mapping) and mapping.keys() & set(SCENE_KEYS):
        raise RequestError(
            f"{path}: is a scene, not a study; run it with brownpipe simulate {shell_path(path)}, or list it in a study"
        )
    whole = reading.whole(mapping, file)
    if overrides and isinstance(mapping, dict):
        gone = [key for new, old in REPLACED.items() if overrides.get(new) is not None for key in old]
        file = f"{path} with {', '.join(map(str, overrides))} replaced"
        origin = whole.origin and whole.origin._replace(keys=dict.fromkeys((*gone, *overrides)))
        kept = {key: value for key, value in mapping.items() if key not in gone}
        whole = Entry(kept | overrides, file, (), origin)
    _refuse_keys_of_scenes(whole)
    entries = reading.fields(_with_new_names(whole), ("scenes",), DEFAULTS)
    scenes = _scenes(entries["scenes"], Path(path).parent)
    cases = _cases(scenes, entries["particles"])
    ring_width, rings = read_rings(entries["rings"])
    record = reading.choice(entries["record"], RECORDS)
    observables, average = _measures(entries["observables"], entries["average"], cases)
    tolerance, target = _tolerance(entries, cases)
    uses, batch = _engine_uses(entries["engines"], cases), entries["batch"]
    study = Study(
        name=reading.name(Entry(Path(path).stem, file, ("name of the file",))),
        scenes=scenes,
        cases=cases,
        engine_uses=uses,
        seeds=read_seeds(entries["seeds"]) if tolerance is None else (),
        batch=None if batch.value == AUTO else reading.integer(batch, 1, MOST_SEEDS, f" or {AUTO}"),
        figures=_figures(entries["figures"], cases, uses, record, observables),
        displacement_times=_displacement_times(entries["displacement_times"], cases),
        fit_windows=_windows(entries["fit_windows"], cases),
        ring_width=ring_width,
        rings=rings,
        record=record,
        observables=observables,
        average=average,
        tolerance=tolerance,
        target=target,
        instead_of=_instead_of(entries["instead_of"], cases),
        allow_failed=reading.integer(entries["allow_failed"], 0, MOST_SEEDS),
    )
    for seeds in (study.seeds, *(use.seeds for use in study.engine_uses if use.seeds)):
        refuse_repetition(cases, seeds, entries["seeds"])
    jobs = len(study.jobs())
    if jobs > MOST_JOBS:
        must_be(batch, f"large enough for at most {MOST_JOBS} jobs ({jobs} with this one)")
    return study


def from_command_line(values: Mapping[str, object], where: str = "--config") -> dict[str, object]:
    """Return the values of `snakemake --config KEY=VALUE` with the types that they would have in a study file.

    Snakemake reads numbers inside lists and mappings, null, true and false as text. A key that takes a list takes a
    text with commas, too: particles=50,150. Raises RequestError, naming `where` and the key, for what no file may have.
    """
    entries = {key: Entry(_listed(key, value), where, (key,)) for key, value in values.items()}
    for entry in entries.values():
        reading.refuse_huge(entry)
    return {key: reading.with_types(entry) for key, entry in entries.items()}


def _listed(key: str, value: object) -> object:
    """Return the parts of a text with commas as a list, if the key takes a list; otherwise the value."""
    if key in LISTS and isinstance(value, str) and "," in value and value[0] not in "[{":
        return [part.strip() for part in value.split(",")]
    return value


def _refuse_keys_of_scenes(entry: Entry) -> None:
    """Refuse a key at the head of a study that belongs into a scene."""
    unknown = set(entry.value if isinstance(entry.value, dict) else ()) - {*DEFAULTS, "name"}
    for key in sorted(unknown & key_names(scene_schema())):
        hint = "it is a key of scenes: write it in a scene file, and list that file under scenes"
        refuse(entry, f"unknown key '{key}'; {hint}", at=entry.part(key, ""))


def _with_new_names(entry: Entry) -> Entry:
    """Return the mapping of a study with keys of earlier versions replaced by the current ones."""
    if not isinstance(entry.value, dict) or not entry.value.keys() & RENAMED_KEYS.keys():
        return entry
    mapping: dict[str, object] = {}
    names: dict[str, str | None] = {}
    for key, value in entry.value.items():
        name = RENAMED_KEYS.get(key, key)
        if name != key and name in entry.value:
            refuse(entry.part(key, value), f"is the old name of {name}; must be given once")
        reading.current_name(Entry(key, entry.file), RENAMED_KEYS)
        mapping[name] = value
        names |= {} if name == key else {name: key}
    origin = entry.origin and entry.origin._replace(keys={**names, **entry.origin.keys})
    return entry._replace(value=mapping, origin=origin)


def refuse_repetition(scenes: Sequence[Scene], seeds: Sequence[int], entry: Entry | None = None) -> None:
    """Raise RequestError for several seeds of a scene that lists its disks: all runs would be identical."""
    listed = [scene.name for scene in scenes if scene.disks]
    if listed and len(seeds) > 1:
        why = f"as the disks of {listed[0]} are listed one by one and leave nothing to chance"
        refuse(entry or Entry(None, "", ("seeds",)), f"must be one seed, {why}; found {len(seeds)}")


def why_no_relative_error(scenes: Sequence[Scene]) -> str | None:
    """Return why no number of runs has a relative error in one of the scenes; None if each has one."""
    for scene in scenes:
        if scene.disks or not scene.particles:
            return f"{scene.name} leaves nothing to chance"
        if thermal_speed(scene) == 0.0:
            return f"in {scene.name} nothing moves"
    return None


def _one_or_more(entry: Entry) -> list[Entry]:
    """Return the entries of a list that is not empty; a single value stands for a list of one."""
    entries = reading.items(entry) if isinstance(entry.value, list | tuple) else [entry]
    return entries or must_be(entry, "a list that is not empty")


def _scenes(entry: Entry, folder: Path) -> tuple[Path, ...]:
    """Return the paths of the scene files. Their stems name the scenes in results, and so must differ."""
    paths = {}
    for item in _one_or_more(entry):
        if not isinstance(item.value, str) or not item.value:
            must_be(item, "the path of a scene file, relative to the study file")
        if Path(item.value).stem in paths:
            must_be(item, "a scene with a name (file stem) of its own")
        path = folder / item.value
        if not os.path.exists(path):
            _refuse_unreadable(item, path)
        paths[Path(item.value).stem] = path
    return tuple(paths.values())


def _refuse_unreadable(item: Entry, path: Path) -> None:
    """Refuse the path of a scene file, for the reason that `read_yaml` gives."""
    try:
        read_yaml(path, MOST_BYTES)
    except RequestError as error:
        refuse(item, reading.shortened(str(error)))


def _cases(scenes: tuple[Path, ...], particles: Entry) -> tuple[Scene, ...]:
    """Return every scene with every particle count, or with its own for `particles` of None."""
    entries = () if particles.value is None else _one_or_more(particles)
    counts = [reading.integer(entry, 0, MOST_DISKS) for entry in entries] or [None]
    if len(set(counts)) < len(counts):
        must_be(particles, "particle counts that differ")
    mappings = [(read_yaml(path, MOST_BYTES), str(path)) for path in scenes]
    return tuple(parse_scene(mapping, path, count) for mapping, path in mappings for count in counts)


def _engine_uses(entry: Entry, cases: tuple[Scene, ...]) -> tuple[EngineUse, ...]:
    """Return the engines, each fit for its scenes; no engine with the same settings runs a scene twice."""
    uses = tuple(_engine_use(item, cases) for item in _one_or_more(entry))
    pairs = [(use.engine, scene) for use in uses for scene in use.scenes]
    return uses if len(set(pairs)) == len(pairs) else must_be(entry, "engines or settings that differ")


def _engine_use(entry: Entry, cases: tuple[Scene, ...]) -> EngineUse:
    """Return an engine with its settings; a mapping may also name the scenes it is used in, and its seeds."""
    names = tuple(dict.fromkeys(case.name for case in cases))
    own = {}
    if isinstance(entry.value, dict):
        own = {key: entry.part(key, entry.value[key]) for key in ("scenes", "seeds") if key in entry.value}
        entry = entry._replace(value={key: value for key, value in entry.value.items() if key not in own})
    engine = read_engine(entry)
    scenes = tuple(reading.choice(item, names) for item in _one_or_more(own["scenes"])) if "scenes" in own else names
    for case in cases:
        if case.name in scenes:
            try:
                engine.refuse_unfit(case)
            except RequestError as error:
                refuse(entry, str(error))
    return EngineUse(engine, scenes, read_seeds(own["seeds"]) if "seeds" in own else None)


def read_tolerance(entry: Entry) -> float:
    """Return a relative error: a number, or a text like "2%"; SMALLEST_TOLERANCE to below 1. Raises RequestError."""
    allowed = "a relative error above 0 and below 1, like 0.02 or 2%"
    text = PERCENTAGE.fullmatch(entry.value) if isinstance(entry.value, str) else None
    value = float(text[1]) / 100 if text else entry.value
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1:
        must_be(entry, allowed)
    if value < SMALLEST_TOLERANCE:
        must_be(entry, f"at least {SMALLEST_TOLERANCE:.2g}, for at most some {MOST_SEEDS} runs")
    return float(value)


def read_target(entry: Entry) -> str:
    """Return the quantity that a tolerance is for, one of TARGETS; the first for None. Raises RequestError."""
    if entry.value is None:
        return TARGETS[0]
    return reading.choice(reading.current_name(entry, RENAMED_TARGETS), TARGETS)


def _tolerance(entries: dict[str, Entry], cases: tuple[Scene, ...]) -> tuple[float | None, str | None]:
    """Return the tolerance that a study has in place of seeds and what it is for; None, None for a study with seeds."""
    tolerance, target, seeds = (entries[key] for key in ("tolerance", "target", "seeds"))
    if (tolerance.value is None) == (seeds.value is None):
        missing = "missing; must be given, or a tolerance instead"
        twice = "must not be given with a tolerance, which says how many"
        refuse(seeds, missing if tolerance.value is None else twice)
    if tolerance.value is None:
        if target.value is not None:
            refuse(target, "must not be given without a tolerance, which is for it")
        return None, None
    if reason := why_no_relative_error(cases):
        refuse(tolerance, f"{reason}; must be seeds: 1")
    return read_tolerance(tolerance), read_target(target)


def _instead_of(entry: Entry, cases: tuple[Scene, ...]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return (scene, scenes that may be run in its place); these have the same sample times."""
    by_name = {case.name: case for case in cases}
    substitutes = []
    for scene, item in reading.fields(entry, (), dict.fromkeys(by_name)).items():
        listed = () if item.value is None else _one_or_more(item)
        names = tuple(reading.choice(name, tuple(by_name)) for name in listed)
        for name in names:
            if name == scene or not np.array_equal(by_name[name].times, by_name[scene].times):
                must_be(item, f"other scenes with the sample times of {scene}")
        substitutes += [(scene, names)] if names else []
    return tuple(substitutes)


def _measures(observables: Entry, average: Entry, cases: tuple[Scene, ...]) -> tuple[tuple[str, ...], str]:
    """Return the observables measured in each run and what they average over; every scene must allow them."""
    listed = () if observables.value in (None, []) else _one_or_more(observables)
    current = [reading.current_name(name, measures.RENAMED) for name in listed]
    names = tuple(reading.choice(name, tuple(measures.OBSERVABLES)) for name in current)
    over = reading.choice(average, measures.AVERAGES)
    for case in cases:
        refusal = measures.problem(case, names, over)
        if refusal is not None:
            key, why = refusal
            refuse({"observables": observables, "average": average}[key], f"{case.name}, N = {case.particles}: {why}")
    return names, over


def _figures(
    entry: Entry, cases: tuple[Scene, ...], uses: tuple[EngineUse, ...], record: str, observables: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the figures of the study; by default all whose needs are met."""
    counts = {case.particles for case in cases} - {0}
    counting = {name for use in uses if use.engine.definition.counts_collisions for name in use.scenes}
    measured = {name for use in uses for name in use.engine.definition.measured(observables, "runs")[0]}
    met = {f"the observable {name}" for name in measured}
    met |= {FOLLOWED} if counts else set()
    met |= {COLLISIONS} if any(case.particles and case.name in counting for case in cases) else set()
    met |= {SEVERAL_COUNTS} if len(counts) > 1 else set()
    met |= {TRACKED} if record == "tracer" else set()
    met |= {SPREADING} if record == "tracer" or "square_displacement" in measured else set()
    unmet = {name: [need for need in figure.needs if need not in met] for name, figure in FIGURES.items()}
    if entry.value is None:
        return tuple(name for name in FIGURES if not unmet[name])
    names = tuple(reading.choice(item, tuple(FIGURES)) for item in _one_or_more(entry))
    for name in names:
        if unmet[name]:
            refuse(entry, f"{name} needs {unmet[name][0]}")
    return names if len(set(names)) == len(names) else must_be(entry, "figures that differ")


def _windows(entry: Entry, cases: tuple[Scene, ...]) -> tuple[tuple[float, float], ...]:
    """Return the time windows of the fits. A window of the file has at least three sample times of every scene."""
    if entry.value is None:
        return default_fit_windows(min(case.duration for case in cases))
    windows = []
    for item in reading.items(entry) or must_be(entry, "a list that is not empty"):
        t0, t1 = (reading.number(end, least=0) for end in reading.items(item, 2, "two times [t0, t1]"))
        for case in cases:
            inside = np.count_nonzero((case.times >= t0) & (case.times <= t1))
            if not t0 < t1 <= case.duration or inside < 3:
                must_be(item, f"[t0, t1] with t0 < t1 <= {case.duration!r} and three samples or more of {case.name}")
        windows.append((t0, t1))
    if len({f"{t0:g} {t1:g}" for t0, t1 in windows}) < len(windows):
        must_be(entry, "windows that differ in their first six digits")
    return tuple(windows)


def _displacement_times(entry: Entry, cases: tuple[Scene, ...]) -> tuple[float, ...]:
    """Return the times of the displacement distribution; each is a sample time of at least one scene."""
    times: list[float] = []
    for item in reading.items(entry) if entry.value == [] else _one_or_more(entry):
        time = reading.number(item, above=0)
        if not any(np.isclose(case.times, time, rtol=1e-9, atol=0.0).any() for case in cases):
            must_be(item, "a sample time of some scene")
        if np.isclose(times, time, rtol=1e-9, atol=0.0).any():
            must_be(item, "given once")
        times.append(time)
    return tuple(times)


def read_rings(entry: Entry) -> tuple[float, int] | tuple[None, None]:
    """Return width and number of the rings; None, None to derive them from the data. Raises RequestError."""
    if entry.value is None:
        return None, None
    entries = reading.fields(entry, ("dr", "count"))
    return reading.number(entries["dr"], above=0), reading.integer(entries["count"], 1, MOST_RINGS)
