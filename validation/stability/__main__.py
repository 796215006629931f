"""Show the numerical stability: run the experiments, draw, and write the tables of
docs/stability.md.

    python -m validation.stability              all of them
    python -m validation.stability pi_digits    one of them
    python -m validation.stability --large      1e9 events, nine digits of pi

The exit status is 1 if brownpipe breaks a promise.
"""

import argparse
import time
from io import BytesIO
from pathlib import Path

from PIL import Image

from brownpipe.figures.style import drawing, image_bytes
from brownpipe.text import in_time
from validation.page import with_text
from validation.stability.catalogue import EXPERIMENTS, Experiment
from validation.stability.table import Row, table

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "stability.md"
FIGURES = ROOT / "docs" / "figures"


def show(experiment: Experiment, is_large: bool) -> list[Row]:
    """Run an experiment, write its table and its figure; return its rows."""
    began = time.process_time()
    found = experiment.module.measure(**(experiment.large if is_large else {}))
    rows: list[Row] = experiment.module.rows(found)
    text = f"{table(rows)}\nThis took {in_time(time.process_time() - began)} of CPU time."
    print(f"\n{experiment.name}\n\n{text}\n", flush=True)
    PAGE.write_text(with_text(PAGE.read_text(), experiment.name, f"{text}\n\n"))
    with drawing():
        image = image_bytes(experiment.module.draw(found), "png")
    _in_few_colours(image).save(FIGURES / f"stability_{experiment.name}.png", optimize=True)
    return rows


def _in_few_colours(png: bytes) -> Image.Image:
    """Return a picture with 64 colours: a file of a third of the size."""
    return Image.open(BytesIO(png)).convert("RGB").quantize(64, dither=Image.Dither.NONE)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "experiments", metavar="NAME", nargs="*", help=f"of {', '.join(EXPERIMENTS)}; default: all"
    )
    parser.add_argument(
        "--large", action="store_true", help="runs some ten times as long, where there are any"
    )
    options = parser.parse_args()
    if unknown := set(options.experiments) - set(EXPERIMENTS):
        parser.error(f"{', '.join(sorted(unknown))}: must be of {', '.join(EXPERIMENTS)}")
    rows = [
        row
        for name in options.experiments or EXPERIMENTS
        for row in show(EXPERIMENTS[name], options.large)
    ]
    broken = [row for row in rows if not row.is_kept]
    for row in broken:
        print(f"{row.experiment}: promised {row.promised}, found {row.cells[0]}")
    raise SystemExit(bool(broken))


if __name__ == "__main__":
    main()
