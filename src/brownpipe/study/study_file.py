"""Study files: strict reading, and every refusal in one line (config/README.md describes every key)."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from brownpipe import observables as measures
from brownpipe.engines import read_engine
from brownpipe.scene import Scene, parse_scene, reading
from brownpipe.scene.reading import Entry, must_be, refuse
from brownpipe.scene.scene_file import MOST_BYTES, MOST_DISKS
from brownpipe.scene.seeds import MOST_SEEDS, read_seeds
from brownpipe.study.study import Study, Use

MOST_STUDY_BYTES = 2**20
MOST_JOBS = 1000  # `aggregate` names the files of all jobs in one command line; a shell takes 128 KiB

FOLLOWED, COUNTS = "a disk to follow", "two particle counts or more"
TRACKED, SPREADING = "record: tracer", "record: tracer, or square_displacement among the observables"
FIGURES = {  # name: what it needs
    "msd": (FOLLOWED, SPREADING),
    "displacement_distribution": (FOLLOWED, TRACKED),
    "diffusion": (FOLLOWED, SPREADING),
    "velocity_autocorrelation": ("the observable velocity_autocorrelation",),
    "velocity_distribution": ("the observable velocity_distribution",),
    "pair_distribution": ("the observable pair_distribution",),
    "energy": ("the observable species_energy",),
    "thermodynamics": (FOLLOWED,),
    "particle_counts": (COUNTS, SPREADING),
    "health": (),
}
RECORDS = ("tracer", "none")
OBSERVABLES = ("msd", "d", "displacement")  # that a tolerance can be for
DEFAULTS = {
    "seeds": None,  # one of the two
    "tolerance": None,
    "observable": None,  # the first, with a tolerance
    "particles": None,  # of each scene file
    "engines": ["exact"],
    "batch": 2400,
    "record": "tracer",
    "observables": [],
    "average": "runs",
    "figures": None,  # all that there is something to show in
    "displacement_times": [],  # the end of each run
    "fit_windows": None,  # from a tenth and from a half of the shortest duration to its end
    "rings": None,  # from the data
    "instead_of": {},
}


def read_study(path: str | Path, overrides: dict | None = None) -> Study:
    """Return the study of a YAML file. Its scenes are found relative to the folder of that file.

    `overrides` replaces top-level keys (`snakemake --config seeds=100`). Raises RequestError, one line, for whatever is
    wrong with the study or with any of its scenes at any of its particle counts.
    """
    mapping, file = reading.read_yaml(path, MOST_STUDY_BYTES), str(path)
    if overrides and isinstance(mapping, dict):
        mapping, file = mapping | overrides, f"{path} with {', '.join(map(str, overrides))} replaced"
    given = reading.fields(Entry(mapping, file), ("scenes",), DEFAULTS)
    scenes = _scenes(given["scenes"], Path(path).parent)
    cases = _cases(scenes, given["particles"])
    ring_width, rings = _rings(given["rings"])
    record = reading.choice(given["record"], RECORDS)
    observables, average = _measures(given["observables"], given["average"], cases)
    tolerance, observable = _tolerance(given, cases)
    study = Study(
        name=reading.name(Entry(Path(path).stem, file, ("name of the file",))),
        scenes=scenes,
        cases=cases,
        uses=_uses(given["engines"], cases),
        seeds=read_seeds(given["seeds"]) if tolerance is None else (),
        batch=reading.integer(given["batch"], 1, MOST_SEEDS),
        figures=_figures(given["figures"], cases, record, observables),
        displacement_times=_displacement_times(given["displacement_times"], cases),
        fit_windows=_windows(given["fit_windows"], cases),
        ring_width=ring_width,
        rings=rings,
        record=record,
        observables=observables,
        average=average,
        tolerance=tolerance,
        observable=observable,
        instead_of=_instead_of(given["instead_of"], cases),
    )
    for seeds in (study.seeds, *(use.seeds for use in study.uses if use.seeds)):
        refuse_repetition(cases, seeds, given["seeds"])
    jobs = len(study.jobs())
    if jobs > MOST_JOBS:
        must_be(given["batch"], f"large enough for at most {MOST_JOBS} jobs ({jobs} with this one)")
    return study


def refuse_repetition(scenes: Sequence[Scene], seeds: Sequence[int], entry: Entry | None = None) -> None:
    """Raise RequestError for several seeds of a list of disks: its runs are all the same, and no sample of anything."""
    listed = [scene.name for scene in scenes if scene.disks]
    if listed and len(seeds) > 1:
        why = f"as the disks of {listed[0]} are listed one by one and leave nothing to chance"
        refuse(entry or Entry(None, "", ("seeds",)), f"must be one seed, {why}; found {len(seeds)}")


def _one_or_more(entry: Entry) -> list[Entry]:
    """Return the entries of a list that is not empty; a single value stands for a list of one."""
    entries = reading.items(entry) if isinstance(entry.value, list | tuple) else [entry]
    return entries or must_be(entry, "a list that is not empty")


def _scenes(entry: Entry, folder: Path) -> tuple[Path, ...]:
    paths = {}
    for one in _one_or_more(entry):
        if not isinstance(one.value, str) or not one.value:
            must_be(one, "the path of a scene file, relative to the study file")
        if Path(one.value).stem in paths:
            must_be(one, "a scene with a name (file stem) of its own")
        paths[Path(one.value).stem] = folder / one.value
    return tuple(paths.values())


def _cases(scenes: tuple[Path, ...], particles: Entry) -> tuple[Scene, ...]:
    given = () if particles.value is None else _one_or_more(particles)
    counts = [reading.integer(one, 0, MOST_DISKS) for one in given] or [None]
    if len(set(counts)) < len(counts):
        must_be(particles, "particle counts that differ")
    read = [(reading.read_yaml(scene, MOST_BYTES), str(scene)) for scene in scenes]
    return tuple(parse_scene(mapping, where, count) for mapping, where in read for count in counts)


def _uses(entry: Entry, cases: tuple[Scene, ...]) -> tuple[Use, ...]:
    uses = tuple(_use(one, cases) for one in _one_or_more(entry))
    each = [(use.engine, scene) for use in uses for scene in use.scenes]
    return uses if len(set(each)) == len(each) else must_be(entry, "engines or settings that differ")


def _use(entry: Entry, cases: tuple[Scene, ...]) -> Use:
    """An engine with its settings; a mapping may also say in which scenes it is used, and for which seeds."""
    names, own = tuple(dict.fromkeys(case.name for case in cases)), {}
    if isinstance(entry.value, dict):
        own = {
            key: Entry(entry.value[key], entry.file, (*entry.path, key))
            for key in ("scenes", "seeds")
            if key in entry.value
        }
        entry = entry._replace(value={key: value for key, value in entry.value.items() if key not in own})
    engine = read_engine(entry)
    scenes = tuple(reading.choice(one, names) for one in _one_or_more(own["scenes"])) if "scenes" in own else names
    for case in cases:
        if case.name in scenes:
            engine.refuse_unfit(case)
    return Use(engine, scenes, read_seeds(own["seeds"]) if "seeds" in own else None)


def read_tolerance(entry: Entry) -> float:
    """Return a relative error: a number, or a text like "2%"; above 0 and below 1. Raises RequestError."""
    allowed = "a relative error above 0 and below 1, like 0.02 or 2%"
    text = re.fullmatch(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+) ?%", entry.value) if isinstance(entry.value, str) else None
    value = float(text[1]) / 100 if text else entry.value
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1:
        must_be(entry, allowed)
    return float(value)


def _tolerance(given: dict[str, Entry], cases: tuple[Scene, ...]) -> tuple[float | None, str | None]:
    """Return the tolerance that stands instead of a number of seeds, and what it is for."""
    tolerance, observable = given["tolerance"], given["observable"]
    if (tolerance.value is None) == (given["seeds"].value is None):
        missing = "missing; must be given, or a tolerance instead"
        twice = "must not be given with a tolerance, which says how many"
        refuse(given["seeds"], missing if tolerance.value is None else twice)
    if tolerance.value is None:
        if observable.value is not None:
            refuse(observable, "must not be given without a tolerance, which is for it")
        return None, None
    fixed = [case.name for case in cases if case.disks or not case.particles]
    if fixed:
        refuse(tolerance, f"{fixed[0]} leaves nothing to chance; must be seeds: 1")
    value = read_tolerance(tolerance)
    return value, reading.choice(observable, OBSERVABLES) if observable.value is not None else OBSERVABLES[0]


def _instead_of(entry: Entry, cases: tuple[Scene, ...]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return which scenes of the study may be run instead of which; with the same sample times."""
    known = {case.name: case for case in cases}
    given = []
    for scene, one in reading.fields(entry, (), dict.fromkeys(known)).items():
        names = () if one.value is None else tuple(reading.choice(name, tuple(known)) for name in _one_or_more(one))
        for name in names:
            if name == scene or not np.array_equal(known[name].times, known[scene].times):
                must_be(one, f"other scenes with the sample times of {scene}")
        given += [(scene, names)] if names else []
    return tuple(given)


def _measures(observables: Entry, average: Entry, cases: tuple[Scene, ...]) -> tuple[tuple[str, ...], str]:
    """Return what is measured in each run, and the averages made there; every scene must have it."""
    listed = observables.value not in (None, []) and _one_or_more(observables)
    current = [reading.current_name(name, measures.RENAMED) for name in listed or ()]
    names = tuple(reading.choice(name, tuple(measures.OBSERVABLES)) for name in current)
    over = reading.choice(average, measures.AVERAGES)
    for case in cases:
        found = measures.problem(case, names, over)
        if found is not None:
            key, why = found
            refuse({"observables": observables, "average": average}[key], f"{case.name}, N = {case.particles}: {why}")
    return names, over


def _figures(entry: Entry, cases: tuple[Scene, ...], record: str, observables: tuple[str, ...]) -> tuple[str, ...]:
    """Return the figures; the default is all that there is something to show in."""
    moving = {case.particles for case in cases} - {0}
    there = {f"the observable {name}" for name in observables}
    there |= {FOLLOWED} if moving else set()
    there |= {COUNTS} if len(moving) > 1 else set()
    there |= {TRACKED} if record == "tracer" else set()
    there |= {SPREADING} if record == "tracer" or "square_displacement" in observables else set()
    lacking = {name: [one for one in needs if one not in there] for name, needs in FIGURES.items()}
    if entry.value is None:
        return tuple(name for name in FIGURES if not lacking[name])
    names = tuple(reading.choice(one, tuple(FIGURES)) for one in _one_or_more(entry))
    for name in (name for name in names if lacking[name]):
        reading.refuse(entry, f"{name} needs {lacking[name][0]}")
    return names if len(set(names)) == len(names) else must_be(entry, "figures that differ")


def _windows(entry: Entry, cases: tuple[Scene, ...]) -> tuple[tuple[float, float], ...]:
    """Return the time windows of the fits; those asked for have at least three sample times of every scene."""
    if entry.value is None:
        end = min(case.duration for case in cases)
        return ((0.1 * end, end), (0.5 * end, end))
    windows = []
    for one in reading.items(entry) or must_be(entry, "a list that is not empty"):
        t0, t1 = (reading.number(end, least=0) for end in reading.items(one, 2, "two times [t0, t1]"))
        for case in cases:
            inside = np.count_nonzero((case.times >= t0) & (case.times <= t1))
            if not t0 < t1 <= case.duration or inside < 3:
                must_be(one, f"[t0, t1] with t0 < t1 <= {case.duration!r} and three samples or more of {case.name}")
        windows.append((t0, t1))
    if len({f"{t0:g} {t1:g}" for t0, t1 in windows}) < len(windows):
        must_be(entry, "windows that differ in their first six digits")
    return tuple(windows)


def _displacement_times(entry: Entry, cases: tuple[Scene, ...]) -> tuple[float, ...]:
    """Return the times of the displacement distribution; each is a sample time of some scene."""
    times = []
    for one in reading.items(entry):
        time = reading.number(one, above=0)
        if not any(np.isclose(case.times, time, rtol=1e-9, atol=0.0).any() for case in cases):
            must_be(one, "a sample time of some scene")
        if np.isclose(times, time, rtol=1e-9, atol=0.0).any():
            must_be(one, "given once")
        times.append(time)
    return tuple(times)


def _rings(entry: Entry) -> tuple[float, int] | tuple[None, None]:
    if entry.value is None:
        return None, None
    given = reading.fields(entry, ("dr", "count"))
    return reading.number(given["dr"], above=0), reading.integer(given["count"], 1, 100_000)
