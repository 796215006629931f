"""The Python interface: what the command line does, with xarray in place of files.

The same scene, seeds and engine give the same numbers, to the bit, as `brownpipe simulate` and
`brownpipe aggregate`. Arguments have the names and values of the keys of scene and study files
(config/README.md); NumPy's scalars and arrays may stand for numbers and lists. All quantities are
in the scene's reduced units. A wrong argument raises an error of `brownpipe.errors`, a ValueError
of one line that names the argument, before anything is computed.

In the examples, `bp` is brownpipe, `np` NumPy, `scene` the scene of the example of `Scene`, `runs`
are 20 runs of it, and `result` is their analysis. The files heavy.yaml and study.yaml hold the
scene and a study of it.
"""

import json
import sys
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard, Unpack

import numpy as np
from xarray import DataArray, Dataset, DataTree

from brownpipe import progress
from brownpipe.analysis import aggregate
from brownpipe.analysis.dataset import ALWAYS, refuse_unfit_estimators, refuse_windows
from brownpipe.analysis.estimator import Columns as Columns
from brownpipe.analysis.estimator import Estimator
from brownpipe.analysis.resampling import resample
from brownpipe.analysis.variables import Variable as Variable
from brownpipe.engines import DEFINITIONS, engine_of_request, read_record
from brownpipe.engines.definition import REFERENCE_NAME, Definition
from brownpipe.engines.ensemble import (
    Ensemble,
    failures,
    join_ensembles,
    select,
    stopped_in_words,
)
from brownpipe.errors import BrownpipeError, FigureError, RequestError, RunError
from brownpipe.figures.figure import Figure
from brownpipe.figures.looks import Looks
from brownpipe.figures.render import draw, draw_into
from brownpipe.figures.style import image_bytes
from brownpipe.figures.summary import SHAPE, summary_table
from brownpipe.needs import FIGURES
from brownpipe.observables.average import average_named
from brownpipe.observables.own import OwnFunction, observable_name
from brownpipe.processes import calculated
from brownpipe.provenance import source_digest
from brownpipe.scene import Box, parse_scene
from brownpipe.scene import Scene as SceneRecord
from brownpipe.scene.configuration import Configuration
from brownpipe.scene.reading import (
    AtLeastOne,
    Document,
    Integer,
    Number,
    Positive,
    SeedNumber,
    choice_of,
    did_you_mean,
    plain,
    validated,
)
from brownpipe.scene.seeds import Seeds, seed_text
from brownpipe.scene.variation import Vary, combinations, scene_with
from brownpipe.storage.configurations import read_configuration as configuration_in
from brownpipe.storage.configurations import read_scene as scene_of_file
from brownpipe.storage.configurations import read_scene_file, with_disks_of_file
from brownpipe.storage.datasets import read_contents, read_dataset, write_dataset
from brownpipe.storage.files import refuse_foreign
from brownpipe.storage.store import seeds_without_file, stored_runs
from brownpipe.storage.trajectories import Trajectories, from_tree, to_tree, write_trajectories
from brownpipe.study import read_study
from brownpipe.study.request import Request
from brownpipe.study.study import Rings, Windows
from brownpipe.study.workflow import from_command_line

if TYPE_CHECKING:
    from matplotlib import figure as matplotlib_figure
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from brownpipe.report.replay import ReplayPage

# of seeds for each core: cores then finish together even if run times differ, and progress is shown
BATCHES = 16
SETTINGS: list[str] = []  # of all engines
for _definition in DEFINITIONS.values():
    SETTINGS += _definition.settings._fields


def Scene(  # noqa: N802  # makes what its name says, like a class
    *,
    box: Mapping[str, object],
    disks: Mapping[str, object] | Sequence[Mapping[str, object]],
    duration: float,
    particles: int | None = None,
    velocities: Mapping[str, object] | None = None,
    sample_interval: float | None = None,
    samples: Mapping[str, object] | None = None,
    equilibrate: float | Mapping[str, object] | None = None,
    name: str = "scene",
) -> SceneRecord:
    """Return a scene from the keys of a scene file, as `read_scene` does from the file.

    box: {"x": (low, high), "y": (low, high), "boundary": "reflecting" or "periodic"} [length], or
    in a channel "boundary": {"x": "periodic", "y": "reflecting"}.
    disks: {"tracer": ..., "species": [...]}, a list of disks with position, velocity, radius and
    mass, {"file": "start.csv"}, or {"configuration": Configuration(...)}.
    duration, sample_interval: [time].
    samples: {"per_decade": n, "first": t}, logarithmic sample times instead of the interval.
    particles: total number of disks.
    velocities: {"temperature": kT} or {"standard_deviation": s}.
    equilibrate: {"time": t, "tracer": "free" or "pinned"}, or t alone, simulated before t = 0.
    name: of the scene in datasets and figures.

    `scene.replace(duration=5.0)` returns a scene with other values of some keys,
    `scene.replace(**{"disks.tracer.mass": 3})` one with another value below a key: a path as in
    `scan`. Scenes to be compared have names of their own: `scene.replace(duration=5.0,
    name="long")`. `scene.save("long.yaml")` writes a scene file, of which `read_scene` makes an
    equal scene.

    Raises RequestError for anything that `read_scene` refuses.

    >>> bath = {"name": "bath", "count": "rest", "radius": 0.2, "mass": 1.0}
    >>> bp.Scene(
    ...     box={"x": (0, 8), "y": (0, 8), "boundary": "periodic"},
    ...     disks={"tracer": {"radius": 0.5, "mass": 4.0}, "species": [bath]},
    ...     particles=31,
    ...     velocities={"temperature": 1.0},
    ...     duration=8.0,
    ...     sample_interval=0.2,
    ...     name="heavy",
    ... )
    <Scene heavy: 31 disks in a periodic box 8 x 8, packing fraction 0.07118, duration 8>
    """
    if isinstance(disks, Configuration):
        raise RequestError('Scene: disks: must be {"configuration": disks}, not the Configuration')
    keys = Document({key: plain(value) for key, value in locals().items() if key != "name"})
    return parse_scene(with_disks_of_file(keys, "Scene", Path()), "Scene", name=name)


def read_scene(path: str | Path, particles: int | None = None) -> SceneRecord:
    """Return the scene of a YAML file.

    path: of the scene file. The scene has the file's name without its ending.
    particles: total number of disks, the tracer among them, in place of that of the file.

    Raises RequestError for anything wrong with the file or the scene.

    >>> bp.read_scene("heavy.yaml", particles=61)
    <Scene heavy: 61 disks in a periodic box 8 x 8, packing fraction 0.1301, duration 8>
    """
    return scene_of_file(validated(Path, path, key="path"), plain(particles))


def read_configuration(
    path: str | Path,
    *,
    box: Mapping[str, object] | None = None,
    seed: int | None = None,
    time: float | None = None,
) -> Configuration:
    """Return the disks in a file: positions (N, 2) [length], velocities (N, 2) [length/time] or
    None, radii (N,) [length] and masses (N,), and names of species.

    path: CSV with the columns x, y, radius, mass (and vx, vy, species), extended XYZ, GSD, or runs
    of brownpipe that recorded all disks (.h5).
    box: as in `Scene`; a file with another one is refused.
    seed, time: of the run and the sample [time] in the file; by default its first whole run, and
    the last sample.

    Raises RequestError for a file that cannot be read, lacks a column, or has numbers that no disk
    can have.

    >>> bp.save(bp.simulate(scene, seeds=4, record="all"), "all.h5")
    >>> disks = bp.read_configuration("all.h5", seed=3)
    >>> disks.position.shape
    (31, 2)
    >>> later = {"configuration": disks, "tracer": {"mass": 30.0}}  # a tracer that is heavier now
    >>> box = {"x": (0, 8), "y": (0, 8), "boundary": "periodic"}
    >>> bp.Scene(box=box, disks=later, duration=5.0, sample_interval=0.1)
    <Scene scene: 31 disks in a periodic box 8 x 8, packing fraction 0.07118, duration 5>
    """
    known_box = None if box is None else validated(Box, plain(box), key="box")
    file = validated(Path, path, key="path")
    chosen_seed = validated(SeedNumber | None, plain(seed), key="seed")
    chosen_time = validated(Number | None, plain(time), key="time")
    return configuration_in(file, known_box, chosen_seed, chosen_time)


def simulate(
    scene: SceneRecord | str | Path,
    seeds: int | str | Collection[int] = 1,
    *,
    particles: int | None = None,
    engine: str | Definition = REFERENCE_NAME,
    record: str | Iterable[str] = "tracer",
    observables: Collection[str | OwnFunction] = (),
    average: str | Sequence[str] = "runs",
    cores: int = 1,
    quiet: bool = False,
    **settings: object,
) -> DataTree:
    """Run a scene once for every seed; return the runs.

    Runs that studies have stored in `results` of the current folder are read, and verified, instead
    of made again, if they are the same: scene and name, engine, seeds, `record`, `observables`,
    `average`, and source of brownpipe. Nothing is written there.

    scene: a scene, or the path of a scene file.
    seeds: how many (seeds 0, 1, ...), or which: "17", "0-2399", a list or an array.
    particles: number of disks instead of that of the scene file.
    engine, settings: "exact", "timestep" (time_step=...) or "langevin" (friction=...), as in
    studies; or a `brownpipe.Definition` of your own, whose runs are never those of a study.
    record: "tracer", "velocity" (of the tracer, too), "all", "events", "none", or several of them.
    observables: names or functions of your own, measured in each run.
    average: "runs", or what displacements are averaged over within each run, too: "origins",
    "disks" or ["origins", "disks"].
    cores: processes that share the seeds (on Linux); the runs are the same, to the bit.
    quiet: no progress on stderr.

    Returns a tree with `position` (time, seed, component) of the tracer [length], `velocity` if
    recorded, and the engine's report on each run (seed): `failed`, `worst_overlap`, `energy_drift`,
    numbers of collisions, ... With `record="all"`, `disks` holds position and velocity (time, seed,
    disk, component) of all disks; with `record="events"`, `events` the collisions (seed, event) of
    each run, with NaN behind its last one: `runs.events.sel(seed=17).to_dataset().dropna("event")`
    are those of one run. Displacements are differences of `unwrapped`, which in a periodic box goes
    on where `position` comes back from the other side. `box_size` (component) is width and height
    of the box [length]. Of disks that travel millions of boxes, differences of `position` and of
    `image` times `box_size`, added afterwards, keep the digits that `unwrapped` loses.

    Raises RequestError for what `brownpipe simulate` refuses, RunError if the friction of the
    langevin engine cannot be measured. Warns of runs that failed their health check or could not go
    on (`stopped` says why, their numbers are NaN), and of an engine that is rough in this scene.

    >>> runs = bp.simulate("heavy.yaml", seeds=20)
    >>> runs.position.sizes
    Frozen({'time': 41, 'seed': 20, 'component': 2})
    >>> steps = bp.simulate(scene, seeds="0-2", engine="timestep", time_step=0.01, record="all")
    >>> steps.disks.velocity.sizes
    Frozen({'time': 41, 'seed': 3, 'disk': 31, 'component': 2})
    """
    request = _request(
        scene,
        seeds,
        particles=particles,
        engine=engine,
        record=record,
        observables=observables,
        average=average,
        cores=cores,
        **settings,
    )
    for caution in request.engine.cautions(request.scene, request.observables):
        warnings.warn(caution, stacklevel=2)
    with progress.shown("simulate", silent=quiet):
        ensemble = _ensemble(request)
    failed = failures(ensemble)
    if failed:
        warnings.warn(f"{request.scene.name}: {failed}; analyse leaves them out", stacklevel=2)
    source = source_digest("simulate", request.engine.name)
    return to_tree(Trajectories(request.scene, request.engine, ensemble, source))


def analyse(
    runs: DataTree | str | Path | Sequence[DataTree | str | Path],
    *,
    fit_windows: Sequence[Sequence[float]] | None = None,
    rings: Mapping[str, object] | None = None,
    displacement_times: Sequence[float] = (),
    estimators: Sequence[Estimator] = (),
    quiet: bool = False,
) -> Dataset:
    """Return mean squared displacements, fits, distributions and their errors over runs, as
    `brownpipe aggregate`.

    runs: what `simulate` or `open` returns, the path of a trajectory file, or several of these, of
    any scenes and engines.
    fit_windows: (t0, t1) of the straight-line fits to the MSD [time]; by default two, from when the
    tracer's motion is diffusive, and from twice that time, to the end of the shortest run.
    rings: {"dr": width [length], "count": number} of the displacement distribution, by default from
    the data.
    displacement_times: its times [time], by default the end of each run.
    estimators: your own, `brownpipe.Estimator`, whose variables are added to those of brownpipe.
    quiet: no progress on stderr.

    The variables have the dimensions scene, particles, engine, and time, seed, r, ...;
    `result.msd.attrs` says what a variable means. Raises AnalysisError for runs that do not belong
    together, for times outside them, and for estimators whose names are taken or whose values do
    not fit their dimensions.

    >>> result = bp.analyse(runs, fit_windows=[(2, 8), (4, 8)])
    >>> result.diffusion_coefficient.sizes
    Frozen({'scene': 1, 'particles': 1, 'engine': 1, 'window': 2})
    >>> result.msd.attrs["units"]
    'length^2'
    """
    own_estimators = _checked_estimators(estimators)
    sources: list[Any] = [runs]  # anything else than runs is refused by `from_tree`
    if isinstance(runs, Iterable) and not isinstance(runs, str | Mapping | SceneRecord):
        sources = [*runs]
    windows = validated(Windows | None, plain(fit_windows), key="fit_windows")
    ring_keys = validated(Rings | None, plain(rings), key="rings")
    width = ring_keys.dr if ring_keys else None
    count = ring_keys.count if ring_keys else None
    times = validated(tuple[Positive, ...], plain(displacement_times), key="displacement_times")
    with progress.shown("analyse", silent=quiet):
        inputs = [
            source if isinstance(source, str | Path) else from_tree(source) for source in sources
        ]
        return aggregate(inputs, windows, width, count, times, estimators=own_estimators)


def _checked_estimators(
    estimators: Iterable[Estimator], vary: Iterable[str] = ()
) -> list[Estimator]:
    """Return a user's estimators. Raises RequestError for anything else, AnalysisError for those
    whose names are taken, also by a varied key, or whose dimensions are not known.
    """
    if isinstance(estimators, Estimator) or not isinstance(estimators, Iterable):
        raise RequestError(
            f"estimators: must be a list of brownpipe.Estimator, not {estimators!r:.60}"
        )
    checked = []
    for estimator in estimators:
        if not isinstance(estimator, Estimator):
            raise RequestError(f"estimators: must be of brownpipe.Estimator, not {estimator!r:.60}")
        checked.append(estimator)
    refuse_unfit_estimators(checked, vary)
    return checked


def scan(
    scene: SceneRecord | str | Path,
    vary: Mapping[str, Sequence[object] | Mapping[str, object]],
    seeds: int | str | Collection[int] = 1,
    particles: int | None = None,
    *,
    together: bool = False,
    fit_windows: Sequence[Sequence[float]] | None = None,
    estimators: Sequence[Estimator] = (),
    quiet: bool = False,
    **options: Any,
) -> Dataset:
    """Return the analysis of runs of a scene with all combinations of values of some of its keys.

    scene: a scene, or the path of a scene file.
    vary: values by key, such as {"disks.tracer.mass": [1, 10, 100], "packing_fraction": [0.1,
    0.3]}, or {"from": 1, "to": 100, "count": 5, "spacing": "log"} in place of a list.
    seeds: of the runs for each combination, as in `simulate`.
    particles: total number of disks, for the path of a scene file.
    together: the first values of all keys, then the second ones, ..., instead of all combinations.
    fit_windows, estimators: as in `analyse`.
    quiet: no progress on stderr.
    options: further arguments of `simulate`, for the runs of all combinations.

    Each key is a dimension: `result.diffusion_coefficient.sel(tracer_mass=10)`. Raises what
    `simulate` does.

    >>> masses = bp.scan(scene, {"disks.tracer.mass": [4, 40]}, seeds=5)
    >>> masses.msd.dims
    ('scene', 'tracer_mass', 'particles', 'engine', 'time')
    >>> masses.msd.sel(tracer_mass=40).sizes["time"]
    41
    """
    if isinstance(scene, SceneRecord):
        name = scene.name
        mapping = _checked_scene(scene, particles).given
        where = "scene"
    else:  # the file's own box may be too small for its disks, if a packing fraction is varied
        name = None
        mapping = read_scene_file(validated(Path, scene, key="scene"))
        where = str(scene)
    values = validated(Vary, plain(vary), key="vary")
    windows = validated(Windows | None, plain(fit_windows), key="fit_windows")
    own_estimators = _checked_estimators(estimators, values)
    cases = [
        scene_with(mapping, where, combination, plain(particles), name)
        for combination in combinations(values, together)
    ]
    for option, value in options.items():
        if isinstance(value, Iterator):  # read once for each case
            options[option] = [*value]
    for case in cases:
        request = _request(case, seeds, **options)
        has_squares = "square_displacement" in request.observables
        if windows and "tracer" not in request.record and not has_squares:
            raise RequestError(
                "fit_windows: must go with record='tracer', or the observable square_displacement"
            )
    refuse_windows(windows or (), [case.times for case in cases])  # not when all runs are made
    with progress.shown("scan", silent=quiet):
        runs = []
        for case in progress.tracked(cases, "scenes"):
            runs.append(from_tree(simulate(case, seeds, quiet=quiet, **options)))
        return aggregate(
            runs, windows, vary=[*values], vary_together=together, estimators=own_estimators
        )


def run(
    study: str | Path, cores: int | None = None, config: Mapping[str, object] | None = None
) -> Dataset:
    """Run a study as `brownpipe run` does, with all results in `results` of the current folder;
    return its dataset.

    study: the path of a study file.
    cores: jobs at the same time, by default as many as there are cores.
    config: values of keys in place of those of the study file, such as {"seeds": 100}; they have
    results of their own.

    What is there is not made again. Raises RequestError for a mistake in the study, RunError if a
    job fails, or if Snakemake is not installed: `pip install 'brownpipe[study]'`.

    >>> result = bp.run("study.yaml", cores=2)
    >>> result.scene.values.tolist(), result.sizes["seed"]
    (['heavy'], 20)
    """
    path = validated(Path, study, key="study")
    values = validated(dict, plain(config or {}), key="config")
    for key, value in values.items():
        if repr(from_command_line(value)) != repr(value):
            raise RequestError(
                f"config: {key}: must not have a text for a number, true, false or null: {value!r}"
            )
    name = read_study(path, values).name
    command = [sys.executable, "-P", "-m", "brownpipe", "run", str(path)]
    if cores is not None:
        command += ["-j", str(validated(AtLeastOne, plain(cores), key="cores"))]
    if values:
        command.append("--config")
    for key, value in values.items():
        command.append(f"{key}={json.dumps(value, default=str)}")
    status, reason = progress.relayed(command)
    if status:
        unexplained = f"{path}: ended with exit status {status}; the messages above say more"
        raise RunError(" ".join(reason.split()) or unexplained)
    return read_dataset(f"results/{name}/aggregate/{name}.nc")


def mean(array: DataArray) -> Dataset:
    """Return the mean of an array of your own over runs, its dimension `seed`, with errors.

    array: (seed, ...), a number or an array of each run, in any unit.

    The Dataset has `value`, `standard_error` and the 95 % interval, `low` to `high`, with
    coordinates and attributes of the array, as `analyse` estimates them: by a bootstrap over runs,
    not over time points (docs/theory.md, section 5). Failed runs are left out if the array has the
    coordinate `failed`, as every array calculated from the tracer has. Where a run has no number,
    NaN, there is no mean, as in `analyse`: leave such runs out yourself, by
    `array.dropna("seed")`, if that is what you want to know the mean of.

    Raises RequestError for an array without runs, or with a seed twice.

    >>> square = ((runs.unwrapped - runs.unwrapped.isel(time=0)) ** 2).sum("component")
    >>> msd = bp.mean(square)
    >>> msd.value.dims
    ('time',)
    >>> bool(np.isclose(msd.value.sel(time=8), result.msd.sel(time=8)).all())
    True
    """
    if not isinstance(array, DataArray) or "seed" not in array.dims or not array.size:
        raise RequestError("array: must be an array with the dimension seed")
    ordered = array.transpose("seed", ...).sortby("seed")
    seeds = ordered.seed.values
    if seeds.dtype.kind not in "iu" or (np.diff(seeds) == 0).any():
        raise RequestError(
            "array: must have every seed once; take the mean of each scene and engine by itself"
        )
    values = ordered.values.astype(float)
    is_sound = np.equal(ordered.coords.get("failed", 0), 0)
    is_kept = np.broadcast_to(is_sound, len(seeds))
    estimates = resample(values[is_kept], seeds[is_kept])
    template = ordered.isel(seed=0, drop=True)
    variables = {}
    for name, estimate in zip(("value", "standard_error", "low", "high"), estimates, strict=True):
        variables[name] = template.copy(data=estimate)
    return Dataset(variables)


def path(runs: DataTree, seed: int | None = None, disk: int = 0) -> Dataset:
    """Return the exact path of a disk in a run that has its collisions: the disk moves straight
    between them.

    runs: what `simulate` or `open` returns, with `record="velocity,events"` for the path of the
    tracer, with `record="all,events"` for those of all disks.
    seed: of the run, by default the smallest.
    disk: 0 is the tracer.

    Returns `time` (event) [time], and `position` [length] and `velocity` [length/time] (event,
    component) of the disk at t = 0, at each of its collisions, and at the end of the run. Positions
    are those of `unwrapped`, which go on where a periodic box ends; velocities those just after the
    collision. They are exact to round-off: between two of these times positions are interpolated
    linearly. The attributes `scene`, `seed` and `disk` say which path it is.

    Raises RequestError for runs without collisions, or without the velocity of this disk at t = 0,
    and for a seed or a disk that they do not have.

    >>> with_events = bp.simulate(scene, seeds=20, record="velocity,events", quiet=True)
    >>> path = bp.path(with_events, seed=17)
    >>> path.position.dims, path.attrs
    (('event', 'component'), {'scene': 'heavy', 'seed': 17, 'disk': 0})
    >>> x = np.interp(runs.time, path.time, path.position.sel(component="x"))
    >>> bool(np.allclose(x, runs.unwrapped.sel(seed=17, component="x"), rtol=0, atol=1e-12))
    True
    """
    trajectories = from_tree(runs)
    number = validated(Integer, plain(disk), key="disk")
    chosen_seed = _seed_of_path(trajectories, validated(SeedNumber | None, plain(seed), key="seed"))
    scene = trajectories.scene
    if not 0 <= number < scene.particles:
        raise RequestError(f"disk: must be from 0 to {scene.particles - 1}, not {number}")
    ensemble = trajectories.ensemble
    is_known = bool(ensemble.whole) or (number == 0 and "velocity" in trajectories.record)
    if not is_known:
        needed = "all,events" if number else "velocity,events"
        raise RequestError(
            f"runs: hold no velocity of disk {number} at t = 0; record it: "
            f"brownpipe.simulate(..., record={needed!r})"
        )
    points = ensemble.run_of(chosen_seed).path(scene, number)
    meanings = {
        "time": ("time", "times of the start, of the disk's collisions, and of the end"),
        "position": ("length", "position of the disk's centre, not brought back into the box"),
        "velocity": ("length/time", "velocity, just after the collision"),
    }
    variables = {}
    for name, values in points._asdict().items():
        units, long_name = meanings[name]
        dims = ("event", "component")[: values.ndim]
        variables[name] = (dims, values, {"units": units, "long_name": long_name})
    attributes = {"scene": scene.name, "seed": chosen_seed, "disk": number}
    path_of_disk = Dataset(variables, {"component": ["x", "y"]}, attributes)
    return path_of_disk.set_coords("time")


def _seed_of_path(trajectories: Trajectories, seed: int | None) -> int:
    """Return the seed of a run with collisions, by default the smallest. Raises RequestError as
    `path` does.
    """
    scene = trajectories.scene
    ensemble = trajectories.ensemble
    if not scene.particles:
        raise RequestError("runs: hold no disks")
    stopped = f"; {stopped_in_words(ensemble.stopped)}" if ensemble.stopped else ""
    if not ensemble.events:
        trajectories.engine.refuse_unfit(scene, frozenset({"events"}))
        raise RequestError(
            "runs: hold no collisions; record them: "
            f"brownpipe.simulate(..., record='velocity,events'){stopped}"
        )
    if seed is None:
        return min(ensemble.events)
    if seed not in ensemble.events:
        seeds = seed_text(sorted(ensemble.events))
        raise RequestError(f"seed: must be of {seeds}, not {seed}{stopped}")
    return seed


def table(result: Dataset) -> "DataFrame":
    """Return the results of an analysis as a pandas table, with a row for each scene, number of
    disks and engine; between walls of unequal lengths with a row for each axis. There, and in
    channels, MSD, non-Gaussian parameter and D are those along the axis in `component`.

    result: what `analyse`, `scan` or `run` returns.

    Its columns are what was measured, each beside its standard error; fits are those in the first
    window. `mark`: what speaks against its D, such as `early` or `walls`; empty if nothing does.
    `drifts`: whether the runs are found not to be in equilibrium. `attrs` has their units. Raises
    RequestError for anything else than an analysis.

    >>> frame = bp.table(result)
    >>> frame[["scene", "particles", "engine", "runs"]]
       scene  particles engine  runs
    0  heavy         31  exact    20
    >>> frame.attrs["diffusion_coefficient"]
    'length^2/time'
    """
    _refuse_incomplete_analysis(result, RequestError)
    frame = summary_table(result.isel(window=[0]))
    empty = frame.columns[frame.isna().all()]
    frame = frame[[name for name in frame if name.removesuffix("_standard_error") not in empty]]
    left_out = (*SHAPE, "failed_runs", "duration", "slope", "slope_standard_error")
    wanted = {"drifts", "mark", *result.variables} - {*left_out}
    shown = frame[[name for name in frame if name in wanted]]
    units = {}
    for name, variable in result.variables.items():
        if name in shown and "units" in variable.attrs:
            units[name] = variable.attrs["units"]
    shown.attrs = units
    return shown


def plot(
    result: Dataset,
    figure: str | Figure = "msd",
    *,
    particles: int | None = None,
    panel: str | Iterable[str] = (),
    ax: "Axes | None" = None,
    **looks: Unpack[Looks],
) -> "matplotlib_figure.Figure | Axes":
    """Return a figure of an analysis, as `brownpipe figures` draws it.

    result: what `analyse`, `scan` or `run` returns.
    figure: msd, displacement_distribution, diffusion, first_passage, velocity_autocorrelation,
    velocity_distribution, pair_distribution, density_profile, orientational_order, energy,
    own_observables, thermodynamics, scan or health, or of a dataset of `brownpipe tradeoff`
    tradeoff; or one of your own, a `bp.Figure`.
    particles: show the runs with this many disks; by default each scene's largest number.
    panel: dimensions, such as scene or tracer_mass: cases that differ in them are drawn in panels
    of their own.
    ax, looks: draw the main panel into these axes of yours, in your style, and return them; looks
    are those of the lines, such as color="red", label="my runs".

    Settings in matplotlib.rcParams that you have changed hold, such as font.size and
    figure.figsize, the size of the whole figure [inch]. Notebooks show a figure by themselves.
    Raises FigureError if the dataset has no data for it.

    >>> figure = bp.plot(result, "msd")
    >>> figure.savefig("msd.png")
    >>> figure.axes[0].get_title("left")
    'heavy, N = 31'
    """
    if not isinstance(figure, Figure):
        validated(choice_of(FIGURES), figure, key="figure")
    _refuse_incomplete_analysis(result, FigureError)
    if ax is not None and not _is_axes(ax):
        raise FigureError(f"ax: must be the axes of one panel, not {type(ax).__name__}")
    if looks and ax is None:
        raise FigureError(f"{next(iter(looks))}: must be given with ax, the axes to draw into")
    if panel and ax is not None:
        raise FigureError("panel: must not be given with ax, the axes of one panel")
    try:
        if ax is not None:
            return draw_into(ax, result, figure, plain(particles), **looks)
        panels = _comma_separated("panel", panel).split(",") if panel else ()
        drawn = draw(result, figure, plain(particles), panels)
    except (AttributeError, FigureError, KeyError, StopIteration) as error:
        lacking = sorted(ALWAYS - result.variables.keys())
        if lacking:
            why = f"{error}; " if isinstance(error, FigureError) else ""
            names = ", ".join(lacking)
            raise FigureError(f"{why}result: lacks {names}; plot what analyse returns") from error
        raise
    # by which notebooks show an object
    drawn._repr_png_ = partial(_png, drawn)  # type: ignore[attr-defined]
    return drawn


def _is_axes(ax: object) -> bool:
    from matplotlib.axes import Axes  # takes 0.3 s

    return isinstance(ax, Axes)


def _png(figure: "matplotlib_figure.Figure") -> bytes:
    """Return the picture of a figure, whose layout still follows its size afterwards."""
    layout = figure.get_layout_engine()
    picture = image_bytes(figure, "png")
    figure.set_layout_engine(layout)
    return picture


def replay(runs: DataTree, seed: int | None = None) -> "ReplayPage":
    """Return a page that replays a run from collision to collision, which notebooks show by
    themselves.

    runs: what `simulate` or `open` returns, with `record="all,events"`.
    seed: of the run; by default the smallest.

    `contents` of the result are the bytes of the page, an HTML file that needs no other, as
    `brownpipe movie RUNS.h5 --output RUN.html` writes it. It ends after 5,000 collisions.

    Raises RequestError for runs without all disks and their collisions, and for another seed.

    >>> recorded = bp.simulate(scene, seeds=[17], record="all,events", quiet=True)
    >>> bp.replay(recorded, seed=17).extent
    '109 collisions'
    """
    from brownpipe.report.replay import replay_page  # imports Pillow

    chosen_seed = validated(SeedNumber | None, plain(seed), key="seed")
    return replay_page(from_tree(runs), "runs", chosen_seed)


def open(path: str | Path) -> DataTree | Dataset:  # as in xarray, of which it returns an object
    """Return the runs of a trajectory file, as `simulate` does, or the dataset of an analysis,
    verified byte by byte.

    path: of the file, .h5 of runs or .nc of an analysis.

    Raises StorageError, which says how to make a damaged file again, and WrongFileError for any
    other file.

    >>> bp.save(runs, "heavy.h5")
    >>> bp.open("heavy.h5").identical(runs)
    True
    """
    contents = read_contents(validated(Path, path, key="path"))
    return to_tree(contents) if isinstance(contents, Trajectories) else contents


def save(data: DataTree | Dataset, path: str | Path) -> None:
    """Write runs to a trajectory file, or an analysis to a dataset, as the command line does.

    data: runs, as `simulate` returns them, or the analysis of `analyse`, `scan` or `run`.
    path: of the file, which ends in .h5 or .hdf5 for runs, in .nc for an analysis. A file of
    brownpipe that is there is replaced.

    Raises RequestError for anything else, for variables that you have added to runs, and for a file
    that is there and not of brownpipe; StorageError and OSError if the file cannot be written.

    >>> bp.save(result, "heavy.nc")
    >>> bp.open("heavy.nc").identical(result)
    True
    """
    path = validated(Path, path, key="path")
    if isinstance(data, SceneRecord):
        raise RequestError(f"data: is a scene; scene.save({str(path)!r}) writes it to a scene file")
    if not (isinstance(data, DataTree) or _is_analysis(data)):
        raise RequestError("data: must be what simulate, analyse or open returns")
    suffixes = (".h5", ".hdf5") if isinstance(data, DataTree) else (".nc",)
    if Path(path).suffix not in suffixes:
        raise RequestError(f"path: {path}: must end in {' or '.join(suffixes)}")
    refuse_foreign(path)
    if isinstance(data, DataTree):
        with progress.shown("save"):
            write_trajectories(path, *from_tree(data, strict=True))
        return
    _refuse_joined_analysis("data", data, RequestError)
    try:
        write_dataset(path, data)
    # of xarray, for contents that no file can have
    except (NotImplementedError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise RequestError(f"data: cannot be written: {reason}") from error


# -- runs ------------------------------------------------------------------------------------------


def _request(
    scene: SceneRecord | str | Path,
    seeds: int | str | Collection[int],
    *,
    particles: int | None = None,
    engine: str | Definition = REFERENCE_NAME,
    record: str | Iterable[str] = "tracer",
    observables: Collection[str | OwnFunction] = (),
    average: str | Sequence[str] = "runs",
    cores: int = 1,
    **settings: object,
) -> Request:
    """Return the request in arguments of `simulate`; refuse wrong ones, and runs that cannot be
    made. Defaults are those of `simulate`.
    """
    settings_known = engine.settings._fields if isinstance(engine, Definition) else SETTINGS
    arguments = [*Request._fields, "particles", "quiet", *settings_known]
    scene_record = _checked_scene(scene, particles)
    for name in settings.keys() - {*settings_known}:
        hint = did_you_mean(name, arguments).strip()
        raise RequestError(f"{name}: unknown; {hint or 'see help(brownpipe.simulate)'}")
    values = {key: plain(value) for key, value in settings.items()}
    chosen = engine_of_request(engine, values, str)
    recorded = read_record(_comma_separated("record", record), "record")
    names = tuple(filter(None, _comma_separated("observables", observables).split(",")))
    if isinstance(seeds, range) and seeds and seeds.step == 1 and seeds[0] >= 0:
        seeds = f"{seeds[0]}-{seeds[-1]}"  # never expanded, as it may be long
    numbers = validated(Seeds, plain(seeds), key="seeds")
    processes = validated(AtLeastOne, plain(cores), key="cores")
    over = average_named(validated(str | list[str], plain(average), key="average"))
    request = Request(scene_record, numbers, chosen, recorded, names, over, processes)
    request.forecast()
    return request


def _ensemble(request: Request) -> Ensemble:
    """Return the runs of a request: those that studies have stored are read, others made."""
    seeds = np.asarray(request.seeds)
    stored = stored_runs(request.scene, request.engine, request.digest, seeds)
    missing = seeds_without_file(seeds, [(batch.seeds[0], batch.seeds[-1]) for batch in stored])
    ensemble = join_ensembles([*stored, *_simulate_in_batches(request, missing)])
    return select(ensemble, np.isin(ensemble.seeds, seeds))


def _simulate_in_batches(request: Request, seeds: np.ndarray) -> list[Ensemble]:
    """Return runs of some seeds of a request, made on its cores in batches."""
    if not len(seeds):
        return []
    if min(request.cores, len(seeds)) < 2:
        return [request.make(seeds.tolist())]
    request.make([])  # compiles, once for all processes
    batches = np.array_split(seeds, min(len(seeds), BATCHES * request.cores))
    return calculated(lambda batch: request.make(batch.tolist()), batches, "batches", request.cores)


# -- arguments -------------------------------------------------------------------------------------


def _checked_scene(scene: SceneRecord | str | Path, particles: int | None) -> SceneRecord:
    """Return a scene, or that of a file, with `particles` disks if that is given."""
    if not isinstance(scene, SceneRecord):
        return scene_of_file(validated(Path, scene, key="scene"), plain(particles))
    if particles is not None:
        raise RequestError(
            "particles: must not be given with a scene, which has its number of disks"
        )
    return scene


def _comma_separated(key: str, value: object) -> str:
    """Return names as one text with commas: ["tracer", "events"] as "tracer,events"."""
    if not isinstance(value, Iterable):
        raise RequestError(f"{key}: must be a name or a list of names, not {value!r}")
    names = value.split(",") if isinstance(value, str) else value
    return ",".join(map(observable_name, names))


def _refuse_incomplete_analysis(result: object, kind: type[BrownpipeError]) -> None:
    """Raise an error of this kind unless the result is an analysis with the dimensions of its
    cases.
    """
    if not _is_analysis(result):
        raise kind("result: must be a dataset of brownpipe.analyse; analyse(runs) makes one")
    dimensions = ["scene", "particles", "engine"]
    if "window" in result.coords:
        dimensions.append("window")
    for dim in dimensions:
        if not result.sizes.get(dim):
            raise kind(
                f"result: has no dimension {dim}, or nothing along it; take it before squeeze or "
                "sel"
            )
    _refuse_joined_analysis("result", result, kind)


def _refuse_joined_analysis(key: str, result: Dataset, kind: type[BrownpipeError]) -> None:
    """Raise an error of this kind for analyses that xarray has joined although their cases differ
    in fit windows or variables.

    It fills the gaps by NaN, which no set of bits has: marks become numbers with a fraction.
    """
    for name in ("diffusion_mark", "component_diffusion_mark"):
        if name in result and result[name].dtype.kind == "f":
            raise kind(
                f"{key}: joins analyses of different fit windows or variables; analyse their runs "
                "together, as in analyse([runs, others])"
            )


def _is_analysis(data: object) -> TypeGuard[Dataset]:
    return isinstance(data, Dataset) and "failed_runs" in data
