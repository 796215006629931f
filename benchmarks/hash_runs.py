"""The numbers of many runs as hashes: does a change of the source leave every bit of every result
as it was?

    python benchmarks/hash_runs.py --write before.json     all scenes by all engines, on the old
    source
    python benchmarks/hash_runs.py --compare before.json   on the new one: names the datasets that
    differ, exit status 1 python benchmarks/hash_runs.py --quick                 three scenes

Each scene is run by `brownpipe simulate` with every engine and its settings; some of the files are
then given to `brownpipe aggregate`. Of each file all arrays of trajectories, collisions and
observables are hashed: name, shape, type and bytes. Attributes (the scene's text, versions,
digests) are left out. Where an engine refuses a scene, the exit status is all there is to compare.
This script uses the command line and h5py alone, so that it works with any arrangement of the
modules. Compare hashes of one set of packages only; the processor does not matter.
"""

import argparse
import hashlib
import io
import json
import math
import os
import sys
import tempfile
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

# sums of matrix products in an order that does not depend on the cores
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import h5py
import numpy as np

from brownpipe import observables
from brownpipe.cli import main as brownpipe

STEPS = [f"timestep --collisions {when}" for when in ("at_contact", "late")]
ENGINES = ("exact", *STEPS, "langevin --friction enskog", "langevin --friction boltzmann")
RECORDS = {
    "exact": "all,events",
    "timestep": "all",
    "langevin": "tracer",
}  # as much as each can record
# those that every engine of all disks can measure
OF_TRACKS = [name for name in observables.OBSERVABLES if not observables.needs_events([name])]
ALL = ",".join(OF_TRACKS)
DONE, FAILED, WRONG = 0, 1, 2  # exit status of the command line
STATUS = "exit status"  # stands among the datasets of a file
DIMENSIONS = {  # of the keys of a scene: exponents of length, mass and time
    **dict.fromkeys(("x", "y", "radius", "position"), (1, 0, 0)),
    **dict.fromkeys(("duration", "sample_interval", "time", "first"), (0, 0, 1)),
    "mass": (0, 1, 0),
    "velocity": (1, 0, -1),
    "standard_deviation": (1, 0, -1),
    "temperature": (2, 1, -2),
}


class Case(NamedTuple):
    """A scene and how it is run."""

    scene: dict  # as in a scene file
    time_step: float = 2e-3
    seeds: str = "0-2"
    options: str = ""  # further ones of `brownpipe simulate`, for all engines
    more: tuple[str, ...] = ()  # further engines
    record: str | None = None  # instead of RECORDS
    aggregated: bool = False


# -- scenes ----------------------------------------------------------------------------------------

THERMAL = {"temperature": 1.6, "zero_momentum": False}
AT_REST = {"temperature": 0.0, "zero_momentum": False}
PINNED = {"time": 1.0, "tracer": "pinned"}
FREE = {"time": 1.0, "tracer": "free"}
NOTE = (0.3, 1.0, [0.0, 0.0])  # tracer of the note: radius, mass, position
EQUAL = (0.1, 0.4)  # disks of the note's bath


def gas(
    phi,
    *species,
    walls=False,
    tracer=None,
    aspect=1.0,
    corner=(0.0, 0.0),
    placement="random",
    **more,
):
    """A scene of packing fraction phi; species (count, radius, mass), tracer (radius, mass[,
    position]).
    """
    disks = {"placement": placement}
    disks["species"] = [
        {"name": f"species_{k}", "count": count, "radius": radius, "mass": mass}
        for k, (count, radius, mass) in enumerate(species)
    ]
    covered = sum(count * math.pi * radius**2 for count, radius, _ in species)
    if tracer is not None:
        disks["tracer"] = dict(zip(("radius", "mass", "position"), tracer, strict=False))
        covered += math.pi * tracer[0] ** 2
    sides = math.sqrt(covered / phi * aspect), math.sqrt(covered / phi / aspect)
    box = {axis: [low, low + side] for axis, low, side in zip("xy", corner, sides, strict=True)}
    box["boundary"] = "reflecting" if walls else "periodic"
    scene = {"box": box, "disks": disks, "velocities": THERMAL, "duration": 2.0} | more
    return scene if "samples" in scene else {"sample_interval": scene["duration"] / 10} | scene


def note(**more):
    """The note's scene: 150 disks between walls, the tracer in the centre."""
    scene = gas(
        0.14, (149, *EQUAL), walls=True, tracer=NOTE, velocities={"standard_deviation": 2.0}, **more
    )
    return scene | {"box": {"x": [-3.0, 3.0], "y": [-3.0, 3.0], "boundary": "reflecting"}}


def listed(*disks, side=6.0, walls=True, duration=10.0):
    """A scene of explicit disks: (x, y, velocity x, velocity y, radius, mass)."""
    return {
        "box": {
            "x": [0.0, side],
            "y": [0.0, side],
            "boundary": "reflecting" if walls else "periodic",
        },
        "disks": [
            {"position": [x, y], "velocity": [u, v], "radius": r, "mass": m}
            for x, y, u, v, r, m in disks
        ],
        "duration": duration,
        "sample_interval": duration / 10,
    }


def in_units(value, length, mass, time, key=""):
    """A scene with its units of length, mass and time changed by these factors."""
    if isinstance(value, dict):
        return {name: in_units(part, length, mass, time, name) for name, part in value.items()}
    if isinstance(value, list):
        return [in_units(part, length, mass, time, key) for part in value]
    powers = DIMENSIONS.get(key)
    return value * length ** powers[0] * mass ** powers[1] * time ** powers[2] if powers else value


def explicit_cases():
    """Lists of disks: in contact, at walls and corners, at rest, of very different masses, and
    none.
    """
    row = [(1.0 + 0.5 * k, 3.0, 1.0 if k == 0 else 0.0, 0.0, 0.25, 1.0) for k in range(6)]
    grid = [
        (0.5 + i, 0.5 + k, 0.3 * i - 0.1 * k, 0.2 * k - 0.45 * i, 0.3, 1.0 + i)
        for i in range(6)
        for k in range(6)
    ]
    ratio = [
        (1.5, 3.0, 1.0, 0.1, 0.5, 1e100),
        (4.0, 3.1, -0.5, 0.0, 0.5, 1.0),
        (3.0, 5.0, 0.3, -0.2, 0.4, 1e-50),
    ]
    found = {
        "explicit_none": listed(),
        "explicit_head_on": listed((1.0, 3.0, 1.0, 0.0, 0.1, 1.0), (5.0, 3.0, -1.0, 0.0, 0.1, 1.0)),
        "explicit_row_in_contact": listed(*row),
        "explicit_corners": listed(
            (0.5, 0.5, -1.0, -1.0, 0.5, 1.0), (5.5, 5.5, 2.0, 2.0, 0.5, 3.0)
        ),
        "explicit_fills_the_box": listed((3.0, 3.0, 1.0, 2.0, 2.9, 1.0)),
        "explicit_lattice": listed(*grid),
        "explicit_periodic": listed(*grid, walls=False),
        "explicit_at_rest": listed(*[(x, y, 0.0, 0.0, r, m) for x, y, _, _, r, m in grid]),
        "explicit_masses": listed(*ratio),
        "explicit_far_units": in_units(listed(*grid), 1e-30, 1e40, 1e50),
    }
    step, record = {"explicit_far_units": 2e47}, {"explicit_masses": "all"}
    return {
        name: Case(scene, step.get(name, 1e-2), "0", record=record.get(name))
        for name, scene in found.items()
    }


def cases_of(walls):
    """Scenes of species with either boundary."""
    dense = {"walls": walls, "placement": "lattice"}
    tracer, heavy, big = (0.3, 1.0), (0.1, 40.0), (1.5, 100.0)
    light = (50, 0.1, 0.01)
    return {
        "one_disk": Case(gas(0.05, (1, *EQUAL), walls=walls)),
        "two_disks": Case(gas(0.1, (2, *EQUAL), walls=walls, duration=20.0)),
        "phi_0.01": Case(gas(0.01, (200, *EQUAL), walls=walls, duration=20.0), 1e-2),
        "phi_0.14": Case(gas(0.14, (150, *EQUAL), walls=walls, duration=5.0), seeds="3,5,9-10"),
        "phi_0.45_random": Case(gas(0.45, (400, *EQUAL), walls=walls)),
        "phi_0.5": Case(gas(0.5, (1000, *EQUAL), **dense, duration=0.5), seeds="7"),
        "phi_0.65": Case(gas(0.65, (300, *EQUAL), **dense, duration=1.0), 1e-3),
        "phi_0.7": Case(gas(0.7, (500, *EQUAL), **dense, duration=0.5), 5e-4, "0-1"),
        "phi_0.7_many": Case(gas(0.7, (2000, *EQUAL), **dense, duration=0.1), 5e-4, "0"),
        "prefetched": Case(
            gas(0.3, (20_000, *EQUAL), **dense, duration=0.2, sample_interval=0.2), seeds="0"
        ),
        "two_sizes": Case(gas(0.4, (150, 0.1, 0.4), (150, 0.125, 0.4), walls=walls)),
        "two_sizes_dense": Case(
            gas(0.65, (500, 0.1, 0.4), (500, 0.125, 0.4), **dense, duration=0.3), 5e-4, "0"
        ),
        "near_sizes_dense": Case(
            gas(0.65, (200, 0.1, 0.4), (200, 0.105, 0.4), **dense, duration=0.5), 5e-4, "0"
        ),
        "far_apart_sizes": Case(
            gas(0.3, (40, 0.5, 5.0), (400, 0.05, 0.1), walls=walls, duration=1.0), 5e-4, "0-1"
        ),
        "two_masses": Case(gas(0.3, (150, 0.1, 1.0), (150, 0.1, 100.0), walls=walls)),
        "three_species": Case(gas(0.2, (60, 0.1, 0.4), (30, 0.2, 1.6), light, walls=walls), 5e-4),
        "heavy_tracer": Case(gas(0.2, (199, *EQUAL), tracer=heavy, walls=walls, equilibrate=FREE)),
        "pinned_tracer": Case(
            gas(0.14, (149, *EQUAL), tracer=tracer, walls=walls, equilibrate=PINNED)
        ),
        "big_tracer": Case(gas(0.3, (300, *EQUAL), tracer=big, walls=walls, equilibrate=PINNED)),
        "one_much_bigger": Case(
            gas(0.5, (1000, *EQUAL), (1, 2.0, 50.0), walls=walls, duration=0.5), seeds="0"
        ),
        "big_in_small_box": Case(
            gas(0.199, (3, *EQUAL), tracer=(1.2, 100.0), walls=walls, duration=40.0)
        ),
        "few_bigger": Case(gas(0.3, (400, *EQUAL), (3, 0.6, 10.0), walls=walls, duration=1.0)),
        "elongated": Case(gas(0.2, (200, *EQUAL), walls=walls, aspect=40.0)),
        "far_origin": Case(
            gas(0.2, (100, *EQUAL), walls=walls, corner=(1e6, -3e5), duration=4.0), 5e-3
        ),
        "small_units": Case(
            in_units(gas(0.2, (99, *EQUAL), tracer=tracer, walls=walls), 1e-70, 1e-90, 1e-40), 2e-43
        ),
        "large_units": Case(
            in_units(gas(0.2, (99, *EQUAL), tracer=tracer, walls=walls), 1e60, 1e120, 1e-30), 2e-33
        ),
        "zero_momentum": Case(
            gas(0.2, (100, *EQUAL), walls=walls, velocities=THERMAL | {"zero_momentum": True})
        ),
        "at_rest": Case(
            gas(0.2, (50, *EQUAL), tracer=tracer, walls=walls, velocities=AT_REST), 0.1, "0"
        ),
        "logarithmic": Case(
            gas(0.14, (149, *EQUAL), tracer=tracer, walls=walls, samples={"per_decade": 5})
        ),
    }


def all_cases():
    """Every case by its name."""
    found = {
        "note": Case(
            note(duration=1.0, sample_interval=0.01),
            seeds="0-5",
            more=("langevin --friction measured",),
        )
    }
    found |= {f"walls_{name}": case for name, case in cases_of(walls=True).items()}
    found |= {f"periodic_{name}": case for name, case in cases_of(walls=False).items()}
    found |= explicit_cases()
    stationary = {"equilibrate": FREE, "sample_interval": 0.05}
    alike = gas(0.3, (100, *EQUAL), **stationary)
    mixed = gas(0.2, (60, *EQUAL), (20, 0.2, 1.6), tracer=(0.1, 4.0), **stationary)
    between = note(duration=1.0, sample_interval=0.05, equilibrate=PINNED)
    logarithmic, every = found["periodic_logarithmic"].scene, f"--observables {ALL}"
    without_bath = every.replace("bath_velocity_autocorrelation,", "")
    return found | {
        "measured_between_walls": Case(
            between, seeds="0-11", options=every, record="tracer", aggregated=True
        ),
        "measured_over_origins": Case(
            mixed, seeds="0-11", options=f"{every} --average origins", aggregated=True
        ),
        "measured_over_disks": Case(
            alike, seeds="0-7", options=f"{without_bath} --average disks", record="none"
        ),
        "measured_in_walls": Case(
            gas(0.2, (80, *EQUAL), walls=True, **stationary), options=without_bath, record="none"
        ),
        "aggregated_logarithmic": Case(logarithmic, seeds="0-7", record="tracer", aggregated=True),
        "collisions_alone": Case(note(duration=1.0), record="events"),
        "nothing_recorded": Case(note(duration=1.0), record="none"),
        "reported_together": Case(note(duration=1.0), seeds="0-11", record="tracer"),
        "reported_together_periodic": Case(gas(0.14, (100, *EQUAL)), seeds="0-11", record="tracer"),
        "with_checkpoints": Case(
            note(duration=60.0), seeds="0-1", options="--checkpoint-every 1e-6"
        ),
    }


QUICK = ("walls_pinned_tracer", "explicit_periodic", "aggregated_logarithmic")


# -- hashes ----------------------------------------------------------------------------------------


def hashes_of(path):
    """{name of an array: hash} of a trajectory file or dataset; coordinates of trajectory files are
    left out.
    """
    with h5py.File(path) as file:
        return {name: hash_of(item) for name, item in arrays_of(file).items()}


def arrays_of(file):
    """{name: array} of a file."""
    found = {}
    file.visititems(
        lambda path, item: found.update({path: item}) if isinstance(item, h5py.Dataset) else None
    )
    if "runs_digest" not in file.attrs:
        return found
    whole = [path for path in found if path.startswith("disks/") and found[path].ndim == 4]
    events = [path for path in found if path.startswith("events/") and not found[path].is_scale]
    stopped = file["stopped"].asstr()[()] if "stopped" in file else [""] * len(file["seed"])
    arrays = {path: item for path, item in found.items() if "/" not in path and not item.is_scale}
    for column, seed in enumerate(file["seed"][()]):
        if not stopped[column]:
            arrays |= {
                path.replace("disks", f"seed_{seed:05d}"): found[path][:, column] for path in whole
            }
            arrays |= {
                path.replace("events", f"seed_{seed:05d}"): as_logged(path, found[path][column])
                for path in events
            }
    return arrays


def as_logged(path, values):
    """The values of a run's collisions as the engine logs them: NaN stands behind the last one, and
    disks are integers.
    """
    is_collision = ~np.isnan(values if values.ndim == 1 else values[:, 0])
    log = values[is_collision]
    return log.astype(np.int32) if path in ("events/a", "events/b") else log


def hash_of(item):
    """Hash of shape, type and values of an array or dataset."""
    text = h5py.check_string_dtype(item.dtype) is not None
    array = np.asarray(item.asstr()[()] if text else item[()])
    kind = "text" if text else array.dtype.str
    values = json.dumps(array.tolist()).encode() if text else array.tobytes()
    return hashlib.sha256(json.dumps([kind, array.shape]).encode() + values).hexdigest()


def summed_up(found):
    """One short hash of all datasets and their paths."""
    return hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()[:16]


# -- runs ------------------------------------------------------------------------------------------


def call(words):
    """Exit status and messages of the command `brownpipe`, in this process."""
    messages = io.StringIO()
    with redirect_stdout(io.TextIOWrapper(io.BytesIO())), redirect_stderr(messages):
        try:
            return brownpipe(words), messages.getvalue()
        except SystemExit as stop:
            stopped = stop.code
    sys.exit(f"brownpipe {' '.join(words)}: exit status {stopped}\n{messages.getvalue()}")


def words_of(case, engine):
    """The options of `brownpipe simulate` for a case by an engine."""
    name = engine.split()[0]
    step = f" --time-step {case.time_step!r}" if name == "timestep" else ""
    record = case.record or RECORDS[name]
    return f"--seeds {case.seeds} --record {record} --engine {engine}{step} {case.options}".split()


def runs_of(name, case, folder):
    """Simulate a case by all engines, aggregate if it says so; yield name and hashes of each
    file.
    """
    scene = Path(folder) / f"{name}.yaml"
    scene.write_text(json.dumps(case.scene))
    files = []
    for engine in (*ENGINES, *case.more):
        output = Path(folder) / f"{len(files)}.h5"
        status, messages = call(
            ["simulate", str(scene), *words_of(case, engine), "--output", str(output)]
        )
        if status not in (DONE, FAILED, WRONG) or (engine == "exact" and status != DONE):
            sys.exit(f"{name}, {engine}: exit status {status}\n{messages}")
        found = hashes_of(output) if output.exists() else {}
        files += [output] if output.exists() else []
        yield f"{name}, {engine.replace('--', '')}", {STATUS: status} | found
    if case.aggregated:
        output = Path(folder) / "dataset.nc"
        status, messages = call(["aggregate", *map(str, files), "--output", str(output)])
        if status != DONE:
            sys.exit(f"{name}, aggregate: exit status {status}\n{messages}")
        yield f"{name}, aggregate", {STATUS: status} | hashes_of(output)


def run(cases):
    """{case and engine: {dataset: hash}}, printed as they come."""
    found = {}
    for name, case in cases.items():
        with tempfile.TemporaryDirectory() as folder:
            for label, hashes in runs_of(name, case, folder):
                found[label] = hashes
                print(f"{label:<72} {line_of(hashes)}", flush=True)
    return found


def line_of(hashes):
    """What is said of a file."""
    if hashes[STATUS] == WRONG:
        return "refused"
    note = ", runs failed" if hashes[STATUS] == FAILED else ""
    return f"{summed_up(hashes)}, {len(hashes) - 1} datasets{note}"


def differences(before, now):
    """A line for each dataset that differs, by case."""
    for label in before | now:
        if label not in before or label not in now:
            yield f"{label}: {'new' if label in now else 'missing'}"
            continue
        old, new = before[label], now[label]
        lost = {old[path]: path for path in old.keys() - new.keys()}
        for path in sorted(old | new):
            if path not in old:
                same = f", with the contents of {lost[new[path]]}" if new[path] in lost else ""
                yield f"{label}: {path}: new{same}"
            elif old[path] != new.get(path):
                yield f"{label}: {path}: {'differs' if path in new else 'missing'}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="three scenes")
    parser.add_argument("--write", type=Path, metavar="FILE.json", help="keep the hashes")
    parser.add_argument("--compare", type=Path, metavar="FILE.json", help="hashes to compare with")
    given = parser.parse_args()
    before = json.loads(given.compare.read_text()) if given.compare else None
    began, cases = time.process_time(), all_cases()
    found = run({name: cases[name] for name in QUICK} if given.quick else cases)
    print(f"{len(found)} files, {time.process_time() - began:.1f} s of CPU")
    if given.write:
        given.write.write_text(json.dumps(found, indent=0, sort_keys=True) + "\n")
    if before is None:
        return
    if given.quick:
        before = {label: hashes for label, hashes in before.items() if label in found}
    lines = list(differences(before, found))
    print("\n".join([*lines, f"{len(lines)} differences from {given.compare}"]))
    if lines:
        sys.exit(1)


if __name__ == "__main__":
    main()
