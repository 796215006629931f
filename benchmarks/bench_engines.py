"""How the price of the exact engine and of time steps grows with the number of disks, at one packing fraction.

    python benchmarks/bench_engines.py [--most 100000]   writes docs/benchmarks_engines.md and docs/figures/engines.png

Periodic boxes of equal disks, phi = 0.14 as in the note, in units of the note's bath. Seconds of CPU for a unit of
time, without drawing the state: the difference of two durations of the same seeds, median of five, in one process.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np

from brownpipe.engines import Engine
from brownpipe.figures.style import DATA, FIT, drawing, grid, heads, image_bytes, shades
from brownpipe.scene import parse_scene
from brownpipe.timestep import largest_step

ROOT = Path(__file__).parent.parent
DISKS = (150, 1_000, 10_000, 100_000)
PHI = 0.14
SHARES = (1.0, 0.1, 0.01)  # of the largest time step allowed
WORK = 2e6  # disks times steps of a stretch, or collisions, about


def scene_of(n, duration):
    side = math.sqrt(n * math.pi * 0.01 / PHI)
    return parse_scene(
        {
            "box": {"x": [0.0, side], "y": [0.0, side], "boundary": "periodic"},
            "disks": {"species": [{"name": "fluid", "count": n, "radius": 0.1, "mass": 0.4}], "placement": "lattice"},
            "velocities": {"temperature": 1.6},
            "duration": duration,
        },
        "benchmark",
    )


def engines(scene):
    step = largest_step(scene)
    steps = [Engine("timestep", (("time_step", share * step), ("precision", "double"))) for share in SHARES]
    return [Engine("exact"), *steps]


def seconds_of_time(n, engine, shortest, repeats=5):
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


def duration_of(n, engine):
    """A stretch with enough to do, and at least two time steps."""
    step = dict(engine.settings).get("time_step", 0.02)
    return max(2 * step, WORK * step / n)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--most", type=int, default=DISKS[-1], help="disks")
    most = parser.parse_args().most
    sizes = [n for n in DISKS if n <= most]
    names = ["exact", *(f"dt = {share:g} of the largest" for share in SHARES)]
    table = {n: [seconds_of_time(n, one, duration_of(n, one)) for one in engines(scene_of(n, 1.0))] for n in sizes}
    lines = [__doc__.partition("\n")[0], "", "| N | exact, s | " + " | ".join(names[1:]) + " |", "|---" * 5 + "|"]
    for n, (exact, *others) in table.items():
        lines.append(f"| {n:,} | {exact:.3g} | " + " | ".join(f"x {other / exact:.3g}" for other in others) + " |")
    print("\n".join(lines))
    if most == DISKS[-1]:
        (ROOT / "docs" / "benchmarks_engines.md").write_text("\n".join(lines) + "\n")
        (ROOT / "docs" / "figures" / "engines.png").write_bytes(picture(table, names))


def picture(table, names):
    with drawing():
        figure, axes = grid(1, 1, 5.6, 4.0)
        axes = axes[0, 0]
        colours = [DATA, FIT, *shades(len(names) - 2)]
        for k, (name, colour) in enumerate(zip(names, colours, strict=True)):
            axes.plot(list(table), [1e6 * row[k] / n for n, row in table.items()], "o-", color=colour, label=name)
        axes.set(xscale="log", ylim=(0, None), xlabel="number of disks N")
        axes.set_ylabel("CPU time per disk and unit of time ($\\mu$s)")
        heads([axes], ["Price of a unit of time"])
        return image_bytes(figure, "png")


if __name__ == "__main__":
    main()
