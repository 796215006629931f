"""Does the forecast of `brownpipe check` come true? CPU time of a run by observable, engine and scene, beside it.

    python benchmarks/bench_cost.py
    python benchmarks/bench_cost.py --quick     one scene, a run each

Medians over stretches of runs, the rows of a scene in turn, in one process; each is the difference of a call with many
runs and one with a single run, so that what a call takes once is left out. Ends with status 1 if a forecast is off by
more than a factor of 2.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe import observables
from brownpipe.engines import DEFINITIONS, Engine, configured
from brownpipe.errors import RequestError
from brownpipe.scene import read_scene

SCENES = Path(__file__).parent.parent / "config" / "scenes"
FULL = ("harrison2020", "heavy", "dense", "dilute", "fluid_014")
QUICK = ("harrison2020",)
STRETCH = 0.1  # CPU seconds of a call with many runs, as expected


TRACER = frozenset({"tracer"})
EXACT = Engine("exact")


class Request(NamedTuple):
    """What is kept of a run, what is measured in it, and the engine."""

    record: frozenset[str] = TRACER
    observables: tuple[str, ...] = ()
    average: str = "runs"
    engine: Engine = EXACT

    def forecast(self, scene):
        return self.engine.forecast(scene, self.record, self.observables, self.average).seconds


ALONE = [Request(TRACER, (name,), average) for average in observables.AVERAGES for name in observables.OBSERVABLES]
REQUESTS = [
    Request(),
    Request(frozenset({"all"})),
    *ALONE,
    Request(TRACER, tuple(observables.OBSERVABLES)),
]


def measured(scene, requests, stretches, stretch):
    """Median CPU seconds of a run for each of the requests; calls of about `stretch` CPU seconds."""
    runs = [1 + int(stretch / request.forecast(scene)) for request in requests]
    taken = np.empty((stretches, len(requests)))
    for request in requests:
        seconds_of_call(scene, request, 1)
    for row in taken:
        for k, (request, number) in enumerate(zip(requests, runs, strict=True)):
            row[k] = (seconds_of_call(scene, request, 1 + number) - seconds_of_call(scene, request, 1)) / number
    return np.median(taken, axis=0)


def seconds_of_call(scene, request, runs):
    """CPU seconds of a call with so many runs."""
    begun = time.process_time()
    request.engine.simulate(
        scene, range(runs), request.record, observables=request.observables, average=request.average
    )
    return time.process_time() - begun


def fit(scene):
    """The requests that the scene allows, also of other engines with the settings that `brownpipe check` names."""
    others = [configured(name, **DEFINITIONS[name].candidates(scene)[0]) for name in DEFINITIONS if name != EXACT.name]
    requests = [*REQUESTS, *(Request(engine=engine) for engine in others if allows(engine, scene))]
    return [one for one in requests if observables.problem(scene, one.observables, one.average) is None]


def allows(engine, scene):
    """Whether the engine can run the scene."""
    try:
        engine.refuse_unfit(scene)
    except RequestError:
        return False
    return True


def words(request):
    if request.engine != EXACT:
        return request.engine.options
    names = "all observables" if len(request.observables) > 1 else "".join(request.observables)
    average = "" if request.average == "runs" else f", over {request.average}"
    return f"{names}{average}" if names else f"record {''.join(request.record)}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="one scene, a run each")
    quick, off = parser.parse_args().quick, []
    print("| scene | measured in a run | expected, ms | taken, ms | ratio |\n|---|---|---|---|---|")
    for name in QUICK if quick else FULL:
        scene = read_scene(SCENES / f"{name}.yaml")
        requests = fit(scene)
        times = measured(scene, requests, *((1, 0.0) if quick else (5, STRETCH)))
        for request, seconds in zip(requests, times, strict=True):
            expected = request.forecast(scene)
            row = f"{1e3 * expected:.3g} | {1e3 * seconds:.3g} | {expected / seconds:.2f}"
            print(f"| {name} | {words(request)} | {row} |", flush=True)
            off += [] if quick or 0.5 <= expected / seconds <= 2.0 else [f"{name}, {words(request)}"]
    if off:
        sys.exit(f"expected and taken differ by more than a factor of 2: {'; '.join(off)}")


if __name__ == "__main__":
    main()
