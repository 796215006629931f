"""`brownpipe export`: trajectories in formats that other programs read. One sample at a time is
converted.

    gsd   one whole run, for HOOMD-blue, freud, MDAnalysis and OVITO, in single precision
    xyz   one whole run, extended XYZ for ASE, OVITO and VMD, every digit
    csv   a table of all whole runs or, if there are none, of the tracers of all runs, every digit

Positions are those of the trajectory file, inside the box. Where some sides are periodic all three
formats have the images, too: unwrapped position = position + image * (width, height). In a channel
the images across its walls are 0.

What the run was made from is in `log/origin` of the first frame of a GSD (JSON, one byte a letter),
and in the comment of the first frame of an XYZ. A CSV has nothing but its table, so that every
program reads it.
"""

import json
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path

import numpy as np

from brownpipe.engines.ensemble import Ensemble, Track, failures
from brownpipe.errors import RequestError
from brownpipe.scene import Scene
from brownpipe.scene.sections import Box
from brownpipe.scene.species import species_table
from brownpipe.storage.files import replacing
from brownpipe.storage.trajectories import Trajectories, chosen_seed, runs_record

# version 2.0 adds double precision, and needs HOOMD-blue 7, OVITO 3.15.2 or later
GSD_SCHEMA = (1, 4)
TITLES = {  # in a CSV
    "position": ("x", "y"),
    "velocity": ("velocity_x", "velocity_y"),
    "image": ("image_x", "image_y"),
}


def export_runs(
    trajectories: Trajectories, path: str, output: str, form: str, seed: int | None = None
) -> tuple[dict[int, Track], list[str]]:
    """Write the run of a seed to the file `output` as `form`: gsd, xyz or csv; completely or not at
    all.

    path: the file of the trajectories, for messages. seed: by default the smallest of the whole
    runs; for csv, all. A table has the tracers of all runs if none is whole.

    Returns the tracks in the file by their seeds, and what a reader of the file must know. Raises
    RequestError for a file without such runs, numbers beyond single precision (GSD), or if the
    package gsd cannot be imported; StorageError if the file cannot be written.
    """
    scene = trajectories.scene
    ensemble = trajectories.ensemble
    tracks = ensemble.whole
    if form == "csv" and not tracks:
        tracks = _tracers(ensemble)
    first = chosen_seed(trajectories, path, seed, tracks)
    if form != "csv" or seed is not None:
        tracks = {first: tracks[first]}
    record = runs_record(trajectories, sorted(tracks), "all" if ensemble.whole else "")
    with replacing(output) as temporary:
        FORMATS[form](temporary, scene, ensemble.times, tracks, record)
    remarks = [failures(ensemble)] if len(ensemble.failed_seeds) else []
    if form == "gsd" and scene.box.has_walls:
        remarks.append(_without_walls(scene.box))
    return tracks, remarks


def _without_walls(box: Box) -> str:
    """Return what a reader of a GSD must know about the walls of its box."""
    walls = "GSD has no walls, so programs take the box for periodic"
    if not box.is_channel:
        return f"{walls}: switch that off, or enlarge the box"
    across = "y" if box.periodic_x else "x"
    return f"{walls} in {across}, too: switch that off, or enlarge the box in {across}"


def _tracers(ensemble: Ensemble) -> dict[int, Track]:
    """Return the tracks (M = 1) of the tracers of all runs that came to their end, by seed."""
    if ensemble.tracer is None:
        return {}
    tracks = {}
    for column, seed in enumerate(ensemble.seeds.tolist()):
        if seed not in ensemble.stopped:
            tracks[seed] = ensemble.tracer.select(slice(column, column + 1))
    return tracks


def _in_space(vectors: np.ndarray, kind: type = float) -> np.ndarray:
    """Return vectors (N, 2) with a third component, 0, perhaps of another type."""
    return np.pad(vectors.astype(kind), ((0, 0), (0, 1)))


def _rows(scene: Scene, *columns: np.ndarray) -> Iterator[list[str]]:
    """Yield the species of each disk and its numbers in columns (N, ...), with every digit."""
    species = species_table(scene)
    flat = [np.reshape(values, (len(values), -1)).tolist() for values in columns]
    for disk, vectors in enumerate(zip(*flat, strict=True)):
        name = species.name[species.species_index[disk]]
        yield [name, *map(repr, chain.from_iterable(vectors))]


# -- formats ---------------------------------------------------------------------------------------


def _gsd(
    path: Path,
    scene: Scene,
    times: np.ndarray,
    tracks: dict[int, Track],
    record: Mapping[str, object],
) -> None:
    """Write one run as GSD, schema hoomd, by the package gsd.

    The box is two-dimensional as HOOMD-blue defines it, Lz = 0, and centred at the origin:
    positions are shifted by its centre. Types are the species; `configuration.step` is the index of
    the sample, `log/time` its time. Rounding to single precision moves a disk by at most 3e-8 of
    the box in x and in y.

    GSD cannot say that a box has walls. Its sides are then the walls, and `log/periodic` (2,), of x
    and y, is 0 instead of 1. Programs take it for periodic: switch that off (OVITO), or enlarge the
    box by the longest distance that matters, so that no pair is closer through a wall than inside
    (freud, MDAnalysis). A box with walls all around has no images.
    """
    try:
        import gsd.fl
        import gsd.hoomd
    except ImportError as error:
        raise RequestError(
            f"--to gsd: needs the package gsd ({error}): pip install gsd; or xyz or csv"
        ) from error

    (track,) = tracks.values()
    position = track.position
    velocity = track.known_velocity
    image = track.image
    box = scene.box
    species = species_table(scene)
    edges = np.array([box.width, box.height])
    sizes = np.concatenate([edges, scene.radius, scene.mass])
    largest = max(2 * sizes.max(), velocity.max(), -velocity.min())
    single = np.finfo(np.float32)
    if sizes.min() < single.tiny or largest > single.max:
        raise RequestError(
            f"--to gsd: holds numbers from {single.tiny:.1e} to {single.max:.1e} only; use xyz or "
            "csv"
        )
    path.touch()  # gsd would let others not read a file that it creates
    file = gsd.fl.open(
        path, "w", application="brownpipe", schema="hoomd", schema_version=GSD_SCHEMA
    )
    with gsd.hoomd.HOOMDTrajectory(file) as trajectory:
        for k, time in enumerate(times):
            frame = gsd.hoomd.Frame()
            frame.configuration.step = k
            frame.configuration.dimensions = 2
            frame.configuration.box = np.array([*edges, 0, 0, 0, 0], np.float32)
            frame.particles.N = scene.particles
            frame.particles.types = list(species.name)
            frame.particles.typeid = species.species_index
            frame.particles.diameter = np.float32(2 * scene.radius)
            frame.particles.mass = np.float32(scene.mass)
            frame.particles.position = _in_space(position[k] - box.origin - edges / 2, np.float32)
            frame.particles.velocity = _in_space(velocity[k], np.float32)
            if image is not None:
                frame.particles.image = _in_space(image[k], np.int32)
            frame.log = {"time": np.array([time]), "periodic": box.periodic_axes.astype(np.uint8)}
            if k == 0:
                origin = json.dumps(record, sort_keys=True).encode()
                frame.log["origin"] = np.frombuffer(origin, np.uint8)
            trajectory.append(frame)


def _xyz(
    path: Path,
    scene: Scene,
    times: np.ndarray,
    tracks: dict[int, Track],
    record: Mapping[str, object],
) -> None:
    """Write one run as extended XYZ, with z = 0 and the box from its `Origin` on.

    The third edge of the box has length 1, because programs refuse boxes without a volume, and is
    not periodic. Masses and velocities stand there twice: `mass` and `velo` for OVITO, `masses` and
    `momenta` for ASE, which otherwise takes 1 and 0. The species is a `type`, as ASE takes
    `species` for chemical elements.
    """
    (track,) = tracks.values()
    position = track.position
    velocity = track.known_velocity
    image = track.image
    radius = scene.radius
    mass = scene.mass[:, None]
    head = _xyz_head(scene)
    keys = ("command", "scene_digest", "source_digest")
    origin = "".join(f" {key}={json.dumps(record[key])}" for key in keys)
    with open(path, "w", encoding="ascii") as file:
        for k, time in enumerate(times.tolist()):
            columns = [_in_space(position[k]), radius, mass, mass]
            columns += [_in_space(velocity[k]), _in_space(mass * velocity[k])]
            if image is not None:
                columns.append(_in_space(image[k], np.int32))
            file.write(f"{scene.particles}\n{head} Time={time}{origin if k == 0 else ''}\n")
            file.writelines(f"{' '.join(row)}\n" for row in _rows(scene, *columns))


def _xyz_head(scene: Scene) -> str:
    """Return the box and the columns, as the comment of every frame of an XYZ states them."""
    box = scene.box
    columns = ["type:S:1", "pos:R:3", "radius:R:1", "mass:R:1", "masses:R:1"]
    columns += ["velo:R:3", "momenta:R:3"]
    if box.has_images:
        columns.append("image:I:3")
    left, bottom = box.origin
    lattice = f'Lattice="{box.width} 0 0 0 {box.height} 0 0 0 1"'
    origin = f'Origin="{left} {bottom} -0.5"'
    across, up = ("T" if is_periodic else "F" for is_periodic in box.periodic_axes)
    return f'{lattice} {origin} pbc="{across} {up} F" Properties={":".join(columns)}'


def _csv(
    path: Path, scene: Scene, times: np.ndarray, tracks: dict[int, Track], _: Mapping[str, object]
) -> None:
    """Write a table with a heading: a row for each seed, time and disk."""
    first = next(iter(tracks.values()))
    recorded = [name for name in TITLES if getattr(first, name) is not None]
    titles = ["seed", "time", "disk", "species"]
    for name in recorded:
        titles += TITLES[name]
    titles += ["radius", "mass"]
    with open(path, "w", encoding="ascii") as file:
        file.write(f"{','.join(titles)}\n")
        for seed, track in tracks.items():
            for k, time in enumerate(times.tolist()):
                columns = [getattr(track, name)[k] for name in recorded]
                number = len(columns[0])
                rows = _rows(scene, *columns, scene.radius[:number], scene.mass[:number])
                for disk, row in enumerate(rows):
                    file.write(f"{seed},{time},{disk},{','.join(row)}\n")


FORMATS = {"gsd": _gsd, "xyz": _xyz, "csv": _csv}
