"""Scenes whose disks are in a file, and the files: CSV, extended XYZ, GSD, runs of brownpipe.

What `brownpipe export` writes is read back, to the bit where the format has the digits.

    csv    columns x, y, radius, mass; perhaps vx, vy or velocity_x, velocity_y; species; seed, time
    xyz    Properties pos, radius, mass or masses; perhaps velo, vel or momenta; type or species
    gsd    schema hoomd: positions from the centre of the box, diameters, types
    h5     runs with all disks recorded
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.configuration import Configuration, ConfigurationKey, named
from brownpipe.scene.reading import Document, Number, SeedNumber, read_yaml, validated
from brownpipe.scene.sections import Box
from brownpipe.scene.species import species_table
from brownpipe.storage.tables import (
    Frame,
    Table,
    frames_of,
    keys_of,
    names_in,
    number_of,
    numbers_in,
    read_csv,
    read_frame,
    select_rows,
)

if TYPE_CHECKING:
    from gsd.hoomd import HOOMDTrajectory

SAME_TIME = 1e-9  # in durations: times closer than this are one
SAME_SIDE = 1e-6  # relative: sides of boxes in single precision
VELOCITIES = (("vx", "vy"), ("velocity_x", "velocity_y"))  # columns of a CSV
XYZ_VELOCITIES = ("velo", "vel", "velocity", "velocities")  # properties


# -- scenes ----------------------------------------------------------------------------------------


def read_scene(path: str | Path, particles: int | None = None) -> Scene:
    """Return the scene of a YAML file, with `particles` disks in total if that is given.

    Raises RequestError, one line, for anything wrong with the file or the scene, or with the file
    of its disks.
    """
    return parse_scene(read_scene_file(path), str(path), particles)


def read_scene_file(path: str | Path) -> Document:
    """Return the mapping in a scene file, with the disks of the file that it names."""
    return with_disks_of_file(read_yaml(path), str(path), Path(path).parent)


def with_disks_of_file(mapping: Document, where: str, folder: Path) -> Document:
    """Return the mapping of a scene with the configuration in the file that its disks name.

    where: the scene file, for messages. folder: where the path of the other file begins.
    """
    disks = mapping.get("disks")
    if not isinstance(disks, Mapping):
        return mapping
    file = disks.get("file")
    if not isinstance(file, str):
        return mapping
    if disks.get("configuration") is not None:  # it has been read
        return mapping
    box = validated(Box, mapping.get("box"), where, "box")
    seed = validated(SeedNumber | None, disks.get("seed"), where, "disks.seed")
    time = validated(Number | None, disks.get("time"), where, "disks.time")
    configuration = read_configuration(folder / file, box, seed, time)
    filled = Document(mapping)
    filled.lines = mapping.lines
    filled["disks"] = {**disks, "configuration": configuration}
    return filled


# -- files -----------------------------------------------------------------------------------------


def read_configuration(
    path: str | Path, box: Box | None = None, seed: int | None = None, time: float | None = None
) -> Configuration:
    """Return the disks in a file.

    box: that of the scene, whose sides must be those in the file, if it has them. Positions of a
    GSD, which are relative to the centre of its box, are shifted to that of the scene; without one
    to a box from 0 on.
    seed, time [time]: of the run and the sample in the file; by default its first whole run, and
    the last sample.

    Raises RequestError for a file that cannot be read, lacks a column, has numbers that no disk can
    have, or another box.
    """
    file = Path(path)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        raise RequestError(f"{file}: must end in {', '.join(READERS)}")
    try:
        if not file.stat().st_size:
            raise RequestError(f"{file}: is empty")
        configuration = reader(file, box, seed, time)
    except OSError as error:
        raise RequestError(f"{file}: cannot be read: {error.strerror or error}") from None
    return validated(ConfigurationKey, configuration, str(file))


def _from_csv(file: Path, box: Box | None, seed: int | None, time: float | None) -> Configuration:
    """Return the disks in a table with a heading; of several seeds or times those asked for."""
    table = read_csv(file)
    table = _rows_of(table, "seed", seed)
    table = _rows_of(table, "time", time)
    columns = {name: numbers_in(table, name) for name in ("x", "y", "radius", "mass")}
    position = np.stack([columns["x"], columns["y"]], axis=1)
    _refuse_depth(file, _first_column(table, "z"))
    velocities = [titles for titles in VELOCITIES if not table.columns.keys().isdisjoint(titles)]
    if len(velocities) > 1:
        place = f"{file}: line {table.heading}"
        raise RequestError(f"{place}: vx: must not be given with velocity_x")
    velocity = None
    for titles in velocities:
        velocity = np.stack([numbers_in(table, name) for name in titles], axis=1)
    _refuse_motion_along_z(file, _first_column(table, "vz", "velocity_z"))
    disks = Configuration(position, velocity, columns["radius"], columns["mass"])
    return _with_species(disks, table, "species")


def _rows_of(table: Table, key: str, wanted: float | None) -> Table:
    """Return the rows of the seed or time that is wanted, else of the first seed or the last
    time.
    """
    file = table.file
    if key not in table.columns:
        if wanted is not None:
            raise RequestError(f"{file}: {key}: the table has no such column")
        return table
    values = numbers_in(table, key)
    present, number = np.unique(values, return_counts=True)
    if not len(present):
        return table
    if key == "time" and np.ptp(number):
        few = int(np.argmin(number))
        many = int(np.argmax(number))
        counts = f"{number[few]} at {present[few]:.12g} and {number[many]} at {present[many]:.12g}"
        raise RequestError(f"{file}: time: must have equally many disks at each, not {counts}")
    if wanted is not None:
        chosen = present[_index_of(file, key, present, wanted)]
    else:
        chosen = present[0 if key == "seed" else -1]
    return select_rows(table, values == chosen)


def _index_of(file: Path, key: str, present: np.ndarray, wanted: float) -> int:
    """Return where a wanted seed or time is among those (n,) in a file; times up to round-off."""
    nearest = int(np.argmin(np.abs(present - wanted)))
    slack = SAME_TIME * float(np.abs(present).max()) if key == "time" else 0.0
    if abs(present[nearest] - wanted) <= slack:
        return nearest
    some = ", ".join(f"{value:.12g}" for value in present[:8])
    more = f", ... {present[-1]:.12g}" if len(present) > 8 else ""
    raise RequestError(f"{file}: {key}: must be one of {some}{more}, not {wanted:.12g}")


def _from_xyz(file: Path, box: Box | None, seed: int | None, time: float | None) -> Configuration:
    """Return the disks in a frame of an extended XYZ: the last one, or that of a time."""
    _refuse_seed(file, seed)
    frame = _frame_of_time(file, frames_of(file), time)
    table = read_frame(file, frame)
    position = _required(file, frame, "pos", _first_vectors(table, "pos"))
    radius = _required(file, frame, "radius", _first_column(table, "radius", "radii"))
    mass = _required(file, frame, "mass", _first_column(table, "mass", "masses"))
    _refuse_depth(file, _first_column(table, "pos-2"))
    _check_lattice(file, frame, box)
    velocity = _first_vectors(table, *XYZ_VELOCITIES)
    momentum = _first_vectors(table, "momenta")
    if velocity is None and momentum is not None:
        velocity = momentum / mass[:, None]
    along_z = [f"{name}-2" for name in (*XYZ_VELOCITIES, "momenta")]
    _refuse_motion_along_z(file, _first_column(table, *along_z))
    disks = Configuration(position, velocity, radius, mass)
    return _with_species(disks, table, "type", "species")


def _required(file: Path, frame: Frame, name: str, values: np.ndarray | None) -> np.ndarray:
    """Return the values of a property. Raises RequestError if the frame does not have it."""
    if values is None:
        raise RequestError(f"{file}: line {frame.line}: Properties: must have {name}")
    return values


def _frame_of_time(file: Path, frames: list[Frame], time: float | None) -> Frame:
    """Return the last of some frames, or that of a time."""
    if time is None:
        return frames[-1]
    times = np.array([number_of(keys_of(frame).get("time", "")) for frame in frames])
    if np.isnan(times).any():
        raise RequestError(f"{file}: time: the frames have no Time")
    return frames[_index_of(file, "time", times, time)]


def _first_column(table: Table, *titles: str) -> np.ndarray | None:
    """Return the numbers (N,) in the first of these columns that a table has; None without any."""
    present = [title for title in titles if title in table.columns]
    return numbers_in(table, present[0]) if present else None


def _first_vectors(table: Table, *titles: str) -> np.ndarray | None:
    """Return the x and y components (N, 2) of the first of these vectors that a table has; None
    without any.
    """
    x = _first_column(table, *(f"{title}-0" for title in titles))
    y = _first_column(table, *(f"{title}-1" for title in titles))
    return None if x is None or y is None else np.stack([x, y], axis=1)


def _with_species(disks: Configuration, table: Table, *titles: str) -> Configuration:
    """Return disks with the names in the first of these columns that a table has."""
    present = [title for title in titles if title in table.columns]
    return named(disks, names_in(table, present[0])) if present else disks


def _check_lattice(file: Path, frame: Frame, box: Box | None) -> None:
    """Refuse another box than that of the scene, and boxes that are no rectangles."""
    keys = keys_of(frame)
    if "lattice" not in keys:
        return
    place = f"{file}: line {frame.line}"
    edges = [number_of(word) for word in keys["lattice"].split()]
    if len(edges) != 9 or not np.isfinite(edges).all():
        raise RequestError(f"{place}: Lattice: must be nine numbers")
    if any(edges[k] for k in (1, 3)):
        raise RequestError(f"{place}: Lattice: must be a rectangle along x and y")
    origin = [number_of(word) for word in keys.get("origin", "").split()]
    if len(origin) not in (0, 3) or not np.isfinite(origin).all():
        raise RequestError(f"{place}: Origin: must be three numbers")
    _check_box(file, box, (edges[0], edges[4]), origin[:2] or None)


def _from_gsd(file: Path, box: Box | None, seed: int | None, time: float | None) -> Configuration:
    """Return the disks in a frame of a GSD, in double precision."""
    _refuse_seed(file, seed)
    try:
        import gsd.hoomd
    except ImportError as error:
        raise RequestError(
            f"{file}: needs the package gsd ({error}): pip install gsd; or csv or xyz"
        ) from None
    try:
        with gsd.hoomd.open(str(file), "r") as trajectory:
            if not len(trajectory):
                raise RequestError(f"{file}: holds no frames")
            frame = trajectory[_gsd_index(file, trajectory, time)]
    except RuntimeError as error:
        raise RequestError(f"{file}: is no GSD: {error}") from None
    width, height, _, tilt = (float(edge) for edge in frame.configuration.box[:4])
    if tilt:
        raise RequestError(f"{file}: box: must be a rectangle, and is tilted by {tilt:g}")
    _check_box(file, box, (width, height), None)
    particles = frame.particles
    position = particles.position.astype(float)
    _refuse_depth(file, position[:, 2])
    _refuse_motion_along_z(file, particles.velocity[:, 2])
    sides = np.array([width, height] if box is None else [box.width, box.height])
    origin = np.zeros(2) if box is None else np.array(box.origin)
    velocity = particles.velocity[:, :2].astype(float)
    disks = Configuration(
        position=position[:, :2] + origin + sides / 2,
        velocity=velocity if velocity.any() else None,  # gsd has zeros where none were written
        radius=particles.diameter.astype(float) / 2,
        mass=particles.mass.astype(float),
    )
    types = np.array(particles.types)
    return named(disks, types[particles.typeid])


def _gsd_index(file: Path, trajectory: "HOOMDTrajectory", time: float | None) -> int:
    """Return the index of the last frame of a GSD, or of that of a time, which our exports log."""
    if time is None:
        return len(trajectory) - 1
    times = []
    for frame in trajectory:
        logged = frame.log.get("time", [np.nan])
        times.append(float(np.ravel(logged)[0]))
    if np.isnan(times).any():
        raise RequestError(f"{file}: time: the frames have no log/time")
    return _index_of(file, "time", np.array(times), time)


def _from_runs(file: Path, box: Box | None, seed: int | None, time: float | None) -> Configuration:
    """Return the disks of a run of brownpipe at a time."""
    from brownpipe.storage.trajectories import chosen_seed, read_trajectories  # imports h5py

    runs = read_trajectories(file)
    scene = runs.scene
    tracks = runs.ensemble.whole
    chosen = chosen_seed(runs, str(file), seed, tracks)
    track = tracks[chosen]
    _check_box(file, box, (scene.box.width, scene.box.height), list(scene.box.origin))
    times = runs.ensemble.times
    sample = len(times) - 1 if time is None else _index_of(file, "time", times, time)
    species = species_table(scene)
    return Configuration(
        position=track.position[sample],
        velocity=track.known_velocity[sample],
        radius=scene.radius,
        mass=scene.mass,
        names=species.name,
        species_index=species.species_index,
    )


READERS = {
    ".csv": _from_csv,
    ".xyz": _from_xyz,
    ".extxyz": _from_xyz,
    ".gsd": _from_gsd,
    ".h5": _from_runs,
}


# -- checks that formats share ---------------------------------------------------------------------


def _refuse_seed(file: Path, seed: int | None) -> None:
    if seed is not None:
        raise RequestError(f"{file}: seed: must not be given, as the file has no seeds")


def _refuse_depth(file: Path, z: np.ndarray | None) -> None:
    """Refuse disks that are not in a plane."""
    if z is not None and len(z) and np.ptp(z) > 0:
        least = float(z.min())
        most = float(z.max())
        raise RequestError(f"{file}: z: must be the same for all disks, not {least:g} to {most:g}")


def _refuse_motion_along_z(file: Path, component: np.ndarray | None) -> None:
    """Refuse disks that leave their plane."""
    if component is not None and component.any():
        fastest = float(component[np.argmax(np.abs(component))])
        raise RequestError(f"{file}: velocity along z: must be 0 for all disks, not {fastest:g}")


def _check_box(
    file: Path, box: Box | None, sides: Iterable[float], origin: list[float] | None
) -> None:
    """Refuse a box in a file, of these sides and lower left corner, if known, that is not that of
    the scene.
    """
    if box is None:
        return
    width, height = sides
    longest = max(box.width, box.height)
    is_same = np.allclose([width, height], [box.width, box.height], rtol=SAME_SIDE, atol=0)
    if not is_same:
        _refuse_box(file, f"{width:g} x {height:g}", f"{box.width:g} x {box.height:g}")
    if origin and not np.allclose(origin, box.origin, rtol=0, atol=SAME_SIDE * longest):
        corner = tuple(float(f"{value:g}") for value in origin)
        _refuse_box(file, f"from {corner}", f"from {box.origin}")


def _refuse_box(file: Path, found: str, expected: str) -> NoReturn:
    raise RequestError(f"{file}: box: must be that of the scene, {expected}, not {found}")
