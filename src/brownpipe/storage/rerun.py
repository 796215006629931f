"""The command that makes the runs of a trajectory file again: written into the file, and found in a damaged one."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from brownpipe.engines import DEFINITIONS, RECORDS, Engine, option, requested
from brownpipe.engines.state import Ensemble
from brownpipe.errors import RequestError
from brownpipe.observables import AVERAGES, OBSERVABLES, RENAMED, observables_making
from brownpipe.quoting import shell_path
from brownpipe.scene import Scene, reading
from brownpipe.scene.reading import Entry
from brownpipe.scene.scene_file import MOST_DISKS
from brownpipe.scene.seeds import parse_seeds, seed_text

COMMAND = re.compile(  # as `rerun` writes it; none of its characters means anything to a shell
    rb"`brownpipe simulate ([A-Za-z0-9][A-Za-z0-9._-]{0,63})\.yaml((?: --[a-z-]+ [A-Za-z0-9.,_+-]+)+)`"
)
DEFAULTS = {"record": "tracer", "observables": "", "average": "runs"}  # of options of `brownpipe simulate`
WORDS_OF = {"--record": RECORDS, "--observables": (*OBSERVABLES, *RENAMED), "--average": AVERAGES}  # in the command


def rerun(scene: Scene, engine: Engine, ensemble: Ensemble) -> str:
    """Return the commands that make these runs again, and where the scene file comes from: no other file is needed.

    The first is in backquotes, by which `remedy` finds it in a damaged file.
    """
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


def remedy(path: str | Path) -> str:
    """Return how to make a damaged file again: by the command found in its raw bytes, without the help of HDF5."""
    try:
        match = COMMAND.search(Path(path).read_bytes())
    except OSError:
        return "check that it is there and can be read"
    try:
        seeds, command = _valid_command(match)
    except (RequestError, ValueError):
        return "if brownpipe wrote it, delete it and run the study or brownpipe simulate again"
    return f"seeds {seeds} are lost: delete it and run the study again, or {command} --output {shell_path(path)}"


def _valid_command(match: re.Match[bytes] | None) -> tuple[str, str]:
    """Return the seeds and the command that `rerun` wrote, built from its values, as the file may contain any text.

    Raises ValueError or RequestError unless there is a command and every part of it is valid.
    """
    if match is None:
        raise ValueError("no command")
    name, options = (text.decode("ascii") for text in match.groups())
    words = options.split()
    given = dict(zip(words[::2], words[1::2], strict=True))
    known = DEFINITIONS[reading.choice(Entry(given.pop("--engine", ""), ""), tuple(DEFINITIONS))]
    settings = {key: given.pop(option(key)) for key in known.settings if option(key) in given}
    values = {key: float(text) if known.settings[key].is_positive else text for key, text in settings.items()}
    seeds = seed_text(parse_seeds(given.pop("--seeds", "")))
    particles = given.pop("--particles", None)
    parts = [f"brownpipe simulate {name}.yaml"]
    parts += [] if particles is None else [f"--particles {reading.integer(Entry(int(particles), ''), 0, MOST_DISKS)}"]
    parts += [f"--seeds {seeds} --engine {requested(known.name, values).options}"]
    for key, text in given.items():
        names = [reading.choice(Entry(word, ""), WORDS_OF.get(key, ())) for word in text.split(",")]
        parts.append(f"{key} {','.join(names)}")
    return seeds, " ".join(parts)
