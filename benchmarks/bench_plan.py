"""Does a plan come true? Plans three studies, runs them as planned, and compares error and CPU time with what was said.

    python benchmarks/bench_plan.py
    python benchmarks/bench_plan.py --quick     one of them, with a loose tolerance

The error achieved is the relative standard error of MSD(end) over the runs; if the engine chosen is an approximate one,
its bias as the plan has it joins. The CPU time is that of `brownpipe simulate`, all jobs, start-up and files included.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from bench_study import timed

from brownpipe import tradeoff
from brownpipe.analysis.runs import groups_of
from brownpipe.study import performance, read_study, writing
from brownpipe.study.offers import offers

ROOT = Path(__file__).parent.parent
SCENES = (("harrison2020", 0.02), ("heavy", 0.05), ("dense", 0.08))  # and the tolerances of MSD(end)
QUICK = (("harrison2020", 0.3),)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="one of them, with a loose tolerance")
    quick = parser.parse_args().quick
    print(
        "| scene | tolerance | engine | runs | error planned | achieved | ratio | CPU planned, s | taken, s | ratio |"
    )
    print("|---" * 10 + "|")
    for scene, tolerance in QUICK if quick else SCENES:
        with tempfile.TemporaryDirectory() as folder:
            words = [sys.executable, "-m", "brownpipe", "simulate", f"{ROOT}/config/scenes/{scene}.yaml"]
            subprocess.run([*words, "--output", f"{folder}/first/run.h5"], check=True)  # compiles, if need be
            print(row(scene, tolerance, Path(folder)), flush=True)


def row(scene, tolerance, folder):
    study = folder / "study.yaml"
    study.write_text(f"scenes: {ROOT / 'config' / 'scenes' / scene}.yaml\ntolerance: {tolerance}\n")
    (case,) = performance.performance_of(read_study(study), "msd", folder)
    chosen, file = offers([case], tolerance, None)[0], folder / "planned.yaml"
    mapping = writing.derived_study(study, file, chosen.engine, chosen.runs)
    writing.write_yaml(file, mapping, "planned")
    planned, taken = read_study(file), 0.0
    for job in planned.jobs():
        words = [f"{ROOT / 'config' / 'scenes' / job.scene}.yaml", "--seeds", f"{job.first}-{job.last}"]
        words += ["--engine", *chosen.engine.options.split(), "--output", str(folder / f"{job.first}.h5")]
        taken += timed([sys.executable, "-m", "brownpipe", "simulate", *words])[1]
    (runs,) = tradeoff.read_runs(groups_of(folder.glob("*.h5")))
    scatter = tradeoff.spread_of(runs, "msd", (0.0, runs.times[-1])) / np.sqrt(len(runs.seeds))
    achieved = float(np.hypot(scatter, np.sqrt(case.engines[chosen.engine].bias_square)))
    first = f"| {scene} | {tolerance} | {chosen.engine.label} | {chosen.runs} | {chosen.error:.4f} | {achieved:.4f} "
    ratios = f"| {achieved / chosen.error:.2f} | {chosen.seconds:.2f} | {taken:.2f} | {taken / chosen.seconds:.2f} |"
    return first + ratios


if __name__ == "__main__":
    main()
