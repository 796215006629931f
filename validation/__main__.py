"""Reproduce published results: run their studies, compare, draw, and write the tables of
docs/validation.md.

    python -m validation                     all of them
    python -m validation virial --cores 1    one of them

The studies are those of `config/validation`, with results in `results/`; what is there already is
kept. The exit status is 1 if a value differs from a published one by more than three standard
errors and no remark explains it.
"""

import argparse
import resource
import subprocess
from collections.abc import Sequence
from os import cpu_count
from pathlib import Path

from xarray import Dataset

from brownpipe.figures.style import drawing, image_bytes
from brownpipe.storage.datasets import read_dataset
from brownpipe.storage.trajectories import read_trajectories, to_tree
from brownpipe.study import read_study
from brownpipe.study.run_sets import files_of
from validation.catalogue import RESULTS
from validation.comparison import Comparison
from validation.page import closing, table, with_table
from validation.result import Result
from validation.single_runs import single_runs

ROOT = Path(__file__).parent.parent
STUDIES = ROOT / "config" / "validation"
PAGE = ROOT / "docs" / "validation.md"
FIGURES = ROOT / "docs" / "figures"


def reproduce(result: Result, cores: int) -> Sequence[Comparison]:
    """Run the studies of a result; write its table and its figure; return its comparisons."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    for study in result.studies:
        options = [
            "--snakefile",
            str(ROOT / "Snakefile"),
            "--cores",
            str(cores),
            "--configfile",
            str(_file(study)),
        ]
        subprocess.run(["snakemake", *options], check=True)
    datasets = {
        study: read_dataset(f"results/{study}/aggregate/{study}.nc") for study in result.studies
    }
    if result.of_single_runs:
        datasets |= {
            name: runs for study in result.studies for name, runs in _single_runs(study).items()
        }
    comparisons = result.compare(datasets)
    seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    PAGE.write_text(with_table(PAGE.read_text(), result.name, comparisons, seconds))
    with drawing():
        (FIGURES / f"validation_{result.name}.png").write_bytes(
            image_bytes(result.draw(datasets, comparisons), "png")
        )
    print(f"\n{result.name}\n\n{table(comparisons)}\n{closing(comparisons, seconds)}\n", flush=True)
    return comparisons


def _single_runs(study: str) -> dict[str, Dataset]:
    files = files_of(read_study(_file(study)))
    return single_runs(study, (to_tree(read_trajectories(file.path)) for file in files))


def _file(study: str) -> Path:
    return STUDIES / f"{study}.yaml"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "results", metavar="NAME", nargs="*", help=f"of {', '.join(RESULTS)}; default: all"
    )
    parser.add_argument("--cores", type=int, default=cpu_count())
    options = parser.parse_args()
    if unknown := set(options.results) - set(RESULTS):
        parser.error(f"{', '.join(sorted(unknown))}: must be of {', '.join(RESULTS)}")
    comparisons = [
        one
        for name in options.results or RESULTS
        for one in reproduce(RESULTS[name], options.cores)
    ]
    unexplained = [one for one in comparisons if one.is_at_odds and not one.remark]
    for one in unexplained:
        print(
            f"{one.quantity}: {one.ours:.6g} differs from {one.published:.6g} by {one.z:+.1f} "
            "standard errors"
        )
    raise SystemExit(bool(unexplained))


if __name__ == "__main__":
    main()
