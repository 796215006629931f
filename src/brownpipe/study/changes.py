"""Differences between a study and its trajectory files, in words: the reasons for simulating again."""

from collections import defaultdict
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from brownpipe.errors import StorageError
from brownpipe.provenance import NAME, UNKNOWN, modules_of, source_digest, versions
from brownpipe.scene import Scene
from brownpipe.scene.reading import Entry
from brownpipe.scene.scene import as_mapping
from brownpipe.storage.trajectories import Outline, read_header, read_outline
from brownpipe.study.run_count import settle
from brownpipe.study.study import SimulationJob, Study

MOST_KEYS = 8  # of a scene that are listed


def changes(study: Study) -> list[str]:
    """Return a line for each difference between a study and its trajectory files; empty if it has none of these yet.

    Of each case the oldest file is read, because files are made again one after the other.
    """
    study = settle(study, f"results/{study.name}/plan.yaml", lambda _: None, dry_run=True)
    scenes = {(case.name, case.particles): case for case in study.cases}
    found: dict[str, list[str]] = defaultdict(list)  # line: cases
    cases, there = [], 0
    for (scene, particles, engine), jobs in groupby(study.jobs(), key=lambda job: job[:3]):
        cases.append(f"{scene} N{particles} {engine}")
        files = {Path(f"results/{study.name}/simulate") / job.file: job for job in jobs}
        folder = next(iter(files)).parent
        there += folder.is_dir()
        for line in (*_in_files(list(files), scenes[scene, particles], study), *_in_seeds(folder, files)):
            found[line].append(cases[-1])
    lines = [
        line if _is_common(line, names, cases) else f"{line} ({', '.join(names)})" for line, names in found.items()
    ]
    return lines if there else []


def _is_common(line: str, names: list[str], cases: list[str]) -> bool:
    return names == cases or line.startswith(("scene ", "engine "))


def _in_files(files: list[Path], scene: Scene, study: Study) -> Iterator[str]:
    """Yield what differs between the oldest of some files and what would be written now."""
    present = [file for file in files if file.is_file()]
    if not present:
        return
    oldest = min(present, key=lambda file: file.stat().st_mtime_ns)
    try:
        outline, header = read_outline(oldest), read_header(oldest)
    except StorageError as error:
        yield str(error)
        return
    before, now = (dict(_flat(Entry(as_mapping(each), ""))) for each in (outline.scene, scene))
    keys = [key for key in before | now if before.get(key) != now.get(key)]
    for key in keys[:MOST_KEYS]:
        yield f"scene {scene.name}: {key} {_shown(before.get(key))} -> {_shown(now.get(key))}"
    if len(keys) > MOST_KEYS:
        yield f"scene {scene.name}: {len(keys) - MOST_KEYS} more keys"
    yield from _in_recording(outline, study)
    if outline.source != source_digest(*modules_of("simulate", outline.engine.name)):
        yield f"engine {outline.engine.name}: its source code"
    for key, new in versions().items():
        old, name = header.get(key, UNKNOWN), key.removesuffix("_version")
        if old != new and name != NAME:
            yield f"engine {outline.engine.name}: {name} {old} -> {new}"


def _in_recording(outline: Outline, study: Study) -> Iterator[str]:
    """Yield what differs between what a file's runs record and measure and what the study asks for."""
    if outline.observables is None or not outline.scene.particles:  # no run came to its end, or nothing is recorded
        return
    record, asked, average = study.recording
    observables, average = outline.engine.definition.measured(asked, average)
    pairs = {
        "record": (outline.record, record - {"none"}),
        "observables": (set(outline.observables), set(observables)),
        "average": ({outline.average}, {average}),
    }
    for key, (before, now) in pairs.items():
        if before != now:
            yield f"{key} {_shown(sorted(before))} -> {_shown(sorted(now))}"


def _in_seeds(folder: Path, files: dict[Path, SimulationJob]) -> Iterator[str]:
    """Yield how many of the seeds have been run and how many are to be, or that they are divided into other jobs."""
    if all(file.is_file() for file in files):
        return
    run, wanted = list(_ranges(folder)), [(job.first, job.last) for job in files.values()]
    in_both, asked = _number_in_both(run, wanted), _number_in(wanted)
    if in_both == asked:
        yield "batch: the same seeds in other jobs"
        return
    again = _number_in_both(run, [(job.first, job.last) for file, job in files.items() if not file.is_file()])
    remark = f"; {again} of them again, in other jobs (not with the key batch: N)" if again else ""
    if in_both and in_both == _number_in(run):
        yield f"seeds {in_both} -> {asked}{remark}"
    elif run:
        yield f"seeds: {in_both} of {asked} have been run{remark}"
    else:
        yield "no runs yet"


def _number_in_both(some: list[tuple[int, int]], others: list[tuple[int, int]]) -> int:
    """Return how many seeds are in both of two lists of ranges."""
    return _number_in(some) + _number_in(others) - _number_in(some + others)


def _number_in(ranges: list[tuple[int, int]]) -> int:
    """Return how many seeds there are in ranges (first, last), in any order; each counts once."""
    count, end = 0, -1
    for first, last in sorted(ranges):
        count += max(0, last - max(first, end + 1) + 1)
        end = max(end, last)
    return count


def _ranges(folder: Path) -> Iterator[tuple[int, int]]:
    """Yield first and last seed of each trajectory file in a folder, from its name."""
    for file in folder.glob("*-*.h5"):
        first, _, last = file.stem.partition("-")
        if first.isdigit() and last.isdigit():
            yield int(first), int(last)


def _flat(entry: Entry) -> Iterator[tuple[str, object]]:
    """Yield the key and value of every number, word and list of numbers in a mapping."""
    value, path = entry.value, entry.path
    if isinstance(value, dict):
        parts = list(value.items())
    elif isinstance(value, list | tuple) and any(isinstance(item, dict) for item in value):
        parts = list(enumerate(value))
    else:
        yield entry.key, list(value) if isinstance(value, tuple) else value
        return
    for key, part in parts:
        yield from _flat(Entry(part, "", (*path, key)))


def _shown(value: object) -> str:
    """Return a value as in a scene file."""
    if isinstance(value, list):
        return f"[{', '.join(map(_shown, value))}]"
    return "none" if value is None else repr(value) if isinstance(value, float) else str(value)
