"""The groups, names, dimensions, units and meanings of runs, in files and in memory; they are drawn in `storage`."""

import numpy as np

from brownpipe.engines.ensemble import Ensemble, Events, Track, blank
from brownpipe.observables import ARRAYS, AXES
from brownpipe.observables.own import NO_OWN, Own
from brownpipe.scene import Scene

MEANING = {  # variable: units, long_name
    "seed": ("1", "seed of the run"),
    "disk": ("1", "index of the disk; 0 is the tracer"),
    "component": ("1", "Cartesian component"),
    "position": ("length", "position of the disk's centre"),
    "velocity": ("length/time", "velocity"),
    "image": ("1", "periodic images crossed; unwrapped position = position + image * (width, height) of the box"),
    "unwrapped": ("length", "position of the disk's centre, as if it had not been brought back into a periodic box"),
    "box_size": ("length", "width and height of the box"),
    "radius": ("length", "radius"),
    "mass": ("mass", "mass"),
    "event_seed": ("1", "seed of the run of the collision"),
    "event_time": ("time", "time of the collision"),
    "a": ("1", "colliding disk"),
    "b": ("1", "its partner: a disk, or a wall: -1 left, -2 right, -3 bottom, -4 top"),
    "impulse": ("mass*length/time", "momentum transferred to disk a"),
    "pair_collisions": ("1", "collisions between disks"),
    "wall_collisions": ("1", "collisions of disks with walls"),
    "tracer_collisions": ("1", "collisions of the tracer with disks"),
    "energy_drift": ("1", "relative change of the kinetic energy over the run"),
    "worst_overlap": ("1", "deepest overlap of two disks, in contact distances"),
    "momentum_residual": ("1", "relative residual of the momentum balance of disks and walls"),
    "kinetic_energy": ("energy", "total kinetic energy at t = 0, conserved; NaN if not representable in these units"),
    "virial": ("energy*time", "sum of abs(momentum transfer) * contact distance over the pair collisions of the run"),
    "wall_impulse": ("mass*length/time", "sum of abs(momentum transfer) over the wall collisions of the run"),
    "missed_collisions": ("1", "collisions missed because the pair met and separated within one time step"),
    "friction_rate": ("1/time", "friction rate gamma of the tracer, dv/dt = -gamma v + noise"),
    "initial_square_speed": ("length^2/time^2", "squared speed of the tracer at t = 0"),
    "failed": (
        "1",
        "1 if overlap, energy drift or momentum residual exceeds its bound, a number is not finite or the run could "
        "not go on: exclude from averages",
    ),
    "stopped": ("1", "why the run could not go on; empty for a run that came to its end"),
}
SCALES = {"seed", "disk", "component", *AXES}  # coordinates: each along the dimension of its name
OF_POSITIONS = {"failed": ("seed",), "box_size": ("component",)}  # further coordinates of a tree, and their dimensions
LOG = dict(zip(("event_time", "a", "b", "impulse"), Events._fields, strict=True))  # variable: field of Events
NO_OBSERVABLES = {*SCALES, *Track._fields, "stopped"}  # variables of the root

Groups = dict[str, dict[str, np.ndarray]]  # {group: {variable: values}}, the root first


def described(name: str, own: Own = NO_OWN) -> dict[str, str]:
    """Return the units and the meaning of a variable, and the function that measured it if it is one's own."""
    if name in own:
        return {key: getattr(own[name], key) for key in ("units", "long_name", "observable")}
    known = ARRAYS.get(name) or AXES.get(name)
    other = MEANING.get(name, ("1", name.replace("_", " ")))
    units, long_name = (known.units, known.long_name) if known else other
    return {"units": units, "long_name": long_name}


def dims_of(group: str, name: str, own: Own = NO_OWN) -> tuple[str, ...]:
    """Return the dimensions of a variable in a group, `/`, `/disks` or `/events`."""
    if name in SCALES:
        return (name,)
    if name in OF_POSITIONS:
        return OF_POSITIONS[name]
    if group == "/events":
        return ("event", "component") if name == "impulse" else ("event",)
    if name in (*Track._fields, "unwrapped"):
        return ("time", "seed", "component") if group == "/" else ("time", "seed", "disk", "component")
    if group == "/disks":
        return ("disk",)
    known = own.get(name) or ARRAYS.get(name)
    return ("seed", *known.dims) if known else ("seed",)


def groups_of(scene: Scene, ensemble: Ensemble) -> Groups:
    """Return runs as the variables of each group; tracks of several whole runs, and collisions, are copied."""
    along = [dim for name in ensemble.observables for dim in dims_of("/", name, ensemble.own) if dim in AXES]
    root = {dim: np.asarray(AXES[dim].coordinates(scene)) for dim in along}
    root |= {"time": ensemble.times, "seed": ensemble.seeds, "component": np.array(["x", "y"])}
    root |= _recorded(ensemble.tracer) | ensemble.observables
    if ensemble.stopped:
        root["stopped"] = np.array([ensemble.stopped.get(seed, "") for seed in ensemble.seeds.tolist()])
    groups = {"/": root}
    if ensemble.whole:
        sizes = {"disk": np.arange(scene.particles), "radius": scene.radius, "mass": scene.mass}
        groups["/disks"] = sizes | _recorded(_side_by_side(ensemble))
    if ensemble.events:
        logs = ensemble.events.values()
        columns = {name: np.concatenate([getattr(log, field) for log in logs]) for name, field in LOG.items()}
        groups["/events"] = {"event_seed": np.repeat([*ensemble.events], [len(log.time) for log in logs])} | columns
    return groups


def _recorded(track: Track | None) -> dict[str, np.ndarray]:
    """Return position, velocity and image, as far as they are recorded."""
    return {} if track is None else {name: values for name, values in track._asdict().items() if values is not None}


def _side_by_side(ensemble: Ensemble) -> Track:
    """Return the tracks of all disks of all runs (T, S, N, 2); without values for runs that could not go on."""
    seeds, first = ensemble.seeds.tolist(), next(iter(ensemble.whole.values()))
    if len(seeds) == 1:  # not copied
        return Track(*(None if values is None else values[:, None] for values in first))
    absent = Track(*(None if values is None else blank(values.shape, values.dtype) for values in first))
    tracks = zip(*(ensemble.whole.get(seed, absent) for seed in seeds), strict=True)
    return Track(*(None if values[0] is None else np.stack(values, axis=1) for values in tracks))


def ensemble_of(groups: Groups, average: str, own: Own = NO_OWN) -> Ensemble:
    """Return the runs of such variables."""
    root = groups["/"]
    seeds = root["seed"].tolist()
    stopped = {seed: str(reason) for seed, reason in zip(seeds, root.get("stopped", ()), strict=False) if reason}
    columns = {seed: column for column, seed in enumerate(seeds) if seed not in stopped}
    disks = _track(groups["/disks"]) if "/disks" in groups else None
    return Ensemble(
        seeds=root["seed"],
        times=root["time"],
        tracer=_track(root) if "position" in root else None,
        observables={name: values for name, values in root.items() if name not in NO_OBSERVABLES},
        whole={seed: disks.of(column) for seed, column in columns.items()} if disks else {},
        events=_events(groups["/events"], [*columns]) if "/events" in groups else {},
        average=average,
        stopped=stopped,
        own=dict(own),
    )


def _track(variables: dict[str, np.ndarray]) -> Track:
    return Track(*(variables.get(name) for name in Track._fields))


def _events(variables: dict[str, np.ndarray], seeds: list[int]) -> dict[int, Events]:
    """Return the collisions of each run, in the order in which they are listed."""
    order = np.argsort(variables["event_seed"], kind="stable")
    ends = (np.searchsorted(variables["event_seed"][order], seeds, side) for side in ("left", "right"))
    rows = {seed: order[first:end] for seed, first, end in zip(seeds, *ends, strict=True)}
    return {seed: Events(*(variables[name][of_run] for name in LOG)) for seed, of_run in rows.items()}
