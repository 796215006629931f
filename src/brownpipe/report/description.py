"""What is simulated, in plain words: box, disks, start, times, seeds and engines."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis.variables import VARIED
from brownpipe.engines.start.placement import is_grown
from brownpipe.observables.equilibrium import claims_equilibrium
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.scene.species import SpeciesTable, species_table
from brownpipe.scene.variation import is_number
from brownpipe.storage.trajectories import RunsRecord
from brownpipe.text import counted

if TYPE_CHECKING:
    from xarray import Dataset

# What sentences are about, in this order
SUBJECTS = ("disks", "start", "velocities", "run")
# Values of a varied key that are listed one by one
MOST_VALUES = 8


def disks_in_words(scene: Scene) -> str:
    """Return the species of a scene with their numbers, radii and masses, and the place of the
    tracer.

    >>> import brownpipe as bp
    >>> disk = {"position": [1, 1], "velocity": [1, 0], "radius": 0.5, "mass": 1}
    >>> disks_in_words(bp.Scene(box={"x": [0, 4], "y": [0, 4]}, disks=[disk], duration=9))
    '1 kind-1 (radius 0.5, mass 1, starts at (1, 1))'
    """
    table = species_table(scene)
    words = []
    for k, name in enumerate(table.name):
        size = f"radius {_range_of(scene.radius, table, k)}, mass {_range_of(scene.mass, table, k)}"
        if k == 0 and table.number[0] == 1 and scene.tracer_position is not None:
            x, y = scene.tracer_position
            size += f", starts at ({x:g}, {y:g})"
        words.append(f"{table.number[k]} {name} ({size})")
    return ", ".join(words) or "none"


def _range_of(values: np.ndarray, table: SpeciesTable, species: int) -> str:
    """Return the values (N,) of the disks of a species in words: 0.5, or 0.4 to 0.6."""
    values_of_species = values[table.species_index == species]
    least = values_of_species.min()
    most = values_of_species.max()
    return f"{least:g}" if least == most else f"{least:g} to {most:g}"


def start_in_words(scene: Scene) -> str:
    """Return how disks are placed and equilibrated, and whether that leaves out equilibrium."""
    placed = "on a lattice" if scene.placement == "lattice" else "placed at random"
    if scene.configuration is not None:
        placed = "at given places"
    placed += " as smaller disks that grow" if is_grown(scene) else ""
    if not scene.equilibrate.time:
        return placed
    tracer = f" with the tracer {scene.equilibrate.tracer}" if scene.has_tracer else ""
    unsettled = "" if claims_equilibrium(scene) else ", which is not equilibrium"
    return f"{placed}, then equilibrated for {scene.equilibrate.time:g}{tracer}{unsettled}"


def velocities_in_words(scene: Scene) -> str:
    """Return the distribution of the initial velocities, and whether the total momentum is zero, in
    a channel along its periodic axis.
    """
    velocities = scene.velocities
    if velocities is None:
        return "given"
    if velocities.temperature is not None:
        width = f"temperature kT = {velocities.temperature:g}"
    else:
        width = f"standard deviation {velocities.standard_deviation:g} of each component"
    momentum = f"; the total momentum{scene.box.along} is zero" if velocities.zero_momentum else ""
    velocity = scene.tracer_velocity
    tracer = (
        "" if velocity is None else f"; that of the tracer is ({velocity[0]:g}, {velocity[1]:g})"
    )
    return f"{velocities.distribution}, {width}{tracer}{momentum}"


def times_in_words(scene: Scene) -> str:
    """Return the duration of a run and its samples."""
    return f"from t = 0 to {scene.duration:g}, {len(scene.times):,} samples"


def sentences(scene: Scene) -> dict[str, str]:
    """Return a sentence for each of SUBJECTS."""
    place = f"a box {scene.box.width:g} x {scene.box.height:g} with reflecting walls"
    if scene.box.has_images:
        place = f"a {scene.box.with_size_in_words}"
    number = counted(scene.particles, "disk")
    density = f"packing fraction {scene.packing_fraction:.4g}"
    disks = f"{number} in {place}, {density}: {disks_in_words(scene)}."
    return {
        "disks": disks,
        "start": f"Start: {start_in_words(scene)}.",
        "velocities": f"Initial velocities: {velocities_in_words(scene)}.",
        "run": f"A run: {times_in_words(scene)}.",
    }


def setup_in_words(dataset: Dataset) -> list[str]:
    """Return paragraphs on what the runs of a dataset simulate.

    What all scenes share is said once, then of each scene what it does not share. Of a scene with
    several particle counts or values of varied keys the first is described, and what varies is
    named before.
    """
    made_from = json.loads(dataset.attrs.get("made_from", "[]"))
    records: list[RunsRecord] = [
        record for record in made_from if "name" in record
    ]  # not in datasets of 0.1.0
    described = dict[str, dict[str, str]]()
    for record in records:
        name = _file_of(record)
        if name not in described:
            described[name] = sentences(parse_scene(record["scene"], name, name=name))
    if not described:
        return []
    shared = list[str]()
    for subject in SUBJECTS:
        texts = {scene[subject]: None for scene in described.values()}
        if len(texts) == 1:
            shared += texts
    beginning = []
    if varied := _varied_in_words(dataset, records):
        beginning.append(f"Varied: {varied}; described is the first of them.")
    if len(described) > 1:
        beginning.append("All scenes:")
    runs = _runs_in_words(dataset, len(records))
    paragraphs = [" ".join([*beginning, *shared, runs]).strip()]
    for name, scene in described.items():
        particular = [sentence for sentence in scene.values() if sentence not in shared]
        if particular:
            paragraphs.append(f"{name}: {' '.join(particular)}")
    return paragraphs


def _file_of(record: RunsRecord) -> str:
    """Return the name of the scene file of some runs, without the values of varied keys."""
    return record["name"].partition(",")[0]


def _varied_in_words(dataset: Dataset, records: Sequence[RunsRecord]) -> str:
    """Return the varied keys and the number of disks with their values; "" if nothing varies."""
    keys = dataset.attrs.get(VARIED, "").split()
    together = len({dataset[key].dims for key in keys}) < len(keys)
    words = []
    for key in keys:
        values = _values_in_words(dataset[key].values.tolist())
        words.append(f"{dataset[key].attrs['long_name']} = {values}")
    varied = (" together with " if together else "; ").join(words)
    alike = [record for record in records if record["name"] == records[0]["name"]]
    counts = {record["scene"]["particles"] for record in alike if "particles" in record["scene"]}
    if len(counts) > 1:
        numbers = f"number of disks = {_values_in_words(sorted(counts))}"
        varied = f"{varied}; {numbers}" if varied else numbers
    return varied


def _values_in_words(values: Sequence[float | str]) -> str:
    """Return values as a list or, if there are more than MOST_VALUES, the first, last and number.

    >>> _values_in_words([0.1, 0.2])
    '0.1, 0.2'
    >>> _values_in_words([*range(20)])
    '0, ..., 19 (20 values)'
    """
    words = [f"{value:g}" if is_number(value) else f"{value}" for value in values]
    if len(words) > MOST_VALUES:
        return f"{words[0]}, ..., {words[-1]} ({len(words)} values)"
    return ", ".join(words)


def _runs_in_words(dataset: Dataset, cases: int) -> str:
    """Return a sentence with the numbers of runs, seeds and engines; "" for a trade-off, which has
    no values of single runs.
    """
    if "seed" not in dataset.dims:
        return ""
    simulated = (dataset.runs + dataset.failed_runs).values
    numbers = sorted({*simulated.ravel().tolist()} - {0})
    if len(numbers) > 1:
        runs = f"{numbers[0]:,} to {numbers[-1]:,} runs"
    else:
        runs = counted(numbers[0], "run")
    if cases > 1:
        runs += " of each case"
    names = ", ".join(dataset.engine.values.tolist())
    engines = f"the engine {names}" if dataset.sizes["engine"] == 1 else f"the engines {names}"
    return f"{runs} by {engines}; seeds {brief_seed_text(dataset.seed.values)}."
