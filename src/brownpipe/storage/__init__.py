"""Storage of trajectories (HDF5) and datasets (netCDF4): written completely or not at all, and verified when read.

A trajectory file holds a batch of runs, one for each of S seeds, in the layout of H5MD 1.1 in two dimensions. T sample
times, N disks, E collisions:

    h5md/                            version [1, 1], author, creator
    particles/
        tracer/                      disk 0 of every run: the runs are the particles of this group
            box/                     edges (2,), origin (2,); attributes dimension, boundary (none: walls, or periodic)
            id (S,)                  the seeds
            position/                value (T, S, 2), its scales time (T,), seed (S,), component (2,); step (T,)
            image/                   as position/, in a periodic box; unwrapped position = position + image * edges
        seed_00017/                  all disks of one run, if recorded
            box/, id (N,), radius (N,), mass (N,)
            position/, velocity/     value (T, N, 2), its scales time (T,), disk (N,), component (2,); step (T,)
            image/                   as position/, in a periodic box
    observables/
        run/                         seed (S,); pair_collisions (S,), energy_drift (S,), ...: one number per run;
                                     stopped (S,): why a run could not go on, if there is such a run; its numbers are
                                     NaN, its counts 0;
                                     arrays of observables (brownpipe.observables), if measured:
                                     square_displacement (S, T), ... and their scales time (T,), species, species_pair,
                                     velocity, speed, distance
        events/seed_00017/           all collisions of one run, if recorded: time (E,), a (E,), b (E,), impulse (E, 2)
    parameters/                      scene, settings (JSON); attributes: scene_name, particles, engine, seeds,
                                     average (over runs, origins or disks), rerun (commands), versions,
                                     source_digest

Every dataset has attributes `units` (reduced units of the scene) and `long_name` (its meaning). Numbers are stored with
gzip 4 and shuffle; a SHA-256 at the end of the file is verified when it is read (`files`). Nothing in a file depends on
when, where or by whom it was written: the same runs give the same bytes.

A dataset says in its attributes what it was made from (`origin`) and by which source, versions and commit, so that the
same installation gives the same bytes of the same runs.
"""

from brownpipe.storage.checkpoints import read_checkpoint, remove_checkpoint, write_checkpoint
from brownpipe.storage.datasets import made_by, read_dataset, write_dataset
from brownpipe.storage.files import seal_of, write_file, write_files
from brownpipe.storage.origin import origin_attributes, runs_record
from brownpipe.storage.store import StoredFile
from brownpipe.storage.trajectories import Outline, Trajectories, read_outline, read_trajectories, write_trajectories
from brownpipe.storage.tree import from_tree, refuse_foreign, to_tree

__all__ = [
    "Outline",
    "StoredFile",
    "Trajectories",
    "from_tree",
    "made_by",
    "origin_attributes",
    "read_checkpoint",
    "read_dataset",
    "read_outline",
    "read_trajectories",
    "refuse_foreign",
    "remove_checkpoint",
    "runs_record",
    "seal_of",
    "to_tree",
    "write_checkpoint",
    "write_dataset",
    "write_file",
    "write_files",
    "write_trajectories",
]
