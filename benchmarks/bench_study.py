"""Where the time of a study goes: run it from nothing with compiled kernels, and say what took how long.

    python benchmarks/bench_study.py [STUDY.yaml] [--cores 2] [--config batch=600]
    python benchmarks/bench_study.py --quick     a study of 40 runs in one box

Prints a table in Markdown. Wall times of jobs are those of Snakemake's benchmark files; they overlap on several cores.
"""

import argparse
import csv
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
SCENE = ROOT / "config" / "scenes" / "harrison2020.yaml"
QUICK = f"scenes: {SCENE}\nparticles: 20\nseeds: 40\nbatch: 40\nfigures: [health]\n"
ENVIRONMENT = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("study", nargs="?", default=ROOT / "config" / "harrison2020.yaml", type=Path)
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--config", nargs="*", default=[], metavar="KEY=VALUE", help="replaced keys of the study")
    parser.add_argument("--quick", action="store_true", help="a study of 40 runs in one box")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if given.quick:
            given.study = Path(folder) / "quick.yaml"
            given.study.write_text(QUICK)
        one = ["brownpipe", "simulate", SCENE, "--output", f"{folder}/one.h5"]
        for _ in range(1 if given.quick else 2):  # the first one compiles the kernels, if need be
            start, start_cpu = timed(one)
        words = ["--directory", folder, "--configfile", given.study, "--cores", given.cores]
        words += ["--config", *given.config] if given.config else []
        wall, cpu = timed(["snakemake", "--snakefile", ROOT / "Snakefile", *words])
        idle, _ = timed(["snakemake", "--snakefile", ROOT / "Snakefile", *words])
        print(table(Path(folder), wall, cpu, start, start_cpu, idle, given.cores))


def timed(words):
    """Wall and CPU seconds of a command."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([str(word) for word in words], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(done.stdout + done.stderr)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def table(folder, wall, cpu, start, start_cpu, idle, cores):
    steps = {step: seconds(folder, step) for step in ("simulate", "aggregate", "figures")}
    jobs = len(steps["simulate"])
    rows = [
        ("the whole study", 1, wall),
        ("snakemake alone: start, plan, find nothing to do", 1, idle),
        (f"`simulate`, jobs on {cores} cores", jobs, sum(steps["simulate"])),
        ("- of which starting processes", jobs, jobs * start),
        ("- of which runs and their files", jobs, sum(steps["simulate"]) - jobs * start),
        ("`aggregate`", 1, sum(steps["aggregate"])),
        ("`figures`", 1, sum(steps["figures"])),
    ]
    lines = [
        f"{machine()}, {cores} cores; {cpu:.1f} s of CPU in all; a process starts in {start_cpu:.2f} s of CPU.",
        "",
    ]
    lines += ["| what | jobs | wall time, s |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {what} | {count} | {each:.1f} |" for what, count, each in rows)])


def seconds(folder, step):
    """Wall time of every job of a step."""
    files = sorted(folder.glob(f"results/*/benchmarks/{step}/**/*.tsv"))
    return [float(row["s"]) for file in files for row in csv.DictReader(file.read_text().splitlines(), delimiter="\t")]


def machine():
    names = [line.partition(": ")[2] for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line]
    return names[0] if names else platform.machine()


if __name__ == "__main__":
    main()
