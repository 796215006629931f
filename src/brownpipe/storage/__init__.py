"""Trajectories (HDF5) and datasets (netCDF4): written whole or not at all, verified whenever they are read.

A trajectory file holds one batch of seeds and follows H5MD 1.1 in true 2D. T samples, S seeds, N disks, E events:

    h5md/                            version [1, 1], author, creator
    particles/
        tracer/                      the followed disk of every run: the runs are the particles of this group
            box/                     edges (2,), origin (2,); attributes dimension, boundary (none: walls, or periodic)
            id (S,)                  the seed
            position/                value (T, S, 2), its scales time (T,), seed (S,), component (2,); step (T,)
            velocity/, image/        the same, if recorded; unwrapped position = position + image * edges
        seed_00017/                  one whole run, if recorded
            box/, id (N,), radius (N,), mass (N,)
            position/, velocity/     value (T, N, 2), its scales time (T,), disk (N,), component (2,); step (T,)
            image/                   the same, in a periodic box
    observables/
        run/                         seed (S,); pair_collisions (S,), energy_drift (S,), ...: one value per run;
                                     arrays of every run, if measured: square_displacement (S, T), ... and their scales
                                     time (T,), species, species_pair, velocity, speed, distance (brownpipe.observables)
        events/seed_00017/           every collision of one run, if recorded: time (E,), a (E,), b (E,), impulse (E, 2)
    parameters/                      scene, settings (JSON); attributes: format, scene_name, particles, engine, seeds,
                                     average (over runs, origins or disks), rerun (the command), versions,
                                     source_digest, contents_digest, seal

Every dataset says its `units` (reduced units of the scene) and its meaning (`long_name`). Arrays of numbers are stored
with gzip 4, shuffle and fletcher32; the seal, a SHA-256 of all other bytes of the file, covers the rest. Nothing in a
file depends on when, where or by whom it was written: two runs give the same bytes.
"""

from brownpipe.errors import StorageError, WrongFileError
from brownpipe.storage.checkpoints import read_checkpoint, remove_checkpoint, write_checkpoint
from brownpipe.storage.datasets import read_dataset, write_dataset
from brownpipe.storage.files import write_file
from brownpipe.storage.inspection import report, verify
from brownpipe.storage.trajectories import (
    Outline,
    Trajectories,
    read_outline,
    read_trajectories,
    write_trajectories,
)

__all__ = [
    "Outline",
    "StorageError",
    "Trajectories",
    "WrongFileError",
    "read_checkpoint",
    "read_dataset",
    "read_outline",
    "read_trajectories",
    "remove_checkpoint",
    "report",
    "verify",
    "write_checkpoint",
    "write_dataset",
    "write_file",
    "write_trajectories",
]
