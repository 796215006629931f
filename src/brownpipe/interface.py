"""The Python interface: what the command line does, with xarray in place of files.

The same scene, seeds and engine give the same numbers, to the bit, as `brownpipe simulate` and `brownpipe aggregate`.
Arguments have the names and values of the keys of scene and study files (config/README.md); NumPy's scalars and arrays
may stand for numbers and lists. All quantities are in the scene's reduced units. A wrong argument raises an error of
`brownpipe.errors`, a ValueError of one line that names the argument, before anything is computed.
"""

import reprlib
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from xarray import Dataset, DataTree

from brownpipe import progress
from brownpipe.analysis import aggregate
from brownpipe.analysis.dataset import refuse_taken
from brownpipe.engines import read_record, requested
from brownpipe.engines.ensemble import failures
from brownpipe.engines.saturation import growth_caution
from brownpipe.errors import FigureError, RequestError
from brownpipe.figures.catalogue import FIGURES
from brownpipe.figures.render import draw
from brownpipe.figures.style import image_bytes
from brownpipe.inspection import read_contents
from brownpipe.observables.own import named
from brownpipe.provenance import modules_of, source_digest
from brownpipe.scene import Scene as SceneRecord
from brownpipe.scene import parse_scene
from brownpipe.scene import read_scene as scene_of_file
from brownpipe.scene.reading import NotNegative, Positive, plain, validated
from brownpipe.scene.seeds import read_seeds
from brownpipe.scene.variation import Vary, combinations, scene_with
from brownpipe.storage.datasets import write_dataset
from brownpipe.storage.trajectories import Trajectories, from_tree, refuse_foreign, to_tree, write_trajectories
from brownpipe.study import forecast_of_runs
from brownpipe.study.study import Rings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Scene", "analyse", "open", "plot", "read_scene", "save", "scan", "simulate"]


def Scene(  # noqa: N802  # makes what its name says, like a class
    *,
    box: Mapping,
    disks: Mapping | Sequence,
    duration: float,
    particles: int | None = None,
    velocities: Mapping | None = None,
    sample_interval: float | None = None,
    samples: Mapping | None = None,
    equilibrate: Mapping | None = None,
    name: str = "scene",
) -> SceneRecord:
    """Return a scene from the keys of a scene file, as `read_scene` does from the file.

    box: {"x": (low, high), "y": (low, high), "boundary": "reflecting" or "periodic"} [length].
    disks: {"tracer": ..., "species": [...]}, or a list of disks with position, velocity, radius and mass.
    duration, sample_interval: [time].
    samples: {"per_decade": n, "first": t}, logarithmic sample times instead of the interval.
    particles: total number of disks.
    velocities: {"temperature": kT} or {"standard_deviation": s}.
    equilibrate: {"time": t, "tracer": "free" or "pinned"}, simulated before t = 0.
    name: of the scene in datasets and figures.

    `scene.replace(duration=5.0)` returns a scene with another value of a key; `box`, `velocities`, ... have it, too.

    Raises RequestError for anything that `read_scene` refuses.
    """
    keys = {key: plain(value) for key, value in locals().items() if key != "name"}
    return parse_scene(keys, "Scene", name=name)


def read_scene(path: str | Path, particles: int | None = None) -> SceneRecord:
    """Return the scene of a YAML file, with `particles` disks in total if that is given.

    Raises RequestError for anything wrong with the file or the scene.
    """
    return scene_of_file(validated(Path, path, key="path"), plain(particles))


def simulate(
    scene: SceneRecord | str | Path,
    seeds: int | str | Collection[int] = 1,
    *,
    particles: int | None = None,
    engine: str = "exact",
    record: str | Iterable[str] = "tracer",
    observables: Collection[str | Callable] = (),
    average: str = "runs",
    quiet: bool = False,
    **settings: object,
) -> DataTree:
    """Run a scene once for every seed; return the runs.

    scene: a scene, or the path of a scene file.
    seeds: how many (seeds 0, 1, ...), or which: "17", "0-2399", a list or an array.
    particles: number of disks instead of that of the scene file.
    engine, settings: "exact", "timestep" (time_step=...) or "langevin" (friction=...), as in studies.
    record: "tracer", "all", "events", "none", or several of them.
    observables, average: measured in each run, by names or functions of your own, and over what displacements are
    averaged within it.
    quiet: no progress on stderr.

    Returns a tree with `position` (time, seed, component) of the tracer [length] and the engine's report on each run
    (seed): `failed`, `worst_overlap`, `energy_drift`, numbers of collisions, ... With `record="all"`, `disks` holds
    position and velocity (time, seed, disk, component) of all disks; with `record="events"`, `events` the
    collisions (event) of all runs. Unwrapped positions in a periodic box are position + image * (width, height).

    Raises RequestError for what `brownpipe simulate` refuses, RunError if the friction of the langevin engine cannot be
    measured. Warns of runs that failed their health check or could not go on (`stopped` says why, their numbers are
    NaN), and of an engine that is rough in this scene.
    """
    if not isinstance(scene, SceneRecord | str | Path):
        raise RequestError(f"scene: must be a scene or the path of a scene file, not {reprlib.repr(scene)}")
    if not isinstance(scene, SceneRecord):
        scene = read_scene(scene, particles)
    elif particles is not None:
        raise RequestError("particles: must not be given with a scene, which has its number of disks")
    chosen = requested(engine, {key: plain(value) for key, value in settings.items()}, str)
    recorded = read_record(_words("record", record), "record")
    given = observables.split(",") if isinstance(observables, str) else observables
    names = tuple(filter(None, map(named, given)))
    if isinstance(seeds, range) and seeds and seeds.step == 1 and seeds[0] >= 0:
        seeds = f"{seeds[0]}-{seeds[-1]}"  # which may be many
    numbers = read_seeds(plain(seeds))
    forecast_of_runs(chosen, scene, numbers, recorded, names, average)
    for remark in filter(None, (chosen.definition.caution(scene), growth_caution(scene, len(numbers)))):
        warnings.warn(remark, stacklevel=2)
    with progress.shown("simulate", silent=quiet):
        ensemble = chosen.simulate(scene, numbers, recorded, observables=names, average=average)
    refuse_taken(ensemble.own)
    if failed := failures(ensemble):
        warnings.warn(f"{scene.name}: {failed}; analyse leaves them out", stacklevel=2)
    return to_tree(Trajectories(scene, chosen, ensemble, source_digest(*modules_of("simulate", chosen.name))))


def analyse(
    runs: DataTree | str | Path | Sequence[DataTree | str | Path],
    *,
    fit_windows: Sequence[Sequence[float]] | None = None,
    rings: Mapping | None = None,
    displacement_times: Sequence[float] = (),
    quiet: bool = False,
) -> Dataset:
    """Return mean squared displacements, fits, distributions and their errors over runs, as `brownpipe aggregate`.

    runs: what `simulate` or `open` returns, the path of a trajectory file, or several of these, of any scenes and
    engines.
    fit_windows: (t0, t1) of the straight-line fits to the MSD [time]; by default from a tenth and from half of the
    shortest run to its end.
    rings: {"dr": width [length], "count": number} of the displacement distribution, by default from the data.
    displacement_times: its times [time], by default the end of each run.
    quiet: no progress on stderr.

    The variables have the dimensions scene, particles, engine, and time, seed, ring, ...; `result.msd.attrs` says what
    a variable means. Raises AnalysisError for runs that do not belong together, or for times outside them.
    """
    several = list(runs) if isinstance(runs, Iterable) and not isinstance(runs, str | Mapping | SceneRecord) else [runs]
    windows = _windows(fit_windows)
    given = validated(Rings | None, plain(rings), key="rings")
    width, count = (given.dr, given.count) if given else (None, None)
    times = validated(tuple[Positive, ...], plain(displacement_times), key="displacement_times")
    with progress.shown("analyse", silent=quiet):
        sources = [each if isinstance(each, str | Path) else from_tree(each) for each in several]
        return aggregate(sources, windows, width, count, times)


def scan(
    scene: SceneRecord | str | Path,
    vary: Mapping[str, Sequence | Mapping],
    seeds: int | str | Collection[int] = 1,
    *,
    together: bool = False,
    fit_windows: Sequence[Sequence[float]] | None = None,
    quiet: bool = False,
    **options: Any,
) -> Dataset:
    """Return the analysis of runs of a scene with all combinations of values of some of its keys.

    vary: values by key, such as {"disks.tracer.mass": [1, 10, 100], "packing_fraction": [0.1, 0.3]}, or
    {"from": 1, "to": 100, "count": 5, "spacing": "log"} in place of a list.
    together: the first values of all keys, then the second ones, ..., instead of all combinations.
    fit_windows: as of `analyse`. options: as of `simulate`, with the same seeds for all values.

    Each key is a dimension: `result.diffusion_coefficient.sel(tracer_mass=10)`. Raises what `simulate` does.
    """
    base = scene if isinstance(scene, SceneRecord) else read_scene(scene)
    values = validated(Vary, plain(vary), key="vary")
    keys = base.model_dump(exclude_unset=True)
    scenes = [scene_with(keys, "scene", one, name=base.name) for one in combinations(values, together)]
    runs = [from_tree(simulate(one, seeds, quiet=quiet, **options)) for one in scenes]
    return aggregate(runs, _windows(fit_windows), vary=[*values], vary_together=together)


def plot(result: Dataset, figure: str = "msd", *, particles: int | None = None) -> "Figure":
    """Return a figure of an analysis, as `brownpipe figures` draws it.

    figure: msd, displacement_distribution, diffusion, velocity_autocorrelation, velocity_distribution,
    pair_distribution, energy, own_observables, thermodynamics, scan or health.
    particles: show the runs with this many disks; by default each scene's largest number.

    Notebooks show it by themselves. Raises FigureError if the dataset has no data for it.
    """
    validated(Literal[tuple(FIGURES)], figure, key="figure")
    if not _is_analysis(result):
        raise FigureError("result: must be a dataset of brownpipe.analyse; analyse(runs) makes one")
    for dim in ("scene", "particles", "engine", "window"):
        if dim not in result.dims and (dim in result.coords or dim != "window"):
            raise FigureError(f"result: has no dimension {dim}; plot it before squeeze or sel, which remove it")
        if result.sizes.get(dim) == 0:
            raise FigureError(f"result: the dimension {dim} is empty; there is nothing to plot")
    drawn = draw(result, figure, plain(particles))
    drawn._repr_png_ = partial(image_bytes, drawn, "png")  # type: ignore[attr-defined]  # by which notebooks show an object
    return drawn


def open(path: str | Path) -> DataTree | Dataset:  # as in xarray, of which it returns an object
    """Return the runs of a trajectory file, as `simulate` does, or the dataset of an analysis, verified byte by byte.

    Raises StorageError, which says how to make a damaged file again, and WrongFileError for any other file.
    """
    contents = read_contents(validated(Path, path, key="path"))
    return to_tree(contents) if isinstance(contents, Trajectories) else contents


def save(data: DataTree | Dataset, path: str | Path) -> None:
    """Write runs to a trajectory file, or an analysis to a dataset, as the command line does.

    Raises RequestError for anything else and for variables that you have added to runs; StorageError and OSError if
    the file cannot be written.
    """
    path = validated(Path, path, key="path")
    if isinstance(data, DataTree):
        _refuse_suffix(path, "runs", (".h5", ".hdf5"))
        with progress.shown("save"):
            trajectories = from_tree(data)
            refuse_foreign(data)
            write_trajectories(path, *trajectories[:4])
    elif _is_analysis(data):
        _refuse_suffix(path, "datasets", (".nc",))
        write_dataset(path, data)
    else:
        raise RequestError("data: must be what simulate, analyse or open returns")


# -- arguments ------------------------------------------------------------------------------------------------------


def _words(name: str, value: Any) -> str:
    """Return names as one text with commas."""
    if not isinstance(value, Iterable):
        raise RequestError(f"{name}: must be a name or a list of names, not {value!r}")
    return ",".join(str(word).strip() for word in (value.split(",") if isinstance(value, str) else value))


def _windows(value: Any) -> tuple[tuple[float, float], ...] | None:
    """Return fit windows, None for those by default."""
    windows = validated(tuple[tuple[NotNegative, NotNegative], ...] | None, plain(value), key="fit_windows")
    for window in windows or ():
        if not window[0] < window[1]:
            raise RequestError(f"fit_windows: must be two times [t0, t1] with t0 < t1, not {list(window)}")
    return windows


def _refuse_suffix(path: str | Path, what: str, suffixes: tuple[str, ...]) -> None:
    if Path(path).suffix not in suffixes:
        raise RequestError(f"path: {path}: files of {what} must end in {' or '.join(suffixes)}")


def _is_analysis(data: object) -> bool:
    return isinstance(data, Dataset) and "failed_runs" in data
