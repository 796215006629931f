"""What averages over time origins cost and how far they are from plain sums, as a table.

    python benchmarks/bench_origins.py             writes its section of docs/benchmarks.md
    python benchmarks/bench_origins.py --quick     short runs

CPU time of one core, of a made-up run of T samples of a tracer whose velocity is forgotten after
100 samples: far from its origin at the end, and near it in the first lags. Plain sums are timed at
some lags; the time of all is in proportion to their pairs. The difference is the largest one, at
some lags, from plain sums in extended precision, relative to the product of the root mean squares
of its factors (of the sum itself for powers of the displacement).
"""

import argparse
import time
from functools import partial

import numpy as np
from bench_exact import processor, write

from brownpipe.observables import observe
from brownpipe.observables.trajectory import Run, Track
from brownpipe.scene import parse_scene

LENGTHS = (200, 2_000, 20_000, 200_000)
QUICK_LENGTHS = (200, 2_000)
FORGOTTEN_AFTER = 100  # samples
COMPARED = 60  # lags, besides the first and the last of them
BOX = {"x": [0.0, 4.0], "y": [0.0, 5.0], "boundary": "periodic"}
OBSERVABLES = {
    "square_displacement": ("square_displacement", "displacement_velocity"),
    "velocity_autocorrelation": ("velocity_autocorrelation", "velocity_displacement"),
    "quartic_displacement": ("quartic_displacement",),
}


def scene_of(samples):
    """A scene of a disk in a periodic box with so many sample times, 0.01 apart."""
    disk = {"name": "gas", "count": 1, "radius": 0.1, "mass": 1.0}
    mapping = {
        "box": BOX,
        "disks": {"species": [disk]},
        "velocities": {"temperature": 1.0},
        "equilibrate": {"time": 1.0, "tracer": "free"},
        "duration": (samples - 1) / 100,
        "sample_interval": 0.01,
    }
    return parse_scene(mapping, "benchmark")


def path_of(scene):
    """Unwrapped positions and velocities (T, 2), of an Ornstein-Uhlenbeck process."""
    rng = np.random.default_rng(len(scene.times))
    noise = rng.normal(size=(len(scene.times), 2))
    kept = 1 - 1 / FORGOTTEN_AFTER
    noise[1:] *= np.sqrt(1 - kept**2)
    velocity = noise
    for k in range(1, len(velocity)):
        velocity[k] += kept * velocity[k - 1]
    position = scene.sample_interval * np.cumsum(velocity, axis=0)
    return position, velocity


def run_of(scene, position, velocity):
    """The run whose tracer takes this path, in its box."""
    size = np.array([scene.box.width, scene.box.height])
    image = np.floor(position / size)
    inside = position - image * size
    track = Track(inside[:, None], velocity[:, None], image.astype(np.int32)[:, None])
    return Run(track, track)


def plain_sums(position, velocity, lag):
    """Each array at a lag and what its difference is relative to, as sums over all pairs."""
    r = position[lag:] - position[: len(position) - lag]
    earlier = velocity[: len(velocity) - lag]
    later = velocity[lag:]
    square = (r**2).sum(axis=1)
    speed = np.sqrt((velocity**2).sum(axis=1).mean())
    length = np.sqrt(square.mean())
    return {
        "square_displacement": (square.mean(), square.mean()),
        "quartic_displacement": ((square**2).mean(), (square**2).mean()),
        "displacement_velocity": ((r * later).sum(axis=1).mean(), length * speed),
        "velocity_displacement": ((r * earlier).sum(axis=1).mean(), length * speed),
        "velocity_autocorrelation": ((earlier * later).sum(axis=1).mean(), speed**2),
    }


def seconds(call):
    """CPU time of a call, the least of three."""
    spent = []
    for _ in range(3):
        begun = time.process_time()
        call()
        spent.append(time.process_time() - begun)
    return min(spent)


def table(lengths):
    """Yield the lines of the table."""
    yield "| samples | observable | plain sums, s | s | largest difference |"
    yield "|---|---|---|---|---|"
    for length in lengths:
        scene = scene_of(length)
        position, velocity = path_of(scene)
        run = run_of(scene, position, velocity)
        exact_position = run.tracer.position[:, 0].astype(np.longdouble) + run.tracer.image[
            :, 0
        ].astype(np.longdouble) * [scene.box.width, scene.box.height]
        exact_velocity = velocity.astype(np.longdouble)
        some = np.geomspace(1, length - 1, COMPARED).astype(int)
        lags = np.unique([*some, *(length - some)])
        expected = {lag: plain_sums(exact_position, exact_velocity, lag) for lag in lags}
        for name, arrays in OBSERVABLES.items():
            measure = partial(observe, scene, run, (name,), "origins")
            found = measure()
            spent = seconds(measure)
            plain = seconds_of_plain_sums(name, scene, run, lags)
            differences = []
            for array in arrays:
                for lag in lags:
                    value, scale = expected[lag][array]
                    differences.append(abs(found[array][lag] - value) / scale)
            yield f"| {length:,} | `{name}` | {plain:.2g} | {spent:.2g} | {max(differences):.0e} |"


def seconds_of_plain_sums(name, scene, run, lags):
    """CPU time of the sums over the pairs at all lags, from those at some."""
    from brownpipe.observables import displacement, velocity
    from brownpipe.observables.averages import Pairs

    products = {
        "square_displacement": (*displacement.SQUARES, displacement.GROWTH),
        "velocity_autocorrelation": (velocity.VELOCITY_PRODUCT, velocity.VELOCITY_DISPLACEMENT),
        "quartic_displacement": (displacement.QUARTIC,),
    }[name]
    size = (scene.box.width, scene.box.height)
    count = len(scene.times)

    def at_some_lags():
        for lag in lags:
            pairs = Pairs(run.tracer, size, slice(0, count - lag), slice(lag, count))
            for product in products:
                product.values(pairs).mean()

    begun = time.process_time()
    at_some_lags()
    spent = time.process_time() - begun
    return spent * count * (count + 1) / 2 / np.sum(count - lags)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="short runs")
    quick = parser.parse_args().quick
    lines = [f"One core of an {processor()}.", ""]
    for line in table(QUICK_LENGTHS if quick else LENGTHS):
        print(line, flush=True)
        lines.append(line)
    if not quick:
        write("origins", "\n".join(lines))


if __name__ == "__main__":
    main()
