"""Storage of trajectories (HDF5) and datasets (netCDF4): written completely or not at all, and
verified when read.

A trajectory file holds a batch of runs, one for each of S seeds, as a netCDF4 file of which xarray
makes the `DataTree` that `brownpipe.open` and `brownpipe.simulate` return. T sample times, N disks,
E collisions:

    /           position (T, S, 2), and image in a periodic box: disk 0 of every run, if recorded;
    velocity, if asked;
                pair_collisions (S,), energy_drift (S,), ...: one number per run;
                stopped (S,): why a run could not go on, if there is such a run; its numbers are
                NaN, its counts 0; arrays of observables (brownpipe.observables), if measured:
                square_displacement (S, T), ...; coordinates time (T,), seed (S,), component (2,),
                and species, velocity_bin, distance, ... of arrays; attributes scene (JSON),
                scene_name, particles, engine, settings (JSON), average (over runs, origins or
                disks), variables (JSON: the numbers and arrays of the runs), command (that makes
                the runs again), versions, source_digest, runs_digest
    /disks      if recorded: position, velocity, image (T, S, N, 2) of all disks; radius, mass (N,)
    /events     if recorded: event_time, a, b (S, E), impulse (S, E, 2) of the collisions of each
                run, NaN behind its last one; E is the largest number of collisions of a run

Unwrapped position = position + image * (width, height) of the box. Every variable has attributes
`units` (reduced units of the scene) and `long_name` (its meaning). Numbers are stored with gzip 4
and shuffle; a SHA-256 at the end of the file is verified when it is read (`files`). Nothing in a
file depends on when, where or by whom it was written: the same runs give the same bytes.

A dataset says in its attributes what it was made from (`datasets`) and by which source, versions
and commit, so that the same installation gives the same bytes of the same runs.
"""
