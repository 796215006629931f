"""The groups, names, dimensions, units and meanings of runs, in files and in memory; `storage` has
an overview.
"""

import numpy as np

from brownpipe import observables
from brownpipe.engines.ensemble import Ensemble, Events, Track, blank_array
from brownpipe.observables.observable import Axis
from brownpipe.observables.own import NO_OWN_ARRAYS, OwnArrays, own_coordinates
from brownpipe.scene import Scene

AXES = {
    **observables.AXES,
    "disk": Axis(
        "1", "index of the disk; 0 is the tracer", lambda scene: np.arange(scene.particles)
    ),
}
SAMPLED = ("time", "seed", "component")
LOGGED = ("seed", "event")  # event: number of the collision in its run
# For each variable: units, long_name and dimensions; without these it is one number for each run.
VARIABLES: dict[str, tuple[str, ...]] = {
    "seed": ("1", "seed of the run"),
    "position": (
        "length",
        "position of the disk's centre, inside the box; displacements are differences of unwrapped",
        *SAMPLED,
    ),
    "velocity": ("length/time", "velocity", *SAMPLED),
    "image": (
        "1",
        "periodic images crossed; unwrapped = position + image * (width, height) of the box",
        *SAMPLED,
    ),
    "unwrapped": (
        "length",
        "position of the disk's centre, as if not brought back into a periodic box; rounded to the "
        "last digit of the way from the box, which differences of position and of image are not",
        *SAMPLED,
    ),
    "box_size": ("length", "width and height of the box", "component"),
    "radius": ("length", "radius", "disk"),
    "mass": ("mass", "mass", "disk"),
    "event_time": ("time", "time of the collision; NaN behind the last one of a run", *LOGGED),
    "a": ("1", "colliding disk; NaN behind the last collision of a run", *LOGGED),
    "b": ("1", "its partner: a disk, or a wall: -1 left, -2 right, -3 bottom, -4 top", *LOGGED),
    "impulse": ("mass*length/time", "momentum transferred to disk a", *LOGGED, "component"),
    "pair_collisions": ("1", "collisions between disks"),
    "wall_collisions": ("1", "collisions of disks with walls"),
    "tracer_collisions": ("1", "collisions of the tracer with disks"),
    "energy_drift": ("1", "relative change of the kinetic energy over the run"),
    "worst_overlap": ("1", "deepest overlap of two disks, in contact distances"),
    "momentum_residual": ("1", "relative residual of the momentum balance of disks and walls"),
    "kinetic_energy": (
        "energy",
        "total kinetic energy at t = 0, conserved; NaN if not representable in these units",
    ),
    "virial": (
        "energy*time",
        "sum of abs(momentum transfer) * contact distance over the pair collisions of the run",
    ),
    "wall_impulse": (
        "mass*length/time",
        "sum of abs(momentum transfer) over the wall collisions of the run",
    ),
    "missed_collisions": (
        "1",
        "collisions missed because the pair met and separated within one time step",
    ),
    "friction_rate": ("1/time", "friction rate gamma of the tracer, dv/dt = -gamma v + noise"),
    "initial_square_speed": ("length^2/time^2", "squared speed of the tracer at t = 0"),
    "failed": (
        "1",
        "1 if beyond a bound of the health check, not finite, or stopped: exclude from averages",
    ),
    "stopped": ("1", "why the run could not go on; empty for a run that came to its end"),
}
VARIABLES |= {
    name: (array.units, array.long_name, "seed", *array.dims)
    for name, array in observables.ARRAYS.items()
}
VARIABLES |= {dim: (axis.units, axis.long_name, dim) for dim, axis in AXES.items()}
SCALES = {"seed", *AXES}  # coordinates: each along the dimension of its name
LOG = ("event_time", "a", "b", "impulse")  # the fields of Events
PLACES = {  # the variables of each group; in the root those of the runs' observables, too
    "/": {*SCALES, *Track._fields, "stopped"},
    "/disks": {"disk", "radius", "mass", *Track._fields},
    "/events": {*LOG},
}

Groups = dict[str, dict[str, np.ndarray]]  # {group: {variable: values}}, the root first


def dims_of(group: str, name: str, own: OwnArrays = NO_OWN_ARRAYS) -> tuple[str, ...]:
    """Return the dimensions of a variable in a group, `/`, `/disks` or `/events`."""
    if name in own_coordinates(own):
        return (name,)
    if name in own:
        return ("seed", *own[name].dims)
    _, _, *dims = VARIABLES[name]
    if group == "/disks" and "time" in dims:
        dims.insert(len(("time", "seed")), "disk")
    return tuple(dims) or ("seed",)


def described(name: str, own: OwnArrays = NO_OWN_ARRAYS) -> dict[str, str]:
    """Return the units and the meaning of a variable, and if it is the user's own the function that
    measured it.
    """
    if name in own:
        array = own[name]
        meaning = {"units": array.units, "long_name": array.long_name}
        if array.observable:  # a coordinate has none
            meaning["observable"] = array.observable
        return meaning
    units, long_name, *_ = VARIABLES[name]
    return {"units": units, "long_name": long_name}


def variables_by_group(scene: Scene, ensemble: Ensemble) -> Groups:
    """Return runs as the variables of each group; tracks of several whole runs, and collisions, are
    copied.
    """
    dims = {"component"}
    for name in ensemble.observables:
        dims.update(dims_of("/", name, ensemble.own))
    root = {dim: np.asarray(axis.coordinates(scene)) for dim, axis in AXES.items() if dim in dims}
    for name, array in own_coordinates(ensemble.own).items():
        root[name] = np.array(array.coordinates)
    root["time"] = ensemble.times
    root["seed"] = ensemble.seeds
    root |= _arrays_of_track(ensemble.tracer)
    root |= ensemble.observables
    if ensemble.stopped:
        reasons = [ensemble.stopped.get(seed, "") for seed in ensemble.seeds.tolist()]
        root["stopped"] = np.array(reasons)
    groups = {"/": root}
    if ensemble.whole:
        sizes = {"disk": np.arange(scene.particles), "radius": scene.radius, "mass": scene.mass}
        groups["/disks"] = sizes | _tracks_side_by_side(ensemble)
    if ensemble.events:
        groups["/events"] = _collisions_side_by_side(ensemble)
    return groups


def _arrays_of_track(track: Track | None) -> dict[str, np.ndarray]:
    """Return position, velocity and image, as far as they are recorded."""
    if track is None:
        return {}
    return {name: values for name, values in track._asdict().items() if values is not None}


def _tracks_side_by_side(ensemble: Ensemble) -> dict[str, np.ndarray]:
    """Return position, velocity and image, as far as they are recorded, of all disks of all runs
    (T, S, N, 2); without values for runs that could not go on.
    """
    seeds = ensemble.seeds.tolist()
    first = _arrays_of_track(next(iter(ensemble.whole.values())))
    if len(seeds) == 1:  # not copied
        return {name: values[:, None] for name, values in first.items()}
    tracks = [_arrays_of_track(ensemble.whole.get(seed)) for seed in seeds]
    arrays = {}
    for name, like in first.items():
        absent = blank_array(like.shape, like.dtype)
        arrays[name] = np.stack([track.get(name, absent) for track in tracks], axis=1)
    return arrays


def _collisions_side_by_side(ensemble: Ensemble) -> dict[str, np.ndarray]:
    """Return the collisions of all runs (S, E) or (S, E, 2), E those of the run that has most.

    Each run has its row, so that whoever selects a seed gets its collisions and no others. Behind
    the last one the row is NaN, which no count, mean or histogram takes for a collision; hence the
    disks are floats, too.
    """
    longest = max(len(log.time) for log in ensemble.events.values())
    rows = (len(ensemble.seeds), longest)
    shapes = {"event_time": rows, "a": rows, "b": rows, "impulse": (*rows, 2)}
    logs = {name: np.full(shape, np.nan) for name, shape in shapes.items()}
    for row, seed in enumerate(ensemble.seeds.tolist()):
        if seed not in ensemble.events:
            continue
        for name, values in zip(LOG, ensemble.events[seed], strict=True):
            logs[name][row, : len(values)] = values
    return logs


def ensemble_of(groups: Groups, average: str, own: OwnArrays = NO_OWN_ARRAYS) -> Ensemble:
    """Return the runs of variables as `variables_by_group` returns them."""
    root = groups["/"]
    seeds = root["seed"].tolist()
    reasons = root["stopped"] if "stopped" in root else [""] * len(seeds)
    stopped = {seed: str(reason) for seed, reason in zip(seeds, reasons, strict=True) if reason}
    ended = {seed: row for row, seed in enumerate(seeds) if seed not in stopped}
    whole: dict[int, Track] = {}
    if "/disks" in groups:
        disks = _track_of(groups["/disks"])
        whole = {seed: disks.select(row) for seed, row in ended.items()}
    events: dict[int, Events] = {}
    if "/events" in groups:
        events = {seed: _collisions_of_run(groups["/events"], row) for seed, row in ended.items()}
    tracer = _track_of(root) if "position" in root else None
    arrays = dict(own)
    for name, array in own_coordinates(own).items():
        arrays[name] = array._replace(coordinates=tuple(root[name].tolist()))
    others = {*PLACES["/"], *own_coordinates(own)}
    observables = {name: values for name, values in root.items() if name not in others}
    return Ensemble(
        seeds=root["seed"],
        times=root["time"],
        tracer=tracer,
        observables=observables,
        whole=whole,
        events=events,
        stopped=stopped,
        own=arrays,
        average=average,
    )


def _track_of(variables: dict[str, np.ndarray]) -> Track:
    """Return the track among the variables of a group."""
    return Track(variables["position"], variables.get("velocity"), variables.get("image"))


def _collisions_of_run(variables: dict[str, np.ndarray], row: int) -> Events:
    """Return the collisions of the run in a row of `_collisions_side_by_side`."""
    is_collision = ~np.isnan(variables["a"][row])
    time, a, b, impulse = (variables[name][row][is_collision] for name in LOG)
    return Events(time, a.astype(np.int32), b.astype(np.int32), impulse)
