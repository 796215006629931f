"""The gallery: every example study in config/ with its purpose, a figure, its command and its cost.

    python docs/_ext/gallery.py CORES      run all studies, and draw their figures for the gallery

Results are in results/STUDY of this folder. Figures of the gallery are in docs/gallery/, reduced to
a width and a number of colours with which they stay below 100 kB, and so is a table of the time
that each study took.
"""

import csv
import io
import resource
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from brownpipe.figures.render import draw as draw_figure
from brownpipe.figures.style import image_bytes
from brownpipe.storage.datasets import read_dataset
from brownpipe.study import Study, read_study
from brownpipe.study.run_sets import describe_workload
from brownpipe.text import in_time
from markdown_text import plain

ROOT = Path(__file__).parents[2]
STUDIES = sorted((ROOT / "config").glob("*.yaml"))
FIGURES = ROOT / "docs" / "gallery"
TIMES = FIGURES / "times.csv"  # study, seconds
SHOWN = {  # the figure that answers the question of a study; otherwise the first one of its figures
    "spreading": "displacement_distribution",
    "diffusion": "diffusion",
}
# studies whose trade-off is shown, each with the scene of which
TRADEOFFS = {"tradeoff": "harrison2020", "tradeoff_pairs": "dense_250"}
ORDER = (
    "harrison2020",
    "small",
    "particle_counts",
    "harrison_start",
    "mass_and_density",
    "spreading",
    "cooling",
    "diffusion",
    "equation_of_state",
    *TRADEOFFS,
)
MOST_BYTES = 100_000
WIDTH, COLOURS = 1000, 64  # pixels; of the palette


def page() -> tuple[str, dict[str, Path]]:
    """Return the page of all studies, and the files that it links."""
    ordered = sorted(
        STUDIES, key=lambda file: ORDER.index(file.stem) if file.stem in ORDER else len(ORDER)
    )
    head = (
        "# Gallery\n\nThe studies in `config/`, each with one of its figures, as drawn by `make "
        "gallery`. The time of a"
        " study is that of its CPUs, on a virtual machine with two cores; the expected workload "
        "is that of"
        " `brownpipe check config/STUDY.yaml`.\n"
    )
    linked = {f"gallery/{file.stem}.png": FIGURES / f"{file.stem}.png" for file in STUDIES}
    linked |= {f"files/config/{file.name}": file for file in STUDIES}
    cards = "".join(map(_card, ordered))
    return "\n".join(
        [head, f"::::{{grid}} 2 3 3 3\n:gutter: 2\n\n{cards}::::\n", *map(_section, ordered)]
    ), linked


def _card(file: Path) -> str:
    """Return the card of a study, which leads to its section."""
    name = file.stem
    return (
        f":::{{grid-item-card}} {name}\n:img-top: gallery/{name}.png\n:link: "
        f"study-{name}\n:link-type: ref\n:::\n"
    )


def _section(file: Path) -> str:
    """Return the section of a study."""
    name, study = file.stem, read_study(file)
    first = file.read_text().partition("\n\n")[0].splitlines()
    purpose = " ".join(
        line.removeprefix("#").strip() for line in first if not line.startswith("#  ")
    )
    figures = ", ".join(f"`{figure}`" for figure in _figures(name, study))
    return (
        f"(study-{name})=\n\n## {name}\n\n{plain(purpose)}\n\n```sh\n{_command(name)}\n```\n\n"
        f"![{_shown(name, study)} of the study {name}](gallery/{name}.png)\n\n"
        f"It took {in_time(times()[name])}. Expected: {plain(describe_workload(study))}. Figures: "
        f"{figures}. The file:"
        f" [config/{file.name}](files/config/{file.name})\n"
    )


def _command(name: str) -> str:
    if name in TRADEOFFS:
        return f"snakemake tradeoff_figures -j2 --configfile config/{name}.yaml"
    return f"brownpipe run config/{name}.yaml"


def _figures(name: str, study: Study) -> Sequence[str]:
    """Return the names of the figures that the command makes."""
    return ["tradeoff"] if name in TRADEOFFS else study.figures


def _shown(name: str, study: Study) -> str:
    """Return the name of the figure of a study that the gallery shows."""
    return SHOWN.get(name, _figures(name, study)[0])


def reduced(png: bytes) -> bytes:
    """Return a picture as wide as the page, in few colours."""
    whole = Image.open(io.BytesIO(png)).convert("RGB")
    size = (WIDTH, round(whole.height * WIDTH / whole.width)) if whole.width > WIDTH else whole.size
    small = whole.resize(size, Image.Resampling.LANCZOS).quantize(COLOURS, dither=Image.Dither.NONE)
    written = io.BytesIO()
    small.save(written, "PNG", optimize=True)
    return written.getvalue()


def times() -> dict[str, float]:
    """Return the CPU time that each study took [s]."""
    return {name: float(seconds) for name, seconds in csv.reader(TIMES.read_text().splitlines())}


def note_time(file: Path, seconds: float) -> None:
    """Enter the CPU time of a study into the table."""
    entered = {**times(), file.stem: seconds}
    TIMES.write_text(
        "".join(f"{name},{seconds:.1f}\n" for name, seconds in sorted(entered.items()))
    )


def draw(file: Path) -> None:
    """Write the figure of a study from its results in this folder; of a trade-off one scene."""
    name = file.stem
    if name in TRADEOFFS:
        dataset = read_dataset(f"results/{name}/tradeoff/{name}.nc")
        figure = draw_figure(dataset.sel(scene=[TRADEOFFS[name]]), "tradeoff")
        png = image_bytes(figure, "png")
    else:
        shown = Path("results", name, "figures", f"{_shown(name, read_study(file))}.png")
        png = shown.read_bytes()
    (FIGURES / f"{name}.png").write_bytes(reduced(png))


def run(file: Path, cores: str) -> float:
    """Run a study in this folder and return its CPU time [s]. What is there already is kept."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    target = ["tradeoff_figures"] if file.stem in TRADEOFFS else []
    files = ["--snakefile", str(ROOT / "Snakefile"), "--configfile", str(file)]
    subprocess.run(["snakemake", *target, *files, "--cores", cores], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    for study_file in STUDIES:
        seconds = run(study_file, sys.argv[1])
        draw(study_file)
        note_time(study_file, seconds)
