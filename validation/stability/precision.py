"""Single against double precision in the time-stepping engine, in the note's scene."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from brownpipe.engines.exact.simulation import simulate as exact
from brownpipe.engines.state import Ensemble
from brownpipe.engines.timestep import simulation as timestep
from brownpipe.engines.timestep.recording import ENERGY_BOUND
from brownpipe.figures.style import SERIES, grid
from brownpipe.scene import Scene
from validation.stability.game import pymunk
from validation.stability.programs import GAME
from validation.stability.start import notes_scene
from validation.stability.table import Row, shown

BOUND = {"double": ENERGY_BOUND[np.float64], "single": ENERGY_BOUND[np.float32]}
STEP = 1e-3
SAMPLING = 0.05
COMPARED = (0.1, 0.5)  # times at which distances are in the table


class Precisions(NamedTuple):
    """Runs of the note's scene with time steps of STEP, by precision; GAME with the same steps."""

    energy_drift: dict[str, np.ndarray]  # (seeds,) relative, after the longer duration
    momentum_residual: dict[str, np.ndarray]  # (seeds,)
    distance: dict[str, np.ndarray]  # (seeds, samples) median over disks of the distance from the exact engine [length]
    game: tuple[float, ...]  # the same of pymunk at COMPARED, one seed; () where it is not installed


def measure(seeds: int = 10, long: float = 20.0, games: Sequence[float] = COMPARED) -> Precisions:
    """Measure drifts after the time `long`, distances up to t = 1."""
    starts = [notes_scene(seed) for seed in range(1, seeds + 1)]
    paths = [exact(start.scene(1.0, sample_interval=SAMPLING), [0], {"all"}).whole[0].position for start in starts]
    drift, residual, distance = {}, {}, {}
    for precision in BOUND:
        ends = [_run(start.scene(long), precision) for start in starts]
        drift[precision] = np.array([end.observables["energy_drift"][0] for end in ends])
        residual[precision] = np.array([end.observables["momentum_residual"][0] for end in ends])
        runs = [_run(start.scene(1.0, sample_interval=SAMPLING), precision).whole[0].position for start in starts]
        distance[precision] = np.array([_apart(run, path) for run, path in zip(runs, paths, strict=True)])
    played = {t: run for t in games if (run := pymunk(starts[0], t, STEP)) is not None}
    game = tuple(float(_apart(run.state.position, paths[0][round(t / SAMPLING)])) for t, run in played.items())
    if game:
        drift[GAME] = np.array([run.energy_drift for run in played.values()])
        residual[GAME] = np.array([run.momentum_residual for run in played.values()])
    return Precisions(drift, residual, distance, game)


def _run(scene: Scene, precision: str) -> Ensemble:
    return timestep.simulate(scene, [0], {"all"}, time_step=STEP, precision=precision)


def _apart(path: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the median distance of disks at the same time, of paths (..., N, 2)."""
    return np.median(np.hypot(*np.moveaxis(path - other, -1, 0)), axis=-1)


def rows(found: Precisions) -> list[Row]:
    """Return rows: energy drift and momentum residual, distance from the exact path."""
    made = []
    for precision, bound in BOUND.items():
        kept = bool(np.abs(found.energy_drift[precision]).max() <= bound)
        game = _drift(found, GAME) if found.game and precision == "double" else "-"
        title = f"{precision}: energy drift, momentum residual"
        made.append(Row(title, f"{shown(bound)}, -", (_drift(found, precision), "-", "-", game), kept))
        middle = np.median(found.distance[precision], axis=0)
        places = [round(t / SAMPLING) for t in COMPARED]
        game = shown(*found.game) if found.game and precision == "double" else "-"
        title = f"{precision}: distance from the exact run at $t = 0.1$, 0.5"
        made.append(Row(title, "-", (shown(*middle[places]), "-", "-", game)))
    return made


def _drift(found: Precisions, name: str) -> str:
    return shown(np.abs(found.energy_drift[name]).max(), found.momentum_residual[name].max())


def draw(found: Precisions) -> Figure:
    """Draw the distance from the exact run against time."""
    figure, ((axes,),) = grid(1, 1, 5.6, 3.8)
    for (precision, distance), (colour, line, _) in zip(found.distance.items(), SERIES, strict=False):
        time = SAMPLING * np.arange(distance.shape[1])
        axes.plot(
            time[1:], np.median(distance, axis=0)[1:], color=colour, linestyle=line, label=f"{precision} precision"
        )
        axes.plot(time[1:], distance.T[1:], color=colour, linewidth=0.4, alpha=0.5)
    axes.set(yscale="log", xlabel="time $t$", ylabel="distance from the exact run [length]\n(median over disks)")
    axes.legend()
    return figure
