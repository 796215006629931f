"""What is in a trajectory file, dataset or product, in words: `brownpipe inspect`."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis.drift import (
    LEVEL,
    TOO_FEW,
    drift_in_words,
    drift_of,
    is_tested,
    quarters_of,
    time_to_try,
)
from brownpipe.analysis.goodness import holm
from brownpipe.analysis.variables import CASE_DIMS, FAILED, MISSING
from brownpipe.engines.ensemble import HEALTH, Ensemble, failures, select
from brownpipe.errors import RequestError, WrongFileError
from brownpipe.figures.cases import aligned, labels_in_words
from brownpipe.figures.origin import RECORD, installation_in_words, read_record
from brownpipe.figures.summary import summary
from brownpipe.observables.trajectory import Track, displacement
from brownpipe.provenance import made_with
from brownpipe.report.description import setup_in_words
from brownpipe.scene import Scene
from brownpipe.scene.reading import yaml_text
from brownpipe.scene.sections import GivenDisks
from brownpipe.scene.seeds import brief_seed_text, seed_text
from brownpipe.storage.datasets import read_contents, read_dataset
from brownpipe.storage.layout import described, dims_of
from brownpipe.storage.trajectories import Trajectories, read_trajectories
from brownpipe.text import counted, in_lines, shell_path
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from xarray import Dataset

# Of a digest, shown
DIGITS = 12
# Characters of a line, and of its heading
LINE = 100
INDENT = 13
# Endings of the files of `brownpipe figures` and `movie`
PRODUCTS = (".png", ".svg", ".csv", ".txt", ".json", ".gif", ".html")


def file_report(path: str | Path, seed: int | None = None) -> str:
    """Return what a trajectory file or dataset contains, as lines of text; of a `seed`, all about
    its run.

    Raises StorageError if the file is damaged, WrongFileError if it is of neither kind, FigureError
    for a dataset that is not as it was made, RequestError, which names the seeds of the file, if
    this one is not among them.
    """
    contents = read_contents(path) if seed is None else read_runs(path, seed)
    if isinstance(contents, Trajectories):
        lines = lines_on_runs(contents)
        lines.append(f"run again    brownpipe inspect {shell_path(path)} --reproduce")
        lines += _origin_in_words("simulate", contents.header, contents.engine.name)
        table = table_of_runs(contents.ensemble)
    else:
        lines = lines_on_results(contents)
        lines += _origin_in_words(
            "tradeoff" if is_tradeoff(contents) else "aggregate", contents.attrs
        )
        table = summary(contents).splitlines()
    lines.append("intact       yes: every byte as it was written")
    megabytes = Path(path).stat().st_size / 1e6
    return in_lines([f"{path}  {megabytes:.2f} MB", *lines, "", *table])


def _origin_in_words(step: str, header: Mapping[str, object], *engine: str) -> list[str]:
    """Return the lines on the versions and the source that wrote a file with this header, by a
    step of a study.
    """
    versions = [
        f"{name.removesuffix('_version')} {version}"
        for name, version in header.items()
        if name.endswith("_version")
    ]
    source = str(header.get("source_digest", "unknown"))
    is_here = source == made_with(step, *engine)["source_digest"]
    whose = "that of this installation" if is_here else "not that of this installation"
    return [
        f"written by   {', '.join(versions) or 'unknown'}",
        f"source       of {step}: {source[:DIGITS]}, {whose}",
    ]


def table_of_variables(path: str | Path) -> str:
    """Return a table of all variables of a dataset: dimensions, units and meaning. Errors as in
    `file_report`.
    """
    dataset = read_dataset(path)
    rows: list[tuple[str, ...]] = [("variable", "dimensions", "units", "meaning")]
    for name, variable in dataset.variables.items():
        dims = ", ".join(map(str, variable.dims))
        units = str(variable.attrs.get("units", "-"))
        meaning = str(variable.attrs.get("long_name", "-"))
        rows.append((str(name), dims, units, meaning))
    return in_lines(aligned([*zip(*rows, strict=True)]))


def scene_text(path: str | Path) -> str:
    """Return the scene of a trajectory file as the text of a scene file (YAML). Errors as in
    `file_report`.
    """
    scene = read_trajectories(path).scene
    if isinstance(scene.disks, GivenDisks):
        cure = f"brownpipe export {shell_path(path)} --to scene writes the scene and its disks"
        raise RequestError(f"{path}: its disks were in a file; {cure}")
    head = f"# Scene {scene.name} of a trajectory file, with all defaults. Digest: {scene.digest}"
    return f"{head}\n{yaml_text(scene.as_mapping())}"


def read_runs(path: str | Path, seed: int | None = None) -> Trajectories:
    """Return the contents of a trajectory file, or the run of one seed.

    Errors as in `file_report`.
    """
    contents = read_trajectories(path)
    seeds = contents.ensemble.seeds
    if seed is not None and seed not in seeds:
        raise RequestError(
            f"{path}: --seed {seed}: is not in the file; must be of {brief_seed_text(seeds)}"
        )
    if seed is None:
        return contents
    return contents._replace(ensemble=select(contents.ensemble, seeds == seed))


# -- runs ------------------------------------------------------------------------------------------


def lines_on_runs(contents: Trajectories) -> list[str]:
    """Return the lines of the report on the runs of a trajectory file."""
    scene = contents.scene
    ensemble = contents.ensemble
    times = ensemble.times
    box = scene.box.with_size_in_words
    disks = f"{scene.particles} disks in a {box}, packing fraction {scene.packing_fraction:.4g}"
    seeds = f"{seed_text(ensemble.seeds)} ({counted(len(ensemble.seeds), 'run')})"
    samples = f"{len(times)} from t = {times[0]:g} to {times[-1]:g}"
    recorded = ", ".join(sorted(contents.record)) or "none"
    lines = [
        f"scene        {scene.name}: {disks}",
        f"engine       {contents.engine.options}",
        f"seeds        {seeds}",
        f"samples      {samples}",
        f"recorded     {recorded}",
        f"averages     over {ensemble.average}",
        f"health       {_health(ensemble)}",
        *equilibrium(contents),
    ]
    if ensemble.tracer is not None and len(ensemble.seeds) == 1 and not ensemble.stopped:
        lines.append(f"displaced    by {_displacement_in_words(scene, ensemble.tracer)}")
    return lines


def _displacement_in_words(scene: Scene, tracer: Track) -> str:
    """Return the displacement of the tracer from the start to the end of a run, and its square."""
    sides = (scene.box.width, scene.box.height)
    x, y = displacement(tracer.position, tracer.image, sides)[-1, 0]
    return f"({x:.6g}, {y:.6g}); squared displacement {x**2 + y**2:.6g}"


def _health(ensemble: Ensemble) -> str:
    """Return which runs failed and, of each reported error, the largest with its seed; NaN is
    largest.
    """
    parts = [failures(ensemble) or "no failed runs"]
    complete = ~np.isin(ensemble.seeds, list(ensemble.stopped))
    seeds = ensemble.seeds[complete]
    for name in HEALTH:
        if name not in ensemble.observables or not complete.any():
            continue
        sizes = np.abs(ensemble.observables[name][complete])
        largest = np.max(sizes)
        seed = f" (seed {seeds[np.argmax(sizes)]})" if largest else ""
        parts.append(f"{_worst_in_words(name, largest)}{seed}")
    return "; ".join(parts)


def _worst_in_words(name: str, size: float) -> str:
    """Return the largest error of this name in words.

    >>> _worst_in_words("worst_overlap", 2.5e-13)
    'worst overlap 2.5e-13'
    """
    error = name.removeprefix("worst_").replace("_", " ")
    return f"worst {error} {size:.2g}"


def equilibrium(contents: Trajectories) -> list[str]:
    """Return whether the runs drift, if their scene claims to be in equilibrium from t = 0."""
    scene = contents.scene
    ensemble = contents.ensemble
    if not is_tested(scene, contents.engine):
        return []
    complete = select(ensemble, ensemble.observables["failed"] == 0)
    drift = drift_of(quarters_of(scene, ensemble.times, complete.observables))
    if not np.isfinite(drift.p).any():
        return [f"equilibrium  {TOO_FEW}"]
    drift = drift._replace(p=holm(drift.p))
    words = drift_in_words(drift, time_to_try(scene))
    return [f"equilibrium  {words or f'no drift found (family-wise level {LEVEL:.0%})'}"]


def table_of_runs(ensemble: Ensemble) -> list[str]:
    """Return a table of all observables: mean, min and max of the runs that did not fail, or that
    of one run.

    Of arrays it has the dimensions, those of one run, instead.
    """
    statistics: dict[str, Callable[[np.ndarray], float]]
    if len(ensemble.seeds) > 1:
        shown = ensemble.observables["failed"] == 0
        statistics = {"mean": np.mean, "min": np.min, "max": np.max}
    else:
        shown = np.array([not ensemble.stopped])
        statistics = {"value": np.mean}
    headings = [f"{name:>12}" for name in statistics]
    rows: list[tuple[str, ...]] = [("observable", *headings, "units", "meaning")]
    for name in sorted(ensemble.observables.keys() - {"failed"}):
        values = ensemble.observables[name]
        units, meaning = [*described(name, ensemble.own).values()][:2]
        numbers = [""] * len(statistics)
        if values.ndim > 1:
            _, *dims = dims_of("/", name, ensemble.own)  # of the array of each run
            sizes = [f"{dim} {size}" for dim, size in zip(dims, values.shape[1:], strict=True)]
            meaning += f" ({', '.join(sizes)})"
        elif shown.any():
            numbers = [f"{statistic(values[shown]):12.6g}" for statistic in statistics.values()]
        rows.append((name, *numbers, units, meaning))
    return aligned([*zip(*rows, strict=True)])


# -- results ---------------------------------------------------------------------------------------


def lines_on_results(dataset: Dataset) -> list[str]:
    """Return the lines of the report on a dataset: its sizes, and the largest errors of all runs,
    failed ones too.
    """
    worst = []
    for name in ("energy_drift", "worst_overlap"):
        if name in dataset:
            sizes = abs(dataset[name])
            largest = sizes.where(np.isfinite(sizes), 0.0).max().item()
            worst.append(_worst_in_words(name, largest))
    indent = " " * INDENT
    simulated = list[str]()
    for paragraph in setup_in_words(dataset):
        simulated += textwrap.wrap(paragraph, LINE, initial_indent=indent, subsequent_indent=indent)
    if simulated:
        simulated[0] = simulated[0].replace(indent, "simulated".ljust(INDENT), 1)
    dimensions = ", ".join(f"{name} {size}" for name, size in dataset.sizes.items())
    lines = [
        f"title        {dataset.attrs.get('title', '-')}",
        *simulated,
        f"dimensions   {dimensions}",
        f"variables    {len(dataset.data_vars)}; --variables lists them with units and meaning",
    ]
    if worst:
        lines.append(f"health       {'; '.join(worst)}")
    return lines


def describe_product(path: str | Path) -> list[str]:
    """Return lines that say what made a figure, page or movie, and by which commands its runs are
    made again.

    Raises WrongFileError for a file that does not say what it was made from, or that cannot be
    read.
    """
    try:
        record = read_record(path)
    except OSError as error:
        raise WrongFileError(f"{path}: cannot be read: {error.strerror or error}") from error
    if record is None:
        raise WrongFileError(
            f"{path}: does not say what it was made from, and no {RECORD} beside it does"
        )
    dataset = record.get("dataset", {})
    lines = [f"{path}  made by {installation_in_words(record['made_by'])}"]
    if dataset:
        lines.append(f"dataset      {dataset['sha256'][:DIGITS]}")
    for runs in (*dataset.get("made_from", ()), *record.get("made_from", ())):
        lines.append(f"runs         {runs['command']}")
    lines.append(
        "scenes       are in the files of runs: brownpipe inspect FILE.h5 --scene > SCENE.yaml"
    )
    return lines


def failed_runs(path: str | Path) -> tuple[int, int, str]:
    """Return how many runs of a dataset failed, how many it has with those, and the cases and seeds
    in words.

    Raises StorageError if the file is damaged, WrongFileError if it is no dataset of `brownpipe
    aggregate` with the labels of its runs.
    """
    status = read_dataset(path).get("run_status")
    if status is None or not {*CASE_DIMS, "seed"} <= set(status.dims):
        raise WrongFileError(
            f"{path}: has no runs with their labels; must be a dataset of brownpipe aggregate"
        )
    has_failed = status == FAILED
    labels = [str(dim) for dim in status.dims[:-1]]  # the last is `seed`
    cases = []
    for place in zip(*np.nonzero(has_failed.any("seed").values), strict=True):
        case = has_failed[place]
        title = labels_in_words(case.coords.to_dataset(), labels)
        seeds = case.seed.values[case.values]
        cases.append(f"{title}: seeds {brief_seed_text(seeds)}")
    runs = int((status != MISSING).sum())
    return int(has_failed.sum()), runs, "; ".join(cases)
