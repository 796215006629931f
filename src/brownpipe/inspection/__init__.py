"""What is in a trajectory file or dataset, and whether the runs of a file come out again: `brownpipe inspect`.

The reports show numbers as figures and summary do, and runs are made by the engines: this layer is above both. It is
not part of `figures` or `storage`, because a change of a report must not run any step of a study again.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from brownpipe.engines.ensemble import joined
from brownpipe.errors import RequestError, WrongFileError
from brownpipe.inspection import results, runs
from brownpipe.provenance import made_with
from brownpipe.quoting import in_lines, shell_path
from brownpipe.scene import scene_yaml
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.storage.datasets import dataset_in
from brownpipe.storage.files import naming, read_sealed
from brownpipe.storage.trajectories import Trajectories, trajectories_in
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from xarray import Dataset

OF_TRAJECTORIES, OF_DATASETS = "trajectory files (of `brownpipe simulate`)", "datasets (of `brownpipe aggregate`)"


def report(path: str | Path, seed: int | None = None) -> str:
    """Return what a trajectory file or dataset contains, as lines of text; of a `seed`, all about its run.

    Raises StorageError if the file is damaged, WrongFileError if it is of neither kind, FigureError for a dataset that
    is not as it was made, RequestError, which names the seeds of the file, if this one is not among them.
    """
    contents = read_contents(path) if seed is None else trajectories_of(path, "--seed", seed)
    again = f"run again    brownpipe inspect {shell_path(path)} --reproduce"
    if isinstance(contents, Trajectories):
        lines, table = [*runs.lines(contents), again], runs.table(contents.ensemble)
        made, now = contents.header, made_with("simulate", contents.engine.name)
    else:
        lines, table = results.lines(contents), results.table(contents)
        made, now = contents.attrs, made_with("tradeoff" if is_tradeoff(contents) else "aggregate")
    versions = [f"{name.removesuffix('_version')} {made[name]}" for name in made if name.endswith("_version")]
    source = made.get("source_digest", "unknown")
    whose = "that of this installation" if source == now["source_digest"] else "not that of this installation"
    lines += [
        f"written by   {', '.join(versions) or 'unknown'}",
        f"source       {source[: results.DIGITS]}, {whose}",
        "intact       yes: every byte as it was written",
    ]
    return in_lines([f"{path}  {Path(path).stat().st_size / 1e6:.2f} MB", *lines, "", *table])


def variables(path: str | Path) -> str:
    """Return a table of all variables of a dataset: dimensions, units and meaning. Errors as of `report`."""
    contents = read_contents(path)
    if isinstance(contents, Trajectories):
        raise WrongFileError(f"{path}: is a trajectory file; --variables works on {OF_DATASETS}")
    return in_lines(results.variables(contents))


def scene_text(path: str | Path) -> str:
    """Return the scene of a trajectory file as the text of a scene file (YAML). Errors as of `report`."""
    scene = trajectories_of(path, "--scene").scene
    return f"# Scene {scene.name} of a trajectory file, with all defaults. Digest: {scene.digest}\n{scene_yaml(scene)}"


def trajectories_of(path: str | Path, option: str, seed: int | None = None) -> Trajectories:
    """Return the contents of a trajectory file, or the run of one seed, for an `option` that works on no other file.

    Errors as of `report`.
    """
    contents = read_contents(path)
    if not isinstance(contents, Trajectories):
        raise WrongFileError(f"{path}: is a dataset; {option} works on {OF_TRAJECTORIES}")
    if seed is None:
        return contents
    ensemble = contents.ensemble
    if seed not in ensemble.seeds:
        raise RequestError(f"{path}: --seed {seed}: is not in the file; must be of {brief_seed_text(ensemble.seeds)}")
    return contents._replace(ensemble=joined([ensemble], [seed]))


def read_contents(path: str | Path) -> "Trajectories | Dataset":
    """Return the contents of a file of either kind; the file is read once."""
    with naming(path, "aggregate" if Path(path).suffix == ".nc" else "simulate"):
        image = read_sealed(path)
        try:
            return trajectories_in(image)
        except WrongFileError:
            return dataset_in(image)
