"""How fast the exact engine is: pair collisions per CPU second, and bytes per disk, against N and packing fraction.

    make bench                      writes docs/benchmarks.md
    python benchmarks/bench_exact.py --quick

Every figure is the median of five stretches of one run that was melted before, in CPU time of one core. Compare figures
of one table with each other: machines differ, and a busy one has less cache to itself.
"""

import argparse
import math
import platform
import time
from pathlib import Path

import numpy as np

from brownpipe import exact
from brownpipe.exact import workspace as ws
from brownpipe.exact.events import advance
from brownpipe.exact.recording import recorder
from brownpipe.exact.setup import fill
from brownpipe.scene import parse_scene, read_scene
from brownpipe.state import draw

ROOT = Path(__file__).parent.parent
FOR_EVER = np.array([1e9])
CASES = [
    (n, phi, boundary, kinds)
    for boundary, kinds in (("periodic", "equal"), ("reflecting", "equal"), ("periodic", "two masses"))
    for n in (1_000, 10_000, 100_000, 1_000_000)
    for phi in (0.14, 0.5, 0.7)
    if n < 1_000_000 or (boundary, kinds) == ("periodic", "equal")
]


def scene_of(n, phi, boundary, kinds):
    """A scene of n disks of diameter 1 and kT = 1."""
    side = math.sqrt(n * math.pi / 4 / phi) + (boundary == "reflecting")
    masses = [1.0] if kinds == "equal" else [1.0, 2.0]
    species = [{"name": f"m{mass:g}", "count": n // len(masses), "radius": 0.5, "mass": mass} for mass in masses]
    return parse_scene(
        {
            "box": {"x": [0.0, side], "y": [0.0, side], "boundary": boundary},
            "disks": {"species": species, "placement": "lattice"},
            "velocities": {"temperature": 1.0},
            "duration": FOR_EVER[0],
        },
        "benchmark",
    )


def collisions_per_second(scene, stretches=5):
    """Median over stretches of pair collisions per CPU second, and the bytes of the workspace per disk."""
    engine = exact.prepared(scene)
    w, room = engine.workspace, recorder(engine.frame, engine.workspace, FOR_EVER, ())
    fill(w, draw(scene, 0), engine.frame)
    events = max(300_000, 4 * scene.particles)
    advance(w, room, 3 * events)
    rates = []
    for _ in range(stretches):
        done, begun = w.count[ws.PAIRS], time.process_time()
        advance(w, room, events)
        rates.append((w.count[ws.PAIRS] - done) / (time.process_time() - begun))
    arrays = [array for array in (*w, *(w.big or ())) if isinstance(array, np.ndarray)]
    return float(np.median(rates)), sum(array.nbytes for array in arrays) / scene.particles


def milliseconds_per_run(scene, runs=400, repeats=5):
    """Median CPU time of a run of the note's scene: the engine alone, and with drawing, sampling and reporting."""
    engine, states = exact.prepared(scene), [draw(scene, seed) for seed in range(runs)]
    w, room = engine.workspace, recorder(engine.frame, engine.workspace, scene.times, ())
    alone, whole, pairs = [], [], 0
    for _ in range(repeats):
        begun = time.process_time()
        for state in states:
            fill(w, state, engine.frame)
            advance(w, room, 10**9)
        alone.append((time.process_time() - begun) / runs * 1e3)
        begun = time.process_time()
        pairs = exact.simulate(scene, range(runs)).observables["pair_collisions"].mean()
        whole.append((time.process_time() - begun) / runs * 1e3)
    return float(np.median(alone)), float(np.median(whole)), pairs


def processor():
    """The name of the processor."""
    for line in Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else ():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def report(quick):
    """The results as Markdown, a line at a time."""
    yield f"# Speed of the exact engine\n\nOne core of an {processor()}; made by `make bench`.\n"
    alone, whole, pairs = milliseconds_per_run(read_scene(ROOT / "config/scenes/harrison2020.yaml"))
    yield (
        f"The note's scene (N = 150, t = 1): {alone:.3f} ms of CPU a run for the engine, {pairs / alone / 1e3:.2f} "
        f"million pair collisions a second; {whole:.3f} ms with drawing the state and reporting.\n"
    )
    yield "| N | phi | box | disks | million pair collisions per CPU second | bytes per disk |"
    yield "|---|---|---|---|---|---|"
    for case in CASES[:2] if quick else CASES:
        rate, size = collisions_per_second(scene_of(*case))
        n, phi, boundary, kinds = case
        yield f"| {n} | {phi} | {boundary} | {kinds} | {rate / 1e6:.2f} | {size:.0f} |"


def main():
    """Print the table, and keep it unless it is a quick one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two cases only, nothing written")
    quick = parser.parse_args().quick
    lines = []
    for line in report(quick):
        print(line, flush=True)
        lines.append(line)
    if not quick:
        (ROOT / "docs").mkdir(exist_ok=True)
        (ROOT / "docs" / "benchmarks.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
