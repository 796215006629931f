"""The command that makes the runs of a trajectory file again, written into the file."""

from collections.abc import Mapping, Sequence

import numpy as np

from brownpipe.engines import Engine
from brownpipe.engines.state import Ensemble
from brownpipe.observables import observables_making
from brownpipe.scene import Scene
from brownpipe.scene.seeds import seed_text

DEFAULTS = {"record": "tracer", "observables": "", "average": "runs"}  # of options of `brownpipe simulate`


def rerun(scene: Scene, engine: Engine, ensemble: Ensemble) -> str:
    """Return the commands that make these runs again, and where the scene file comes from: no other file is needed."""
    tracks = ["all"] * bool(ensemble.whole) + ["events"] * bool(ensemble.events)
    if not tracks and ensemble.tracer is None and scene.particles > 0:
        tracks = ["none"]
    names = observables_making(ensemble.observables)
    options = {"record": ",".join(tracks), "observables": ",".join(names), "average": ensemble.average if names else ""}
    command = simulate_command(scene, engine, ensemble.seeds, options)
    scene_file = f"{scene.name}.yaml is printed by `brownpipe inspect FILE --scene`"
    compare = "`brownpipe inspect FILE --reproduce` runs and compares; FILE is this file"
    return f"`{command}`, where {scene_file}; {compare}"


def simulate_command(
    scene: Scene, engine: Engine, seeds: Sequence[int] | np.ndarray, options: Mapping[str, str]
) -> str:
    """Return the command that makes runs of these seeds; `options` that are empty or the default are left out."""
    words = [f"--particles {scene.particles}"] if scene.species else []
    words += [f"--seeds {seed_text(seeds)}", f"--engine {engine.options}"]
    words += [f"--{key} {value}" for key, value in options.items() if value not in ("", DEFAULTS[key])]
    return f"brownpipe simulate {scene.name}.yaml {' '.join(words)}"
