"""Scenes whose disks are in a file, and the files: CSV, extended XYZ, GSD, runs of brownpipe.

What `brownpipe export` writes is read back, to the bit where the format has the digits.

    csv    columns x, y, radius, mass; perhaps vx, vy or velocity_x, velocity_y; species; seed, time
    xyz    Properties pos, radius, mass or masses; perhaps velo, vel or momenta; type or species
    gsd    schema hoomd: positions from the centre of the box, diameters, types
    h5     runs with all disks recorded
"""

import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.configuration import Configuration, ConfigurationKey, named
from brownpipe.scene.reading import Document, Number, SeedNumber, read_yaml, validated
from brownpipe.scene.sections import Box
from brownpipe.scene.species import species_table

SAME_TIME = 1e-9  # in durations: times closer than this are one
SAME_SIDE = 1e-6  # relative: sides of boxes in single precision
VELOCITIES = (("vx", "vy"), ("velocity_x", "velocity_y"))  # columns of a CSV
KEY_AND_VALUE = re.compile(r'(\w+)=("[^"]*"|\S+)')  # in the comment of an extended XYZ


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
    if not isinstance(disks, Mapping) or not isinstance(disks.get("file"), str):
        return mapping
    if disks.get("configuration") is not None:  # it has been read
        return mapping
    box = validated(Box, mapping.get("box"), where, "box")
    seed = validated(SeedNumber | None, disks.get("seed"), where, "disks.seed")
    time = validated(Number | None, disks.get("time"), where, "disks.time")
    configuration = read_configuration(folder / disks["file"], box, seed, time)
    filled = Document(mapping)
    filled.lines = getattr(mapping, "lines", {})
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
    table = _read_table(file, sep=",", skipinitialspace=True)
    titles = [str(title).strip() for title in table.columns]
    table.columns = titles
    _refuse_twice(file, titles)
    line = np.arange(2, len(table) + 2)  # of each row in the file
    for column, wanted in (("seed", seed), ("time", time)):
        if column not in table:
            if wanted is not None:
                raise RequestError(f"{file}: {column}: the table has no such column")
            continue
        values = _numbers(file, table, column, line)
        chosen = _chosen(file, column, np.unique(values), wanted)
        is_chosen = values == chosen
        table = table[is_chosen]
        line = line[is_chosen]
    columns = {}
    for name in ("x", "y", "radius", "mass"):
        columns[name] = _numbers(file, table, name, line)
    velocity = None
    for pair in VELOCITIES:
        if set(pair) & set(table.columns):
            velocity = np.stack([_numbers(file, table, name, line) for name in pair], axis=1)
    position = np.stack([columns["x"], columns["y"]], axis=1)
    disks = Configuration(position, velocity, columns["radius"], columns["mass"])
    if "species" in table:
        return named(disks, _names_in(file, table["species"], line))
    return disks


def _names_in(file: Path, column: Any, line: np.ndarray) -> np.ndarray:
    """Return the names (N,) in a column of species."""
    names = np.array([str(name).strip() for name in column])
    if len(names) and not all(names):
        raise RequestError(f"{file}: line {line[np.argmin(names != '')]}: species: missing")
    return names


def _read_table(file: Path, **options: Any) -> Any:
    """Return a table of the texts in a file; as numbers pandas may round them in the last digit."""
    import pandas  # takes 0.3 s

    try:
        with warnings.catch_warnings():  # of rows with too many values
            warnings.simplefilter("error", pandas.errors.ParserWarning)
            texts = {"dtype": str, "keep_default_na": False, "index_col": False}
            return pandas.read_csv(file, encoding="utf-8-sig", **texts, **options)
    except UnicodeDecodeError:
        raise RequestError(f"{file}: is no text") from None
    except (ValueError, pandas.errors.ParserError, pandas.errors.ParserWarning) as error:
        reason = str(error).splitlines()[0].removeprefix("Error tokenizing data. C error: ")
        raise RequestError(f"{file}: is no table: {reason}") from None


def _refuse_twice(file: Path, titles: list[str]) -> None:
    """Refuse a table that has a column twice, or velocities under both of their names."""
    for title in titles:
        # pandas calls the second x `x.1`
        if f"{title}.1" in titles or titles.count(title) > 1:
            raise RequestError(f"{file}: {title}: must be in one column, not in two")
    if {"vx", "vy"} & {*titles} and {"velocity_x", "velocity_y"} & {*titles}:
        raise RequestError(f"{file}: vx: must not be given with velocity_x")


def _numbers(file: Path, table: Any, column: str, line: np.ndarray) -> np.ndarray:
    """Return the numbers (N,) in a column of a table whose rows are at these lines (N,) of the
    file.
    """
    if column not in table:
        found = ", ".join(map(str, table.columns))
        raise RequestError(f"{file}: {column}: missing; the columns are {found:.80}")
    texts = table[column].to_numpy(object)
    values = np.array([_number(text) for text in texts], float)
    is_wrong = ~np.isfinite(values)
    if is_wrong.any():
        row = int(np.argmax(is_wrong))
        found = texts[row]
        problem = f"must be a number, not {found}"[:60] if found else "missing"
        raise RequestError(f"{file}: line {line[row]}: {column}: {problem}")
    return values


def _number(text: str) -> float:
    """Return the number that a text is, NaN for others: 1_0, which Python reads as 10, is none."""
    try:
        return np.nan if "_" in text else float(text)
    except ValueError:
        return np.nan


def _chosen(file: Path, key: str, present: np.ndarray, wanted: float | None) -> float:
    """Return the seed or time to take of those (n,) in a file: that which is wanted, else the first
    seed and the last time.
    """
    if not len(present):
        raise RequestError(f"{file}: holds no disks")
    if wanted is None:
        return float(present[0] if key == "seed" else present[-1])
    return float(present[_index_of(file, key, present, wanted)])


def _index_of(file: Path, key: str, present: np.ndarray, wanted: float) -> int:
    """Return where a wanted value is among those (n,) in a file, up to round-off."""
    nearest = int(np.argmin(np.abs(present - wanted)))
    slack = SAME_TIME * float(np.abs(present).max())
    if abs(present[nearest] - wanted) <= slack:
        return nearest
    some = ", ".join(f"{value:g}" for value in present[:8])
    more = f", ... {present[-1]:g}" if len(present) > 8 else ""
    raise RequestError(f"{file}: {key}: must be one of {some}{more}, not {wanted:g}")


def _from_xyz(file: Path, box: Box | None, seed: int | None, time: float | None) -> Configuration:
    """Return the disks in a frame of an extended XYZ."""
    _refuse_seed(file, seed)
    line, number, comment = _frame(file, time)
    keys = {key: value.strip('"') for key, value in KEY_AND_VALUE.findall(comment)}
    names = _xyz_columns(file, keys.get("Properties", "species:S:1:pos:R:3"))
    table = _read_table(file, sep=r"\s+", header=None, names=names, skiprows=line, nrows=number)
    lines = np.arange(line + 1, line + 1 + len(table))
    if len(table) < number:
        raise RequestError(f"{file}: ends after {len(table)} of {number} disks")

    def column(*choices: str) -> np.ndarray | None:
        present = [name for name in choices if name in table]
        return _numbers(file, table, present[0], lines) if present else None

    def vector(*choices: str) -> np.ndarray | None:
        x = column(*(f"{name}-0" for name in choices))
        y = column(*(f"{name}-1" for name in choices))
        return None if x is None or y is None else np.stack([x, y], axis=1)

    position = vector("pos")
    radius = column("radius", "radii")
    mass = column("mass", "masses")
    for name, values in (("pos", position), ("radius", radius), ("mass", mass)):
        if values is None:
            raise RequestError(f"{file}: line {line}: Properties: must have {name}")
    assert position is not None and radius is not None and mass is not None
    _refuse_depth(file, column("pos-2"))
    if "Lattice" in keys:
        _check_lattice(file, line, keys, box)
    velocity = vector("velo", "vel", "velocity", "velocities")
    momentum = vector("momenta")
    if velocity is None and momentum is not None:
        velocity = momentum / mass[:, None]
    disks = Configuration(position, velocity, radius, mass)
    for name in ("type", "species"):
        if name in table:
            return named(disks, table[name].astype(str).to_numpy())
    return disks


def _frame(file: Path, time: float | None) -> tuple[int, int, str]:
    """Return of a frame of an XYZ the line of its comment (from 1), number of disks and comment:
    the last one, or that of a time.
    """
    frames = []
    at = 1
    with open(file, encoding="utf-8-sig") as lines:
        try:
            for text in lines:
                if not text.strip():
                    at += 1
                    continue
                if not text.strip().isdecimal():
                    raise RequestError(f"{file}: line {at}: must be the number of disks")
                number = int(text)
                frames.append((at + 1, number, next(lines, "")))
                for _ in range(number):
                    next(lines, "")
                at += number + 2
        except UnicodeDecodeError:
            raise RequestError(f"{file}: is no text") from None
    if not frames:
        raise RequestError(f"{file}: holds no disks")
    if time is None:
        return frames[-1]
    times = np.array([_time_of(comment) for *_, comment in frames])
    if np.isnan(times).any():
        raise RequestError(f"{file}: time: the frames have no Time")
    return frames[_index_of(file, "time", times, time)]


def _time_of(comment: str) -> float:
    keys = dict(KEY_AND_VALUE.findall(comment))
    return _number(keys.get("Time", keys.get("time", "")))


def _xyz_columns(file: Path, properties: str) -> list[str]:
    """Return the name of each column: `radius`, or for vectors `pos-0`, `pos-1`, ..."""
    words = properties.split(":")
    names = []
    for name, width in zip(words[::3], words[2::3], strict=False):
        if not width.isdigit():
            raise RequestError(f"{file}: Properties: must be name:type:width, not {properties!r}")
        if width == "1":
            names.append(name)
        else:
            names += [f"{name}-{k}" for k in range(int(width))]
    return names


def _check_lattice(file: Path, line: int, keys: Mapping[str, str], box: Box | None) -> None:
    """Refuse another box than that of the scene, and boxes that are no rectangles."""
    edges = [_number(word) for word in keys["Lattice"].split()]
    if len(edges) != 9 or not np.isfinite(edges).all():
        raise RequestError(f"{file}: line {line}: Lattice: must be nine numbers")
    if any(edges[k] for k in (1, 3)):
        raise RequestError(f"{file}: line {line}: Lattice: must be a rectangle along x and y")
    origin = [_number(word) for word in keys.get("Origin", "").split()[:2]]
    _check_box(file, box, (edges[0], edges[4]), origin or None)


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


def _gsd_index(file: Path, trajectory: Any, time: float | None) -> int:
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
    assert track.velocity is not None  # whole runs have velocities
    return Configuration(
        position=track.position[sample],
        velocity=track.velocity[sample],
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
