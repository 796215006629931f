"""How often a D is marked: never where tracers diffuse, always where they do not.

    python -m validation.diffusion_marks        a table of some 600 studies, 15 minutes on one core

Every study has the same scene and seeds of its own. `default` are the windows that the analysis
chooses, `early` the first of those that are known before any run. The table in docs/theory.md,
section 5, was made by it.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

import brownpipe as bp
from brownpipe.analysis import diffusive
from brownpipe.engines.friction import DECAY_TIMES, not_diffusive_before
from brownpipe.engines.windows import default_windows

FIRST_SEED = 7000
SAMPLES = 100
OVER_DISKS = {"observables": ["square_displacement"], "average": "disks"}
OVER_ORIGINS = {"observables": ["square_displacement"], "average": "origins"}


class Trial(NamedTuple):
    """Studies of one scene."""

    title: str
    scene: Any
    studies: int
    runs: int  # of each study
    options: Mapping[str, Any] = MappingProxyType({})  # of `simulate`


def fluid(phi: float, count: int = 100, boundary: str = "periodic", **keys: Any) -> dict:
    """Return the keys of a scene of equal disks of radius 0.5 and mass 1 at kT = 1."""
    side = float(np.sqrt(count * np.pi * 0.25 / phi))
    disks = {"species": [{"name": "fluid", "count": count, "radius": 0.5, "mass": 1.0}]}
    return {
        "box": {"x": [0, side], "y": [0, side], "boundary": boundary},
        "disks": disks,
        "velocities": {"temperature": 1.0},
        "equilibrate": {"time": 5.0, "tracer": "free"},
        **keys,
    }


def with_tracer(phi: float, radius: float, mass: float, bath_radius: float) -> dict:
    """Return the keys of a scene of a tracer among 100 disks of mass 1 at kT = 1."""
    area = np.pi * (radius**2 + 100 * bath_radius**2) / phi
    side = float(np.sqrt(area))
    bath = {"name": "bath", "count": 100, "radius": bath_radius, "mass": 1.0}
    keys = fluid(phi)
    keys["box"] = {"x": [0, side], "y": [0, side], "boundary": "periodic"}
    keys["disks"] = {"tracer": {"radius": radius, "mass": mass}, "species": [bath]}
    return keys


def lasting(keys: dict, relaxations: float) -> Any:
    """Return the scene with a duration of so many 1/gamma of its tracer."""
    unit = bp.Scene(**keys, duration=1.0, name="trial")
    duration = float(f"{relaxations * not_diffusive_before(unit) / DECAY_TIMES:.3g}")
    return unit.replace(duration=duration, sample_interval=duration / SAMPLES)


def diffusing() -> list[Trial]:
    """Return the studies whose tracers diffuse."""
    single = [
        Trial(f"equal disks, $\\phi$ = {phi}", lasting(fluid(phi), length), 40, 100)
        for phi, length in ((0.05, 40), (0.1, 30), (0.14, 100), (0.3, 30), (0.45, 30))
    ]
    heavy = [
        Trial(f"mass 20, $\\phi$ = {phi}", lasting(with_tracer(phi, 1.0, 20.0, 0.25), 30), 40, 100)
        for phi in (0.1, 0.3, 0.4)
    ]
    averaged = [
        Trial("over disks, $\\phi$ = 0.3", lasting(fluid(0.3), 30), 40, 40, OVER_DISKS),
        Trial("over disks, $\\phi$ = 0.5", lasting(fluid(0.5), 30), 40, 40, OVER_DISKS),
        Trial("over origins, $\\phi$ = 0.14", lasting(fluid(0.14), 60), 40, 40, OVER_ORIGINS),
    ]
    return single + heavy + averaged


def not_diffusing() -> list[Trial]:
    """Return the studies whose tracers do not diffuse, or not yet."""
    square = lasting(fluid(0.2, 60, "reflecting"), 60)
    centre = bp.read_scene("config/scenes/harrison2020.yaml").replace(
        duration=10.0, sample_interval=0.1, name="centre"
    )
    file = fluid(0.2, 40, box={"x": [0, 80.0], "y": [0, 1.5], "boundary": "reflecting"})
    file_scene = bp.Scene(**file, duration=50.0, sample_interval=0.5, name="file")
    cages = lasting(fluid(0.69, 200), 30)
    crystal = fluid(0.78, 64, box={"x": [0, 8.0], "y": [0, 48**0.5], "boundary": "periodic"})
    radius = float(np.sqrt(0.78 * 8 * 48**0.5 / (64 * np.pi)))
    crystal["disks"]["species"][0]["radius"] = radius
    crystal["disks"]["placement"] = "lattice"
    solid = bp.Scene(**crystal, duration=10.0, sample_interval=0.1, name="crystal")
    drift = fluid(0.2, 20, velocities={"temperature": 1.0, "zero_momentum": False})
    return [
        Trial("walls: the note's tracer until t = 10", centre, 20, 100),
        Trial("walls: equal disks in a square", square, 20, 100),
        Trial("file of 40 disks, over disks", file_scene, 20, 50, OVER_DISKS),
        Trial("file of 40 disks", file_scene, 20, 100),
        Trial("cages, $\\phi$ = 0.69, over disks", cages, 10, 40, OVER_DISKS),
        Trial("cages, $\\phi$ = 0.69", cages, 10, 400),
        Trial("crystal, $\\phi$ = 0.78, over disks", solid, 10, 40, OVER_DISKS),
        Trial("mass 0.02, $\\phi$ = 0.4", lasting(with_tracer(0.4, 0.5, 0.02, 0.5), 30), 10, 1000),
        Trial("mass 0.02, $\\phi$ = 0.6", lasting(with_tracer(0.6, 0.5, 0.02, 0.5), 30), 10, 1000),
        Trial("drift of 20 disks", lasting(drift, 30), 20, 100),
        Trial("flight, until 1/gamma", lasting(fluid(0.01, 50), 1), 20, 100),
    ]


def row(trial: Trial) -> str:
    """Return a row of the table: how many studies are marked, by which reasons."""
    last = FIRST_SEED + trial.studies * trial.runs - 1
    runs = bp.simulate(trial.scene, f"{FIRST_SEED}-{last}", quiet=True, **trial.options)
    early_window = default_windows([trial.scene], trial.options.get("average", "runs"))
    counts = []
    reasons: set[str] = set()
    for windows in (None, early_window):
        marks = []
        for k in range(trial.studies):
            start = FIRST_SEED + k * trial.runs
            study = runs.sel(seed=slice(start, start + trial.runs - 1))
            result = bp.analyse(study, fit_windows=windows, quiet=True)
            mark = result.diffusion_mark.values.ravel()[0]
            marks.append(mark)
            reasons.update(filter(None, diffusive.mark_in_words(mark).split(", ")))
        counts.append(np.count_nonzero(marks))
    cells = (trial.title, f"{trial.studies} of {trial.runs} runs", *map(str, counts))
    return f"| {' | '.join(cells)} | {', '.join(sorted(reasons))} |"


if __name__ == "__main__":
    print("| scene | studies | marked, default | marked, early | reasons |\n|---|---|---|---|---|")
    for trial in diffusing() + not_diffusing():
        print(row(trial), flush=True)
