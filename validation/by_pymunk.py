"""The same disks by pymunk, a program for rigid bodies in two dimensions with fixed time steps.

    python -m validation.by_pymunk    print the tables of docs/other_programs.md, draw its figure

pymunk moves all bodies for a step; those that then overlap exchange momentum. A collision happens
up to one step late, therefore, along the line of centres of that moment. With elasticity 1 and
without friction it is that of eqs. (5)-(10).
"""

from collections.abc import Iterable, Iterator
from math import inf
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import yaml
from matplotlib.figure import Figure

import brownpipe as bp
from brownpipe.engines.start.initial_state import draw_state
from brownpipe.engines.units import State
from brownpipe.figures.style import GREY, SERIES, drawing, grid, image_bytes
from brownpipe.scene import Scene
from validation.stability.game import space_of

ROOT = Path(__file__).parent.parent
DURATIONS = {5: 12.0, 40: 2.4, 150: 0.8}  # by number of disks: until the programs disagree [time]
STEPS = (1e-3, 1e-4, 1e-5)
SEEDS = range(20)
# root mean square distance of the positions at which the runs count as different [length]
APART = 0.01
SHIFT = 1e-11  # of the initial positions, to measure how fast nearby runs diverge [length]
WALL = -1  # the partner of a disk in a collision with a wall


class Run(NamedTuple):
    """What pymunk makes of an initial state."""

    position: np.ndarray  # (time, disk, component) [length]
    velocity: np.ndarray  # (time, disk, component) [length/time]
    time: np.ndarray  # (collision,) of the step that found it [time]
    pair: np.ndarray  # (collision, 2) disks in ascending order, or WALL and a disk


def note_scene(particles: int, duration: float) -> Scene:
    """Return the note's scene with another number of disks, sampled 40 times."""
    keys = yaml.safe_load((ROOT / "config" / "scenes" / "harrison2020.yaml").read_text())
    return bp.Scene(
        **keys | {"particles": particles, "duration": duration, "sample_interval": duration / 40}
    )


def by_pymunk(scene: Scene, state: State, step: float) -> Run:
    """Return pymunk's run of a scene between walls from a state; its sample times are multiples of
    the time step.
    """
    space, bodies = space_of(
        state, scene.box.x, scene.box.y
    )  # overlaps below `collision_slop`, 0.1, are not corrected
    space.iterations = 50  # several contacts in one step conserve energy, too
    number = {body: i for i, body in enumerate(bodies)}
    collisions: list[tuple[int, int, int]] = []
    made = 0

    def note(arbiter: Any, *_: object) -> None:
        first, second = sorted(number.get(body, WALL) for body in arbiter.bodies)
        collisions.append((made, first, second))

    space.on_collision(begin=note)
    samples = []
    for time in scene.times:
        while made < round(time / step):
            made += 1
            space.step(step)
        samples.append([(body.position, body.velocity) for body in bodies])
    position, velocity = np.moveaxis(np.array(samples), 2, 0)
    found = np.array(collisions).reshape(-1, 3)
    return Run(position, velocity, found[:, 0] * step, found[:, 1:])


def by_brownpipe(scene: Scene, state: State) -> Run:
    """Return the run of the exact engine from the same state; the times of its collisions are
    exact.
    """
    keys = ("position", "velocity", "radius", "mass")
    given = [
        dict(zip(keys, disk, strict=True))
        for disk in zip(*(values.tolist() for values in state), strict=True)
    ]
    box, interval = {"x": scene.box.x, "y": scene.box.y}, float(scene.times[1])
    same = bp.Scene(box=box, disks=given, duration=scene.duration, sample_interval=interval)
    runs = bp.simulate(same, record="all,events", quiet=True)
    run = runs.isel(seed=0)
    disks, events = run["disks"].to_dataset(), run["events"].to_dataset()
    pair = np.sort(np.stack([events.a, np.maximum(events.b, WALL)], axis=1), axis=1)
    return Run(disks.position.values, disks.velocity.values, events.event_time.values, pair)


def distance(one: Run, other: Run) -> np.ndarray:
    """Return the root mean square distance of the disks' positions in two runs, at each sample time
    [length].
    """
    return np.sqrt(np.square(one.position - other.position).sum(axis=-1).mean(axis=-1))


def first_delays(exact: Run, late: Run) -> Iterator[float]:
    """Yield how much later the collisions are whose partners have flown straight until then, in
    both runs.
    """
    found = dict(_first_collisions(late))
    for pair, time in _first_collisions(exact):
        if pair in found:
            yield found[pair] - time


def _first_collisions(of: Run) -> Iterator[tuple[tuple[int, int], float]]:
    """Yield the pairs, with the time, of which neither has collided before."""
    collided: set[int] = set()
    for time, (a, b) in zip(of.time.tolist(), of.pair.tolist(), strict=True):
        if collided.isdisjoint((a, b)):
            yield (a, b), time
        collided.update({a, b} - {WALL})


def energy_drift(state: State, of: Run) -> float:
    """Return the largest relative change of the total kinetic energy at the sample times."""
    energy = (state.mass[:, None] * of.velocity**2).sum(axis=(1, 2))
    return np.abs(energy / (state.mass[:, None] * state.velocity**2).sum() - 1).max()


class Measured(NamedTuple):
    """Runs of a number of disks by both programs, for all seeds."""

    scene: Scene
    diverging: (
        np.ndarray
    )  # (seed, time) distance of two exact runs whose initial positions differ by SHIFT
    distance: dict[
        float, np.ndarray
    ]  # by time step: (seed, time) distance of pymunk's runs from the exact ones
    delays: dict[float, np.ndarray]  # by time step: (collision,) of first_delays, in steps
    drift: dict[float, float]  # by time step
    seconds: dict[float, float]  # by time step: CPU time of all runs; 0: those of the exact engine


def measure(particles: int) -> Measured:
    """Run the note's scene with a number of disks by both programs."""
    scene = note_scene(particles, DURATIONS[particles])
    states = [draw_state(scene, seed) for seed in SEEDS]
    by_brownpipe(scene, states[0])  # compiles
    began = process_time()
    exact = [by_brownpipe(scene, state) for state in states]
    seconds = {0.0: process_time() - began}
    angles = np.random.default_rng(1).uniform(0, 2 * np.pi, (len(SEEDS), particles))
    shifts = SHIFT * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    shifted = [
        state._replace(position=state.position + shift)
        for state, shift in zip(states, shifts, strict=True)
    ]
    diverging = np.array(
        [
            distance(by_brownpipe(scene, state), run)
            for state, run in zip(shifted, exact, strict=True)
        ]
    )
    apart, delays, drift = {}, {}, {}
    for step in STEPS:
        began = process_time()
        late = [by_pymunk(scene, state, step) for state in states]
        seconds[step] = process_time() - began
        pairs = list(zip(exact, late, strict=True))
        apart[step] = np.array([distance(*pair) for pair in pairs])
        delays[step] = np.array([delay for pair in pairs for delay in first_delays(*pair)]) / step
        drift[step] = max(energy_drift(state, run) for state, run in zip(states, late, strict=True))
    return Measured(scene, diverging, apart, delays, drift, seconds)


def growth(measured: Measured) -> tuple[float, float]:
    """Return the rate at which nearby exact runs diverge [1/time], over the last three quarters,
    and its error.
    """
    quarter = len(measured.scene.times) // 4
    interval = measured.scene.times[-1] - measured.scene.times[quarter]
    return _mean(np.log(measured.diverging[:, -1] / measured.diverging[:, quarter]) / interval)


def agreement(measured: Measured, step: float) -> np.ndarray:
    """Return the time (seed,) from which the runs are APART, interpolated in the logarithm; inf if
    they never are.
    """
    return np.array([_crossing(measured.scene.times, row) for row in measured.distance[step]])


def _crossing(times: np.ndarray, row: np.ndarray) -> float:
    if not (row > APART).any():
        return inf
    k = int(np.argmax(row > APART))
    low, high = np.log(row[k - 1 : k + 1])
    return float(times[k - 1] + (np.log(APART) - low) / (high - low) * (times[k] - times[k - 1]))


def _mean(values: np.ndarray) -> tuple[float, float]:
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))


def report(measured: Measured) -> None:
    """Print the numbers of the page."""
    rate, error = growth(measured)
    n = measured.scene.particles
    exact = measured.seconds[0.0] / len(SEEDS)
    print(
        f"N = {n}: growth {rate:.2f}({error:.2f}), ln 10/growth {np.log(10) / rate:.3f}; exact "
        f"{exact:.4f} s a run"
    )
    before = np.full(len(SEEDS), inf)
    for step in STEPS:
        apart, delays, times = (
            measured.distance[step],
            measured.delays[step],
            agreement(measured, step),
        )
        at = ", ".join(f"{np.median(apart[:, k]):.1e}" for k in (10, 20, 30, 40))
        z = (delays.mean() - 0.5) * np.sqrt(12 * len(delays))  # if they are uniform between 0 and 1
        both = np.isfinite(times) & np.isfinite(before)
        gained = (
            ", {:.3f}({:.3f}) later".format(*_mean(times[both] - before[both]))
            if both.any()
            else ""
        )
        print(
            f"  step {step:g}: distances {at}; apart at {np.median(times):.3f}{gained}, "
            f"{np.isinf(times).sum()} never;"
            f" delays {delays.min():.4f} to {delays.max():.4f}, mean {delays.mean():.4f}, z "
            f"{z:+.1f}, {len(delays)};"
            f" drift {measured.drift[step]:.0e}; {measured.seconds[step] / len(SEEDS):.3f} s a run"
        )
        before = times


def figure(all_measured: Iterable[Measured]) -> Figure:
    """Draw the distance between the programs against time: median over the seeds."""
    every = list(all_measured)
    drawn, (panels,) = grid(1, len(every), 2.7, 3.0, sharey=True)
    for axes, measured in zip(panels, every, strict=True):
        times = measured.scene.times[1:]
        for step, (colour, line, _) in zip(STEPS, SERIES, strict=False):
            middle = np.median(measured.distance[step][:, 1:], axis=0)
            axes.plot(times, middle, linestyle=line, color=colour, label=f"pymunk, step {step:g}")
        shifted = np.median(measured.diverging[:, 1:], axis=0)
        axes.plot(times, shifted, color=GREY, label="brownpipe, shifted")
        axes.set_yscale("log")
        axes.set_ylim(SHIFT * 1e-6, 10)
        axes.set_title(f"{measured.scene.particles} disks")
        axes.set_xlabel("time")
    panels[0].set_ylabel("root mean square distance")
    panels[0].legend(loc="lower right")
    return drawn


def main() -> None:
    every = []
    for particles in DURATIONS:
        every.append(measure(particles))
        report(every[-1])
    with drawing():
        (ROOT / "docs" / "figures" / "other_programs_pymunk.png").write_bytes(
            image_bytes(figure(every), "png")
        )


if __name__ == "__main__":
    main()
