"""What a time step costs and spoils: the time-stepping engine beside the exact one, as tables.

    python benchmarks/bench_timestep.py
    python benchmarks/bench_timestep.py --quick     a few short runs, of each kind

CPU time of one core, medians, both engines in one process, from the same states, without drawing
states. In the note's scene sampling and reporting are included; in the periodic boxes the time is
the difference of a long run and a short one, so that start-up is not. Bias: the mean difference in
pair collisions from the exact engine, seed by seed; in the boxes that of the long run, with the
standard error that independent collisions would give it.
"""

import argparse
import json
import time
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from bench_exact import ROOT, Case, scene_of

from brownpipe.engines.exact import run as exact_run
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.start.initial_state import draw_state
from brownpipe.engines.timestep import COLLISIONS, Settings
from brownpipe.engines.timestep import simulation as timestep
from brownpipe.scene import parse_scene
from brownpipe.storage.configurations import read_scene
from brownpipe.tradeoff.compare import APART, departure_time

STEPS = (3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
BOX_STEPS = (1e-4, 1e-3, 1e-2)
BOXES = ((150, 0.14), (150, 0.7), (1_000, 0.14), (1_000, 0.7), (10_000, 0.14), (10_000, 0.7))
LONGER = 4  # times as long as the short run


class Effort(NamedTuple):
    """How much is measured."""

    steps: tuple[float, ...]  # in the note's scene [time]
    seeds: int  # of the note's scene, compared
    states: int  # of them, timed
    repeats: int  # of which the median is taken
    boxes: tuple[tuple[int, float], ...]  # (N, phi)
    box_steps: tuple[float, ...]  # [time]
    disk_time: float  # disks times duration of the short run in a box [time]
    melting: float  # [time]


FULL = Effort(STEPS, 400, 100, 5, BOXES, BOX_STEPS, 10_000.0, 2.0)
QUICK = Effort(STEPS[-1:], 4, 2, 1, BOXES[:1], BOX_STEPS[-1:], 150.0, 0.1)


def seconds(run, repeats):
    """Median CPU time of a call."""
    spent = []
    for _ in range(repeats):
        begun = time.process_time()
        run()
        spent.append(time.process_time() - begun)
    return float(np.median(spent))


def exactly(engine, state, times, record=()):
    """A run of the exact engine from a state, sampled at these times."""
    block = engine.workspace.calendar.block
    engine = engine._replace(
        recorder=exact_run.new_recorder(engine.scene, engine.frame, block, times, record)
    )
    return exact_run.run_to_end(engine, exact_run.state_at_start(engine, state))


def runs_of_the_note(effort):
    """Time per run, bias and departure against the time step, in the note's scene."""
    scene, seeds = read_scene(ROOT / "config/scenes/harrison2020.yaml"), effort.seeds
    states, there = (
        [draw_state(scene, seed) for seed in range(effort.states)],
        exact.simulate(scene, range(seeds)),
    )
    reference = exact_run.prepare_scene(scene, scene.times)
    alone = seconds(
        lambda: [exactly(reference, state, scene.times) for state in states], effort.repeats
    )
    alone *= 1e3 / len(states)
    pairs = there.observables["pair_collisions"]
    yield f"exact: {alone:.3f} ms a run, {pairs.mean():.1f} pair collisions\n"
    yield "| dt | collisions | ms | of exact | bias, % | departs at, median | worst overlap |"
    yield "|---|---|---|---|---|---|---|"
    for dt, collisions in product(effort.steps, COLLISIONS):
        few = states if dt > 1e-4 else states[: effort.states // 5]
        stepped = milliseconds(scene, few, dt, collisions, effort)
        run = timestep.simulate(scene, range(seeds), time_step=dt, collisions=collisions)
        less = 100 * (run.observables["pair_collisions"] - pairs) / pairs.mean()
        departed = departure_time(
            scene.times, run.tracer.position, there.tracer.position, APART * scene.radius[0]
        )
        yield (
            f"| {dt:g} | {collisions} | {stepped:.2f} | {stepped / alone:.1f} | {less.mean():.2f} "
            "+- "
            f"{less.std(ddof=1) / seeds**0.5:.2f} | {np.median(departed):.2f} | "
            f"{np.median(run.observables['worst_overlap']):.3f} |"
        )


def milliseconds(scene, states, dt, collisions, effort):
    """Median CPU time of a run from each of the states [ms]."""
    engine = timestep.prepare_scene(scene, Settings(dt, collisions))
    all_runs = seconds(
        lambda: [timestep.run_steps(engine, state, scene.times) for state in states], effort.repeats
    )
    return 1e3 * all_runs / len(states)


def boxes(effort):
    """Time per unit of time against N, packing fraction and time step, in periodic boxes that were
    melted before.
    """
    yield "| N | phi | exact, ms | dt | collisions | ms | of exact | bias, % |"
    yield "|---|---|---|---|---|---|---|---|"
    for n, phi in effort.boxes:
        yield from box(
            with_duration(
                scene_of(Case(n, phi, "periodic", "equal")), LONGER * effort.disk_time / n
            ),
            effort,
        )


def box(scene, effort):
    """The lines of one box, whose long run lasts as long as the scene."""
    engine, n, long = exact_run.prepare_scene(scene, scene.times), scene.particles, scene.times[-1:]
    melted = exactly(engine, draw_state(scene, 0), np.array([effort.melting]), {"all"}).whole
    state = draw_state(scene, 0)._replace(
        position=melted.position[-1], velocity=melted.velocity[-1]
    )
    alone = milliseconds_of_time(lambda times: exactly(engine, state, times), long, effort)
    pairs = exactly(engine, state, long).observables["pair_collisions"]
    for dt, collisions in product(effort.box_steps, COLLISIONS):
        stepping = timestep.prepare_scene(scene, Settings(dt, collisions))
        stepped = milliseconds_of_time(partial(timestep.run_steps, stepping, state), long, effort)
        found = timestep.run_steps(stepping, state, long).observables["pair_collisions"]
        bias, error = 100 * (found / pairs - 1), 100 * np.sqrt(1 / found + 1 / pairs)
        yield (
            f"| {n} | {scene.packing_fraction:.2f} | {alone:.3g} | {dt:g} | {collisions} | "
            f"{stepped:.3g} | "
            f"{stepped / alone:.1f} | {bias:.1f} +- {error:.1f} |"
        )


def milliseconds_of_time(run, long, effort):
    """Median CPU time for a unit of time [ms], by the difference of runs to time `long`, (1,), and
    to a part of it.
    """
    short = long / LONGER
    run(short)
    differences = [
        seconds(lambda: run(long), 1) - seconds(lambda: run(short), 1)
        for _ in range(effort.repeats)
    ]
    return 1e3 * float(np.median(differences) / (long - short)[0])


def with_duration(scene, duration):
    """The scene with another duration, sampled at its end."""
    return parse_scene(
        json.loads(scene.text) | {"duration": duration, "sample_interval": duration}, "benchmark"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a few short runs, of each kind")
    effort = QUICK if parser.parse_args().quick else FULL
    for table in (runs_of_the_note(effort), boxes(effort)):
        for line in table:
            print(line, flush=True)
        print()


if __name__ == "__main__":
    main()
