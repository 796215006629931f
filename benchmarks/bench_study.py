"""Where the time of a study goes: run it from nothing with compiled kernels, and say what took how long.

Beside it is the forecast of each step, and the memory of its jobs beside what they ask a cluster for.

    python benchmarks/bench_study.py [STUDY.yaml] [--cores 2] [--config seeds=100000]
    python benchmarks/bench_study.py --quick     a study of 40 runs in one box

Prints a table in Markdown. Wall times of jobs are those of Snakemake's benchmark files; they overlap on several cores.
"""

import argparse
import contextlib
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_exact import processor

from brownpipe.study import from_command_line, read_study
from brownpipe.study.resources import used

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
    given.study = given.study.resolve()
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
        study = read_study(given.study, from_command_line(dict(word.split("=", 1) for word in given.config)))
        with contextlib.chdir(folder):
            jobs = list(used(study))
        print(table(jobs, wall, cpu, start, start_cpu, idle, given.cores))


def timed(words):
    """Wall and CPU seconds of a command."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([str(word) for word in words], env=ENVIRONMENT, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(done.stdout + done.stderr)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def table(jobs, wall, cpu, start, start_cpu, idle, cores):
    lines = [
        f"{processor()}, {cores} cores; {cpu:.1f} s of CPU in all; a process starts in {start_cpu:.2f} s of CPU.",
        "",
        "| what | jobs | wall time, s | forecast, s of CPU | memory of a job, MB | asked for, MB |",
        "|---|---|---|---|---|---|",
        f"| the whole study | 1 | {wall:.1f} | | | |",
        f"| snakemake alone: start, plan, find nothing to do | 1 | {idle:.1f} | | | |",
    ]
    for step in ("simulate", "replay", "aggregate", "figures"):
        measured = [job for job in jobs if job.job.startswith(f"{step}/")]
        if measured:
            lines.append(row(f"`{step}`", measured))
        if measured and step == "simulate":
            lines.append(f"| - of which starting processes | {len(measured)} | {len(measured) * start:.1f} | | | |")
    return "\n".join(lines)


def row(what, jobs):
    """Times of all jobs of a step together, memory of the job that came nearest to its request."""
    took, forecast = sum(job.seconds for job in jobs), sum(job.need.seconds for job in jobs)
    largest = max(jobs, key=lambda job: job.memory / job.need.megabytes())
    memory, asked = largest.memory / 1e6, largest.need.megabytes()
    return f"| {what} | {len(jobs)} | {took:.1f} | {forecast:.1f} | {memory:.0f} | {asked} |"


if __name__ == "__main__":
    main()
