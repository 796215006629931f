"""Cost of the exact engine and of time steps against the number of disks.

    python benchmarks/bench_engines.py [--most 100000]   writes its section of docs/benchmarks.md
    and its figure python benchmarks/bench_engines.py --quick            one small box, nothing
    written

Periodic boxes of equal disks, phi = 0.14 as in the note, in units of the note's bath. Seconds of
CPU for a unit of time, without drawing the state: the difference of two durations of the same
seeds, median of five, in one process.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np
from bench_exact import processor, write

from brownpipe.engines import Engine
from brownpipe.engines.timestep import largest_step
from brownpipe.figures.style import (
    DATA,
    FIT,
    drawing,
    grid,
    image_bytes,
    put_titles_and_legends,
    shades,
)
from brownpipe.scene import parse_scene

ROOT = Path(__file__).parent.parent
DISKS = (150, 1_000, 10_000, 100_000)
PHI = 0.14
SHARES = (1.0, 0.1, 0.01)  # of the largest time step allowed
WORK = 2e6  # disks times steps of a stretch, or collisions, about
QUICK = 1e5  # of them in a quick pass
HEAD = """One core of an {}. Periodic boxes of equal disks, packing fraction 0.14: CPU time for the
note's unit of time by the exact engine, and the cost of time steps relative to it, medians of five,
without drawing and reports. Steps are fractions of the largest step allowed."""


def scene_of(n, duration):
    side = math.sqrt(n * math.pi * 0.01 / PHI)
    return parse_scene(
        {
            "box": {"x": [0.0, side], "y": [0.0, side], "boundary": "periodic"},
            "disks": {
                "species": [{"name": "fluid", "count": n, "radius": 0.1, "mass": 0.4}],
                "placement": "lattice",
            },
            "velocities": {"temperature": 1.6},
            "duration": duration,
        },
        "benchmark",
    )


def engines(scene):
    step = largest_step(scene)
    steps = [Engine("timestep", (("time_step", share * step),)) for share in SHARES]
    return [Engine("exact"), *steps]


def seconds_of_time(n, engine, shortest, repeats):
    """CPU seconds for a unit of the scene's time."""
    short, long = scene_of(n, shortest), scene_of(n, 4 * shortest)
    engine.simulate(short, [0], frozenset({"tracer"}))
    taken = []
    for seed in range(repeats):
        times = []
        for scene in (short, long):
            begun = time.process_time()
            engine.simulate(scene, [seed], frozenset({"tracer"}))
            times.append(time.process_time() - begun)
        taken.append((times[1] - times[0]) / (3 * shortest))
    return float(np.median(taken))


def duration_of(n, engine, work):
    """A stretch with so much to do, and at least two time steps."""
    step = dict(engine.settings).get("time_step", 0.02)
    return max(2 * step, work * step / n)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--most", type=int, default=DISKS[-1], help="disks")
    parser.add_argument("--quick", action="store_true", help="one small box, nothing written")
    given = parser.parse_args()
    sizes = DISKS[:1] if given.quick else [n for n in DISKS if n <= given.most]
    work, repeats = (QUICK, 1) if given.quick else (WORK, 5)
    names = ["exact", *(f"dt = {share:g} of the largest" for share in SHARES)]
    table = {n: [] for n in sizes}
    for n, row in table.items():
        row += [
            seconds_of_time(n, one, duration_of(n, one, work), repeats)
            for one in engines(scene_of(n, 1.0))
        ]
    lines = [
        HEAD.format(processor()),
        "",
        "| N | exact, s | " + " | ".join(names[1:]) + " |",
        "|---" * 5 + "|",
    ]
    for n, (exact, *others) in table.items():
        lines.append(
            f"| {n:,} | {exact:.3g} | "
            + " | ".join(f"x {other / exact:.3g}" for other in others)
            + " |"
        )
    print("\n".join(lines))
    drawn = picture(table, names)
    if DISKS[-1] in sizes:
        write("engines", "\n".join(lines))
        (ROOT / "docs" / "figures" / "engines.png").write_bytes(drawn)


def picture(table, names):
    with drawing():
        figure, ((axes,),) = grid(1, 1, 5.6, 4.0)
        colours = [DATA, FIT, *shades(len(names) - 2)]
        for k, (name, colour) in enumerate(zip(names, colours, strict=True)):
            axes.plot(
                list(table),
                [1e6 * row[k] / n for n, row in table.items()],
                "o-",
                color=colour,
                label=name,
            )
        axes.set(xscale="log", ylim=(0, None), xlabel="number of disks N")
        axes.set_ylabel("CPU time per disk and unit of time ($\\mu$s)")
        put_titles_and_legends([axes], ["Cost of a unit of time"])
        return image_bytes(figure, "png")


if __name__ == "__main__":
    main()
