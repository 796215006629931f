"""How fast the exact engine is: pair collisions per CPU second and bytes per disk, and what each
feature costs.

    make bench                      writes its section of docs/benchmarks.md and
    docs/figures/speed.png
    python benchmarks/bench_exact.py --quick     every part of it with a few events each, nothing
    written

A figure is the median over stretches of one run that was melted before, in CPU time of one core.
Compare figures of one table with each other: machines differ, and a busy one has less cache to
itself.
"""

import argparse
import math
import multiprocessing
import os
import platform
import time
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.events import advance
from brownpipe.engines.exact.layout import begin_run, with_fitting_buckets
from brownpipe.engines.exact.run import events_so_far, prepare_scene, time_since_start
from brownpipe.engines.start.initial_state import draw_state
from brownpipe.engines.units import motion_of
from brownpipe.errors import RequestError
from brownpipe.figures import style
from brownpipe.scene import parse_scene
from brownpipe.storage.configurations import read_scene

ROOT = Path(__file__).parent.parent
FOR_EVER = np.array([1e9])
NOTE = ROOT / "config/scenes/harrison2020.yaml"
NUMBERS, FRACTIONS = (150, 1_000, 10_000, 100_000, 1_000_000), (0.14, 0.5, 0.7)
# Radius and mass of the species, in equal numbers; a big disk comes on top. A lattice has room for
# 1.25 at phi = 0.7.
MIXTURES = {
    "equal": [(0.5, 1.0)],
    "two masses": [(0.5, 1.0), (0.5, 2.0)],
    "radii 1 and 1.25": [(0.5, 1.0), (0.625, 1.5625)],
    "one of radius 50": [(0.5, 1.0)],
}
# per disk: after some 10 disks leave the squares of their neighbour lists at a constant rate
EVENTS_TO_MELT = 20
BIG = {"radius": 25.0, "mass": 1000.0}


class Case(NamedTuple):
    """One cell of the table."""

    n: int
    phi: float  # of the big disk's bath, without it
    boundary: str
    mixture: str


class Speed(NamedTuple):
    """What was measured of a case."""

    rate: float  # pair collisions per CPU second
    spread: float  # largest deviation of a stretch from that, relative
    size: float  # bytes of the workspace per disk


class Effort(NamedTuple):
    """How much is measured."""

    numbers: tuple[int, ...]  # of disks
    rows: list[tuple[str, str]]  # of the table: boundary, mixture
    melting: int  # events before anything is timed, at least
    events: int  # of a timed stretch, at least
    stretches: int  # of which the median is taken
    runs: int  # of the note's scene
    together: tuple[int, ...]  # numbers of disks run in two processes at once


WALLED = ("equal", "radii 1 and 1.25", "one of radius 50")
ROWS = [("periodic", name) for name in MIXTURES if name != WALLED[-1]] + [
    ("reflecting", name) for name in WALLED
]
FULL = Effort(NUMBERS, ROWS, 400_000, 150_000, 5, 400, (1_000, 100_000))
QUICK = Effort(NUMBERS[:1], ROWS[:1], 2_000, 2_000, 1, 10, NUMBERS[:1])


def scene_of(case):
    """A scene with small disks of diameter 1 and kT = 1."""
    n, phi, boundary, mixture = case
    each, big = n // len(MIXTURES[mixture]), mixture == "one of radius 50"
    area = sum(each * math.pi * radius**2 for radius, _ in MIXTURES[mixture]) / phi
    side = math.sqrt(area + big * math.pi * (BIG["radius"] + 0.5) ** 2) + (boundary == "reflecting")
    species = [
        {"name": f"s{j}", "count": each, "radius": r, "mass": m}
        for j, (r, m) in enumerate(MIXTURES[mixture])
    ]
    tracer = {"tracer": BIG | {"position": [side / 2, side / 2]}} if big else {}
    return parse_scene(
        {
            "box": {"x": [0.0, side], "y": [0.0, side], "boundary": boundary},
            "disks": tracer
            | {"species": species, "placement": "random" if phi < 0.3 else "lattice"},
            "velocities": {"temperature": 1.0},
            "duration": FOR_EVER[0],
        },
        "benchmark",
    )


def started(scene, effort, change=None, record=()):
    """A melted run, its buckets as in `run.run_to_end`: workspace and recorder. `change` gives a
    workspace more to do.
    """
    engine = prepare_scene(scene, FOR_EVER, record)
    w = engine.workspace if change is None else change(engine.workspace)
    room = engine.recorder
    begin_run(w, motion_of(draw_state(scene, 0), engine.frame))
    melting = max(effort.melting, EVENTS_TO_MELT * scene.particles)
    go_on(w, room, melting // 2)
    w = with_fitting_buckets(w, events_so_far(w), time_since_start(w), w.calendar.width)
    go_on(w, room, melting // 2)
    return w, room


def go_on(w, room, events):
    """Let so many events happen, and return the rate of pair collisions per CPU second."""
    done, begun, until = w.count[ws.PAIRS], time.process_time(), w.count.sum() + events
    while (left := int(until - w.count.sum())) > 0:
        outcome = advance(w, room, left)
        w.progress[ws.LOGGED] = 0
        if outcome == ws.CELL_FULL:
            raise RuntimeError("a cell or a list has too little room")
    return (w.count[ws.PAIRS] - done) / (time.process_time() - begun)


def speed_of(case, effort):
    """Return the Speed of a case."""
    w, room = started(scene_of(case), effort)
    rates = [go_on(w, room, max(effort.events, case.n // 4)) for _ in range(effort.stretches)]
    arrays = [
        array for array in (*w, *(w.big or ()), *(w.lists or ())) if isinstance(array, np.ndarray)
    ]
    sizes = {
        array.ctypes.data: array.nbytes for array in arrays
    }  # two may be views of the same memory
    rate = float(np.median(rates))
    return Speed(rate, max(abs(one / rate - 1) for one in rates), sum(sizes.values()) / case.n)


# -- what a feature costs --------------------------------------------------------------------------


def with_masses(w):
    """A workspace that looks up the radius and the mass of each disk, equal as they are."""
    return w._replace(mass=np.ones(len(w.disk) // ws.ROW))


def with_big_disks(w):
    """A workspace that asks of each disk whether it is a big one; there is none."""
    none = np.zeros((0, 2), np.int64)
    return w._replace(big=ws.BigDisks(0, np.zeros(1, np.int64), none, np.zeros(1, np.int64), none))


FEATURES = {
    "radius and mass of each disk": (with_masses, ()),
    "big disks, and radius and mass of each": (lambda w: with_big_disks(with_masses(w)), ()),
    "log of all collisions": (None, {"events"}),
}


def cost_of_features(n, phi, effort):
    """Yield each feature with the CPU time a collision takes with it, relative to the same run
    without; alternating.
    """
    scene = scene_of(Case(n, phi, "periodic", "equal"))
    plain, events = (
        started(scene, effort),
        5 * effort.events,
    )  # long ones, as the differences are small
    for name, (change, record) in FEATURES.items():
        other, stretches = started(scene, effort, change, record), 2 * effort.stretches - 1
        ratios = [go_on(*plain, events) / go_on(*other, events) for _ in range(stretches)]
        yield name, float(np.median(ratios))


# -- runs of the note's scene, and two processes ---------------------------------------------------


def milliseconds_per_run(effort):
    """Median CPU time of a run of the note's scene: the engine alone, and with drawing, sampling
    and reporting.
    """
    scene, runs = read_scene(NOTE), effort.runs
    engine, states = (
        prepare_scene(scene, scene.times),
        [draw_state(scene, seed) for seed in range(runs)],
    )
    w, room = engine.workspace, engine.recorder
    alone, whole, pairs = [], [], 0
    for _ in range(effort.stretches):
        begun = time.process_time()
        for state in states:
            begin_run(w, motion_of(state, engine.frame))
            advance(w, room, 10**9)
        alone.append((time.process_time() - begun) / runs * 1e3)
        begun = time.process_time()
        pairs = exact.simulate(scene, range(runs)).observables["pair_collisions"].mean()
        whole.append((time.process_time() - begun) / runs * 1e3)
    return float(np.median(alone)), float(np.median(whole)), pairs


def note_rate(effort, wait):
    """Pair collisions per second of wall time in runs of the note's scene, all processes beginning
    together.
    """
    scene, pairs = read_scene(NOTE), 0
    exact.simulate(scene, range(10))
    wait()
    begun = time.monotonic()
    for first in range(0, 10 * effort.runs, effort.runs):
        pairs += (
            exact.simulate(scene, range(first, first + effort.runs))
            .observables["pair_collisions"]
            .sum()
        )
    return pairs / (time.monotonic() - begun)


def case_rate(case, effort, wait):
    """Pair collisions per second of wall time in a large box, all processes beginning together."""
    w, room = started(scene_of(case), effort)
    wait()
    begun, done = time.monotonic(), w.count[ws.PAIRS]
    go_on(w, room, 5 * effort.melting)
    return (w.count[ws.PAIRS] - done) / (time.monotonic() - begun)


def measure_what_is_asked(pipe):
    """A process that measures one rate after the other: it says when it is ready, and waits until
    all others are.
    """

    def wait():
        pipe.send("ready")
        pipe.recv()

    while (work := pipe.recv()) is not None:
        pipe.send(work(wait))


def started_processes(number):
    """The pipes to so many processes of their own."""
    context, pipes = multiprocessing.get_context("spawn"), []
    for _ in range(number):
        mine, its = context.Pipe()
        context.Process(target=measure_what_is_asked, args=(its,), daemon=True).start()
        its.close()  # else nobody would notice if the process died
        pipes.append(mine)
    return pipes


def together(work, pipes):
    """The sum of the rates of the processes at once."""
    for pipe in pipes:
        pipe.send(work)
    for pipe in pipes:
        pipe.recv()
    for pipe in pipes:
        pipe.send("go")
    return sum(pipe.recv() for pipe in pipes)


def ensembles(effort):
    """Yield what is run, the rate of one process and that of two at once: the medians of both,
    measured in turn.
    """
    works = {"the note's scene, N = 150": partial(note_rate, effort)}
    for n in effort.together:
        works[f"periodic, equal, phi = 0.5, N = {n}"] = partial(
            case_rate, Case(n, 0.5, "periodic", "equal"), effort
        )
    groups = [started_processes(number) for number in (1, 2)]
    for name, work in works.items():
        rates = [[together(work, pipes) for pipes in groups] for _ in range(effort.stretches)]
        yield name, *np.median(rates, axis=0)
    for pipe in (pipe for pipes in groups for pipe in pipes):
        pipe.send(None)


# -- the report ------------------------------------------------------------------------------------


def processor():
    """The name of the processor."""
    for line in (
        Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else ()
    ):
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def report(effort, speeds):
    """The results as Markdown, a line at a time; the Speed of each case is put into `speeds`."""
    yield f"One core of an {processor()}.\n"
    loads = [os.getloadavg()[0]]
    alone, whole, pairs = milliseconds_per_run(effort)
    yield (
        f"The note's scene (N = 150, t = 1): {alone:.3f} ms of CPU time per run for the engine, "
        f"{pairs / alone / 1e3:.2f} million pair collisions per second;\n"
        f"{whole:.3f} ms with the drawing of the initial state and the report.\n"
    )
    yield "Million pair collisions per CPU second, and bytes of working memory per disk:\n"
    yield "| N | box | disks | phi = 0.14 | 0.5 | 0.7 | bytes per disk |"
    yield "|---|---|---|---|---|---|---|"
    for boundary, mixture in effort.rows:
        for n in effort.numbers:
            cases = [Case(n, phi, boundary, mixture) for phi in FRACTIONS]
            speeds |= {case: speed_of(case, effort) for case in cases if can_be_placed(case)}
            rates = [f"{speeds[case].rate / 1e6:.2f}" if case in speeds else "" for case in cases]
            size = max(speeds[case].size for case in cases if case in speeds)
            yield f"| {n} | {boundary} | {mixture} | {' | '.join(rates)} | {size:.0f} |"
            loads.append(os.getloadavg()[0])
    spreads = [100 * speed.spread for speed in speeds.values()]
    yield (
        f"\nIntervals deviate from their entry's median by at most {np.median(spreads):.0f} % in "
        "half of the entries, "
        f"by {max(spreads):.0f} % at most.\nLoad of the machine meanwhile: {min(loads):.1f} to "
        f"{max(loads):.1f} "
        f"processes on {os.cpu_count()} hardware threads, this program included."
    )
    yield (
        "\nCPU time of a collision with a feature that the scene does not need, relative to that "
        "without it "
        "(N = 1000, periodic,\nequal disks):\n"
    )
    yield "| | phi = 0.14 | 0.5 |\n|---|---|---|"
    columns = (cost_of_features(1_000, phi, effort) for phi in FRACTIONS[:2])
    for (name, dilute), (_, dense) in zip(*columns, strict=True):
        yield f"| {name} | {dilute:.2f} | {dense:.2f} |"
    yield (
        "\nMillion pair collisions per second of wall time, by one process and by two at the same "
        "time:\n"
    )
    yield "| | one | two |\n|---|---|---|"
    for name, one, two in ensembles(effort):
        yield f"| {name} | {one / 1e6:.2f} | {two / 1e6:.2f} |"


def write(name, text):
    """Replace the text between the two comments of this name on the page of benchmarks."""
    page, start, end = (
        ROOT / "docs" / "benchmarks.md",
        f"<!-- {name} -->\n",
        f"<!-- end of {name} -->",
    )
    before, _, rest = page.read_text().partition(start)
    page.write_text(f"{before}{start}{text}\n{end}{rest.partition(end)[2]}")


def can_be_placed(case):
    """Whether its disks find places: the densest may not, beside a big disk or between walls."""
    try:
        return len(draw_state(scene_of(case), 0).position) > 0
    except RequestError:
        return False


def drawn(speeds):
    """The picture, bytes of a PNG: the cost of a collision against the number of disks."""
    with style.drawing():
        figure, ((axes,),) = style.grid(1, 1, 5.6, 4.2)
        for colour, phi in zip((style.DATA, style.FIT, style.MODEL), FRACTIONS, strict=True):
            for dashes, row in (
                ("-", ("periodic", "equal")),
                (style.DASHED, ("periodic", "radii 1 and 1.25")),
            ):
                there = [case for case in speeds if case.phi == phi and case[2:] == row]
                cost = [1e6 / speeds[case].rate for case in there]
                label = rf"$\varphi$ = {phi:g}" if dashes == "-" else None
                axes.plot(
                    [case.n for case in there],
                    cost,
                    color=colour,
                    linestyle=dashes,
                    marker="o",
                    ms=4,
                    label=label,
                )
        axes.set(
            xscale="log",
            ylim=(0, None),
            xlabel="number of disks",
            ylabel="CPU time of a pair collision [µs]",
        )
        style.put_titles_and_legends([axes], ["Periodic box: equal disks; dashed: two radii"])
        return style.image_bytes(figure, "png")


def main():
    """Print the report, and keep it unless it is a quick one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="a few events of each kind, nothing written"
    )
    quick, lines, speeds = parser.parse_args().quick, [], {}
    for line in report(QUICK if quick else FULL, speeds):
        print(line, flush=True)
        lines.append(line)
    picture = drawn(speeds)
    if not quick:
        write("exact", "\n".join(lines))
        (ROOT / "docs/figures/speed.png").write_bytes(picture)


if __name__ == "__main__":
    main()
