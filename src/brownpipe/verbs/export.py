"""`brownpipe export`: trajectories for other programs."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import DONE
from brownpipe.formatting import counted, in_bytes
from brownpipe.verbs.output import say, show, writable
from brownpipe.verbs.values import add_seed

EXAMPLE = "seed17.h5 --to gsd"


def add_arguments(add: Callable) -> None:
    from brownpipe.storage.export import FORMATS

    add("file", metavar="FILE.h5", help="trajectory file with whole runs (simulate --record all); for csv, any")
    add("--to", required=True, choices=FORMATS, metavar="FORMAT", help="gsd, xyz (extended XYZ) or csv")
    add_seed(add, "the run to export (default: the first in the file; csv: all)")
    add("--output", metavar="FILE", help="*.gsd, *.xyz or *.csv (default: name of the file, in this folder)")


def export(arguments: Namespace) -> None:
    """Export a run to GSD (HOOMD-blue, freud, MDAnalysis, OVITO), extended XYZ (ASE, OVITO, VMD) or a table (CSV).

    The file must have been recorded with `--record all`. Without whole runs, CSV has the tracers of all runs.
    GSD has single precision and the centre of the box at the origin, and needs the package gsd; XYZ and CSV have every
    digit. Unwrapped positions in a periodic box are position + image * (width, height).
    """
    from brownpipe.scene.seeds import seed_text
    from brownpipe.storage import read_trajectories
    from brownpipe.storage.export import export as exported

    kind = f".{arguments.to}"
    output = writable(arguments.output or f"{Path(arguments.file).stem}{kind}", arguments.file, suffixes=(kind,))
    written = exported(read_trajectories(arguments.file), arguments.file, output, arguments.to, arguments.seed)
    for remark in written.remarks:
        say(f"{output}: {remark}", DONE)
    runs = f"{'seed' if len(written.seeds) == 1 else 'seeds'} {seed_text(written.seeds)}"
    contents = f"{counted(written.samples, 'sample')} of {counted(written.disks, 'disk')}"
    show(f"{output}: {runs}: {contents}, {in_bytes(Path(output).stat().st_size)}")
