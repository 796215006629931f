"""What a time step costs and spoils: the time-stepping engine beside the exact one, the tables of docs/decisions.md.

    python benchmarks/bench_timestep.py

CPU time of one core, medians, both engines by turns in one process, from the same states, with sampling and reporting
but without drawing states. Bias: the mean difference in pair collisions from the exact engine, seed by seed.
"""

import json
import time

import numpy as np
from bench_exact import ROOT, scene_of

from brownpipe import exact, timestep
from brownpipe.analysis.departure import SHARE, departure_time
from brownpipe.scene import SceneError, parse_scene, read_scene
from brownpipe.state import draw

STEPS = (3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2)


def seconds(run, repeats=5):
    """Median CPU time of a call."""
    spent = []
    for _ in range(repeats):
        begun = time.process_time()
        run()
        spent.append(time.process_time() - begun)
    return float(np.median(spent))


def runs_of_the_note(seeds=400):
    """Time per run, bias, missed collisions and departure against the time step, in the note's scene."""
    scene = read_scene(ROOT / "config/scenes/harrison2020.yaml")
    states, there = [draw(scene, seed) for seed in range(100)], exact.simulate(scene, range(seeds))
    reference = exact.prepared(scene)
    alone = seconds(lambda: [exact.run(reference, state, scene.times) for state in states]) * 10
    pairs = there.observables["pair_collisions"]
    yield f"exact: {alone:.3f} ms a run, {pairs.mean():.1f} pair collisions\n"
    yield "| dt | double, ms | single, ms | of exact | bias, % | missed, % | departs at, median | worst overlap |"
    yield "|---|---|---|---|---|---|---|---|"
    for dt in STEPS:
        few = states[: 100 if dt > 1e-4 else 20]
        double, single = (1e3 / len(few) * spent(scene, few, scene.times, dt, one) for one in ("double", "single"))
        run = timestep.simulate(scene, range(seeds), time_step=dt)
        less = 100 * (run.observables["pair_collisions"] - pairs) / pairs.mean()
        missed = 100 * run.observables["missed_collisions"].mean() / pairs.mean()
        departed = departure_time(scene.times, run.tracer.position, there.tracer.position, SHARE * scene.radius[0])
        yield (
            f"| {dt:g} | {double:.2f} | {single:.2f} | {double / alone:.1f} | {less.mean():.2f} +- "
            f"{less.std(ddof=1) / seeds**0.5:.2f} | {missed:.2f} | {np.median(departed):.2f} | "
            f"{np.median(run.observables['worst_overlap']):.3f} |"
        )


def spent(scene, states, times, dt, precision):
    """Median CPU time of runs from states; NaN where the time step is refused."""
    try:
        engine = timestep.prepared(scene, dt, precision)
    except SceneError:
        return float("nan")
    return seconds(lambda: [timestep.run(engine, state, times) for state in states], 3)


def boxes(duration=3.0):
    """Time per unit of time against N, packing fraction and time step, in periodic boxes that were melted before."""
    yield "| N | phi | exact, ms | dt | double, ms | single, ms | of exact | bias, % |"
    yield "|---|---|---|---|---|---|---|---|"
    for n, phi in ((150, 0.14), (150, 0.7), (1000, 0.14), (1000, 0.7), (10000, 0.14), (10000, 0.7)):
        yield from box(to_mapping(scene_of(n, phi, "periodic", "equal"), duration), duration * min(1.0, 3000 / n))


def box(mapping, duration):
    """The lines of one box."""
    scene, times = parse_scene(mapping, "benchmark"), np.array([duration])
    engine, n = exact.prepared(scene), scene.particles
    melted = exact.run(engine, draw(scene, 0), np.array([2.0]), {"all"}).whole
    state = draw(scene, 0)._replace(position=melted.position[-1], velocity=melted.velocity[-1])
    alone = seconds(lambda: exact.run(engine, state, times), 3) / duration * 1e3
    pairs = exact.run(engine, state, times).observables["pair_collisions"]
    for dt in (1e-4, 1e-3, 1e-2):
        double, single = (1e3 / duration * spent(scene, [state], times, dt, one) for one in ("double", "single"))
        found = timestep.run(timestep.prepared(scene, dt), state, times).observables["pair_collisions"]
        yield (
            f"| {n} | {scene.packing_fraction:.2f} | {alone:.2f} | {dt:g} | {double:.2f} | {single:.2f} | "
            f"{double / alone:.1f} | {100 * (found / pairs - 1):.1f} |"
        )


def to_mapping(scene, duration):
    """The scene with another duration."""
    return json.loads(scene.text) | {"duration": duration, "sample_interval": duration}


if __name__ == "__main__":
    for table in (runs_of_the_note(), boxes()):
        for line in table:
            print(line, flush=True)
        print()
