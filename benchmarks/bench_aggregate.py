"""What the analysis of many runs takes: memory must not grow with their number.

    python benchmarks/bench_aggregate.py [--seeds 100000] [--samples 100] [--batch 2400]
    python benchmarks/bench_aggregate.py --quick     200 seeds of 10 samples in two files

Writes trajectory files of free diffusers into a temporary folder, aggregates them in a process of its own, and prints
what that took.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from brownpipe.engines import Engine
from brownpipe.engines.state import Ensemble, Track
from brownpipe.scene import parse_scene
from brownpipe.storage import write_trajectories

DIFFUSION = 0.25
COUNTS = {"pair_collisions": 80, "wall_collisions": 30, "tracer_collisions": 9}
HEALTH = ("energy_drift", "worst_overlap", "momentum_residual")
SCENE = {
    "box": {"x": [-3.0, 3.0], "y": [-3.0, 3.0]},
    "disks": {"tracer": {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]}},
    "velocities": {"standard_deviation": 2.0},
    "duration": 1.0,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=100_000)
    parser.add_argument("--samples", type=int, default=100)
    parser.add_argument("--batch", type=int, default=2400, help="seeds in a file")
    parser.add_argument("--quick", action="store_true", help="200 seeds of 10 samples in two files")
    given = parser.parse_args()
    if given.quick:
        given.seeds, given.samples, given.batch = 200, 10, 100
    scene = parse_scene(SCENE | {"sample_interval": 1.0 / given.samples}, "diffusers.yaml")
    with tempfile.TemporaryDirectory() as folder:
        starts = range(0, given.seeds, given.batch)
        paths = [write(folder, scene, np.arange(a, min(a + given.batch, given.seeds))) for a in starts]
        size = sum(path.stat().st_size for path in paths)
        begin, code = time.perf_counter(), "import sys; from brownpipe.cli import main; sys.exit(main(sys.argv[1:]))"
        words = ["aggregate", *paths, "--output", f"{folder}/out.nc", "--displacement-times", "0.5", "1"]
        subprocess.run([sys.executable, "-c", code, *map(str, words)], check=True)
        took, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begin
        print(f"{given.seeds} seeds x {given.samples} samples in {len(paths)} files, {size / 2**20:.0f} MiB:")
        cpu = took.ru_utime + took.ru_stime
        print(f"peak memory {took.ru_maxrss / 2**10:.0f} MiB, {cpu:.1f} s of CPU, {wall:.1f} s")


def write(folder, scene, seeds):
    """A trajectory file of free diffusers, positions to single precision: they pack better."""
    rng, shape = np.random.default_rng(int(seeds[0])), (len(scene.times), len(seeds), 2)
    steps = np.sqrt(2 * DIFFUSION * np.diff(scene.times, prepend=0.0))[:, None, None] * rng.standard_normal(shape)
    position = steps.cumsum(axis=0).astype(np.float32).astype(float)
    observables = {name: rng.poisson(mean, len(seeds)) for name, mean in COUNTS.items()}
    observables |= {name: rng.normal(0, 1e-15, len(seeds)) for name in HEALTH}
    observables["failed"] = np.zeros(len(seeds), np.uint8)
    path = Path(folder) / f"{seeds[0]}.h5"
    write_trajectories(path, scene, Engine("exact"), Ensemble(seeds, scene.times, Track(position), observables, {}, {}))
    return path


if __name__ == "__main__":
    main()
