"""What is in a trajectory file, dataset or product, in words: `brownpipe inspect`."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis.drift import (
    LEVEL,
    TOO_FEW,
    drift_of,
    in_words,
    is_tested,
    quarters_of,
    time_to_try,
)
from brownpipe.analysis.goodness import holm
from brownpipe.analysis.variables import EACH, FAILED, MISSING
from brownpipe.engines.ensemble import HEALTH, Ensemble, failures, select
from brownpipe.errors import RequestError, WrongFileError
from brownpipe.figures import tradeoff
from brownpipe.figures.cases import aligned
from brownpipe.figures.cases import in_words as label_in_words
from brownpipe.figures.origin import RECORD, installation_in_words, read_record
from brownpipe.figures.summary import summary
from brownpipe.observables.displacement import displacement
from brownpipe.provenance import made_with
from brownpipe.report.description import setup_in_words
from brownpipe.scene.reading import yaml_text
from brownpipe.scene.seeds import brief_seed_text, seed_text
from brownpipe.storage.datasets import read_contents, read_dataset
from brownpipe.storage.layout import described, dims_of
from brownpipe.storage.trajectories import Trajectories, read_trajectories
from brownpipe.text import counted, in_lines, shell_path
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from xarray import Dataset

DIGITS = 12  # shown of a digest
LINE, INDENT = 100, 13  # characters of a line, and of its heading
PRODUCTS = (
    ".png",
    ".svg",
    ".csv",
    ".txt",
    ".json",
    ".gif",
    ".html",
)  # of `brownpipe figures` and `movie`


def report(path: str | Path, seed: int | None = None) -> str:
    """Return what a trajectory file or dataset contains, as lines of text; of a `seed`, all about
    its run.

    Raises StorageError if the file is damaged, WrongFileError if it is of neither kind, FigureError
    for a dataset that is not as it was made, RequestError, which names the seeds of the file, if
    this one is not among them.
    """
    contents = read_contents(path) if seed is None else runs_of(path, seed)
    if isinstance(contents, Trajectories):
        lines, table = lines_on_runs(contents), table_of_runs(contents.ensemble)
        lines.append(f"run again    brownpipe inspect {shell_path(path)} --reproduce")
        step, made = "simulate", contents.header
        now = made_with(step, contents.engine.name)
    else:
        lines, table = lines_on_results(contents), table_of_results(contents)
        step, made = "tradeoff" if is_tradeoff(contents) else "aggregate", contents.attrs
        now = made_with(step)
    versions = [
        f"{name.removesuffix('_version')} {made[name]}"
        for name in made
        if name.endswith("_version")
    ]
    source = made.get("source_digest", "unknown")
    whose = (
        "that of this installation"
        if source == now["source_digest"]
        else "not that of this installation"
    )
    lines += [
        f"written by   {', '.join(versions) or 'unknown'}",
        f"source       of {step}: {source[:DIGITS]}, {whose}",
        "intact       yes: every byte as it was written",
    ]
    return in_lines([f"{path}  {Path(path).stat().st_size / 1e6:.2f} MB", *lines, "", *table])


def variables(path: str | Path) -> str:
    """Return a table of all variables of a dataset: dimensions, units and meaning. Errors as in
    `report`.
    """
    dataset = read_dataset(path)
    rows: list[tuple[str, ...]] = [("variable", "dimensions", "units", "meaning")]
    for name, variable in dataset.variables.items():
        attributes = (str(variable.attrs.get(key, "-")) for key in ("units", "long_name"))
        rows.append((str(name), ", ".join(map(str, variable.dims)), *attributes))
    return in_lines(aligned([*zip(*rows, strict=True)]))


def scene_text(path: str | Path) -> str:
    """Return the scene of a trajectory file as the text of a scene file (YAML). Errors as in
    `report`.
    """
    scene = read_trajectories(path).scene
    head = f"# Scene {scene.name} of a trajectory file, with all defaults. Digest: {scene.digest}"
    return f"{head}\n{yaml_text(scene.as_mapping())}"


def runs_of(path: str | Path, seed: int | None = None) -> Trajectories:
    """Return the contents of a trajectory file, or the run of one seed. Errors as in `report`."""
    contents = read_trajectories(path)
    seeds = contents.ensemble.seeds
    if seed is not None and seed not in seeds:
        raise RequestError(
            f"{path}: --seed {seed}: is not in the file; must be of {brief_seed_text(seeds)}"
        )
    return (
        contents
        if seed is None
        else contents._replace(ensemble=select(contents.ensemble, seeds == seed))
    )


# -- runs ------------------------------------------------------------------------------------------


def lines_on_runs(contents: Trajectories) -> list[str]:
    """Return the lines of the report on the runs of a trajectory file."""
    scene, engine, ensemble, *_ = contents
    times, box = ensemble.times, scene.box
    size, phi = f"{box.boundary} box {box.width:g} x {box.height:g}", scene.packing_fraction
    lines = [
        f"scene        {scene.name}: {scene.particles} disks in a {size}, packing fraction "
        f"{phi:.4g}",
        f"engine       {engine.options}",
        f"seeds        {seed_text(ensemble.seeds)} ({counted(len(ensemble.seeds), 'run')})",
        f"samples      {len(times)} from t = {times[0]:g} to {times[-1]:g}",
        f"recorded     {', '.join(sorted(contents.record)) or 'none'}",
        f"averages     over {ensemble.average}",
        f"health       {_health(ensemble)}",
        *equilibrium(contents),
    ]
    if ensemble.tracer is not None and len(ensemble.seeds) == 1 and not ensemble.stopped:
        moved = displacement(
            ensemble.tracer.position, ensemble.tracer.image, (box.width, box.height)
        )[-1, 0]
        lines += [
            f"displaced    by ({moved[0]:.6g}, {moved[1]:.6g}); squared displacement "
            f"{np.sum(moved**2):.6g}"
        ]
    return lines


def _health(ensemble: Ensemble) -> str:
    """Return which runs failed and, of each reported error, the largest with its seed; NaN is
    largest.
    """
    parts = [failures(ensemble) or "no failed runs"]
    complete = ~np.isin(ensemble.seeds, list(ensemble.stopped))
    for name in (name for name in HEALTH if name in ensemble.observables and complete.any()):
        sizes = np.abs(ensemble.observables[name][complete])
        seed = f" (seed {ensemble.seeds[complete][np.argmax(sizes)]})" if np.max(sizes) else ""
        parts.append(
            f"worst {name.removeprefix('worst_').replace('_', ' ')} {np.max(sizes):.2g}{seed}"
        )
    return "; ".join(parts)


def equilibrium(contents: Trajectories) -> list[str]:
    """Return whether the runs drift, if their scene claims to be in equilibrium from t = 0."""
    scene, ensemble = contents.scene, contents.ensemble
    if not is_tested(scene, contents.engine):
        return []
    kept = select(ensemble, ensemble.observables["failed"] == 0)
    found = drift_of(quarters_of(scene, ensemble.times, kept.observables))
    found = found._replace(p=holm(found.p))
    words = in_words(found, time_to_try(scene)) or f"no drift found (family-wise level {LEVEL:.0%})"
    return [f"equilibrium  {words if np.isfinite(found.p).any() else TOO_FEW}"]


def table_of_runs(ensemble: Ensemble) -> list[str]:
    """Return a table of all observables: mean, min and max of the runs that did not fail, or that
    of one run.

    Of arrays it has the dimensions instead.
    """
    several, shown = len(ensemble.seeds) > 1, ensemble.observables["failed"] == 0
    shown = shown if several else np.array([not ensemble.stopped])
    columns = ("mean", "min", "max") if several else ("value",)
    rows: list[tuple[str, ...]] = [
        ("observable", *(f"{name:>12}" for name in columns), "units", "meaning")
    ]
    for name in sorted(ensemble.observables.keys() - {"failed"}):
        values, numbers = ensemble.observables[name], ["", "", ""]
        units, meaning = [*described(name, ensemble.own).values()][:2]
        if values.ndim > 1:
            sizes = zip(dims_of("/", name, ensemble.own), values.shape, strict=True)
            meaning += f" ({', '.join(f'{dim} {size}' for dim, size in sizes)})"
        elif shown.any():
            numbers = [f"{of(values[shown]):12.6g}" for of in (np.mean, np.min, np.max)]
        rows.append((name, *numbers[: len(columns)], units, meaning))
    return aligned([*zip(*rows, strict=True)])


# -- results ---------------------------------------------------------------------------------------


def lines_on_results(dataset: Dataset) -> list[str]:
    """Return the lines of the report on a dataset: its sizes, and the largest errors of all runs,
    failed ones too.
    """
    sizes = {
        name: abs(dataset[name]) for name in ("energy_drift", "worst_overlap") if name in dataset
    }
    worst = {name: size.where(np.isfinite(size), 0.0).max().item() for name, size in sizes.items()}
    words = (
        f"worst {name.removeprefix('worst_').replace('_', ' ')} {size:.2g}"
        for name, size in worst.items()
    )
    indent = " " * INDENT
    simulated = list[str]()
    for paragraph in setup_in_words(dataset):
        simulated += textwrap.wrap(paragraph, LINE, initial_indent=indent, subsequent_indent=indent)
    if simulated:
        simulated[0] = simulated[0].replace(indent, "simulated".ljust(INDENT), 1)
    lines = [
        f"title        {dataset.attrs.get('title', '-')}",
        *simulated,
        f"dimensions   {', '.join(f'{name} {size}' for name, size in dataset.sizes.items())}",
        f"variables    {len(dataset.data_vars)}; --variables lists them with units and meaning",
    ]
    if worst:
        lines.append(f"health       {'; '.join(words)}")
    return lines


def table_of_results(dataset: Dataset) -> list[str]:
    """Return the results of a dataset of `brownpipe aggregate` or `brownpipe tradeoff` as their
    summaries show them.
    """
    return (tradeoff.summary if is_tradeoff(dataset) else summary)(dataset).splitlines()


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
    lines += [f"dataset      {dataset['sha256'][:DIGITS]}"] if dataset else []
    lines += [
        f"runs         {one['command']}"
        for one in (*dataset.get("made_from", ()), *record.get("made_from", ()))
    ]
    return [
        *lines,
        "scenes       are in the files of runs: brownpipe inspect FILE.h5 --scene > SCENE.yaml",
    ]


def failed_runs(path: str | Path) -> tuple[int, int, str]:
    """Return how many runs of a dataset failed, how many it has with those, and the cases and seeds
    in words.

    Raises StorageError if the file is damaged, WrongFileError if it is no dataset of `brownpipe
    aggregate` with the labels of its runs.
    """
    status = read_dataset(path).get("run_status")
    if status is None or not {*EACH, "seed"} <= set(status.dims):
        raise WrongFileError(
            f"{path}: has no runs with their labels; must be a dataset of brownpipe aggregate"
        )
    cases = []
    for place in zip(*np.nonzero((status == FAILED).any("seed").values), strict=True):
        words = label_in_words(
            status[place].coords.to_dataset(), map(str, status.dims[:-1])
        )  # the last is `seed`
        cases.append(
            f"{words}: seeds {brief_seed_text(status.seed.values[status[place].values == FAILED])}"
        )
    return int((status == FAILED).sum()), int((status != MISSING).sum()), "; ".join(cases)
