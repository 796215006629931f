"""`brownpipe check`: what a scene or study will simulate, and its expected cost, before anything is run.

The report has one line per property, which begins with a word of at most nine letters. Collisions and CPU times come
from `engines.forecast`; nothing is simulated or timed here.
"""

from collections.abc import Sequence
from itertools import chain

from brownpipe import observables
from brownpipe.engines import DEFINITIONS, Engine, configured, forecast
from brownpipe.engines.exact.layout import prepare
from brownpipe.engines.placement import lattice_sites
from brownpipe.engines.saturation import placement_caution
from brownpipe.engines.settling import FEWEST_DISKS, settling_caution, settling_in_words
from brownpipe.engines.units import frame_of
from brownpipe.errors import RequestError
from brownpipe.formatting import in_bytes, in_time
from brownpipe.quoting import in_lines
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.scene import is_study
from brownpipe.scene.yaml_file import read_yaml
from brownpipe.study import Study, read_study
from brownpipe.study.study import REFERENCE
from brownpipe.study.workload import LONG, cautions, describe_workload, with_assumed_runs, workloads

RUNS = 100  # of a scene, for which its placement should succeed


def describe_scene_or_study(path: str, particles: int | None = None) -> str:
    """Return a description of the scene or study in a file. Raises RequestError for any mistake in it."""
    mapping = read_yaml(path)
    if isinstance(mapping, dict) and is_study(mapping):
        if particles is not None:
            raise RequestError(f"{path}: --particles is for scenes; a study says for itself")
        return in_lines([f"{path}: a valid study", *_study(read_study(path))])
    return in_lines([f"{path}: a valid scene", *_scene(parse_scene(mapping, path, particles))])


def _scene(scene: Scene) -> list[str]:
    """Return the lines of the report on a scene."""
    cost = forecast.of_run(scene)
    return [
        f"box       {scene.box.width:g} x {scene.box.height:g}, {scene.box.boundary}",
        f"disks     {_disks(scene)}; packing fraction {scene.packing_fraction:.4g}",
        f"start     {_start(scene)}",
        *([f"settle    {settling}"] if (settling := settling_in_words(scene)) else []),
        f"run       from t = 0 to {scene.duration:g}, {len(scene.times)} samples",
        f"engine    exact: {_exact_model(scene)}",
        f"expected  {_collisions(scene, cost)}",
        f"cost      some {in_time(cost.seconds + cost.storing)} of CPU per run, after {forecast.START_UP:g} s to start;"
        f" {in_bytes(forecast.memory(cost, 1))} of memory for one run, {in_bytes(cost.recorded)} of file per run",
        *_observables(scene, cost),
        *_cautions(REFERENCE, [scene]),
        *_foreseen(scene, cost),
        *_approximate_engines(scene),
    ]


def _disks(scene: Scene) -> str:
    """Return number, radius and mass of the disks of each species."""
    species = [f"{s.count} {s.name} (radius {s.radius:g}, mass {s.mass:g})" for s in scene.species if s.count]
    return f"{scene.particles}: {', '.join(species)}" if species else f"{scene.particles}, listed one by one"


def _start(scene: Scene) -> str:
    """Return how positions and velocities are drawn, and how they are equilibrated."""
    velocities = scene.velocities
    if velocities is None:
        return "as listed"
    placed = {"random": "placed at random", "lattice": "on a lattice"}[scene.placement]
    width = (
        f"with kT = {velocities.temperature:g}"
        if velocities.standard_deviation is None
        else f"with standard deviation {velocities.standard_deviation:g}"
    )
    zero_momentum = ", total momentum zero" if velocities.zero_momentum else ""
    tracer = scene.equilibrate.tracer
    equilibrated = f"; equilibrated for {scene.equilibrate.time:g}, tracer {tracer}" if scene.equilibrate.time else ""
    return f"{placed}; velocity components normal {width}{zero_momentum}{equilibrated}"


def _collisions(scene: Scene, cost: forecast.Cost) -> str:
    """Return the expected numbers of collisions of a run."""
    if scene.particles < FEWEST_DISKS:
        return "too few disks to predict collisions"
    walls = f" and {_rounded(cost.wall_collisions)} with walls" if not scene.box.periodic else ""
    return f"{_rounded(cost.pair_collisions)} collisions between disks{walls} per run (Enskog, in equilibrium)"


def _observables(scene: Scene, cost: forecast.Cost) -> list[str]:
    """Return the CPU time that each observable allowed in the scene would add to a run."""
    names = [name for name in observables.OBSERVABLES if observables.problem(scene, (name,)) is None]
    added = {name: forecast.of_run(scene, observables=(name,)).seconds - cost.seconds for name in names}
    listed = ", ".join(f"{name} {in_time(seconds)}" for name, seconds in added.items())
    return [f"measure   CPU time that each of --observables adds to a run: {listed}"] if names else []


def _exact_model(scene: Scene) -> str:
    """Return how the exact engine will represent the scene: its boundary, disks and search structures."""
    if scene.particles == 0:
        return "nothing moves"
    w = prepare(scene, frame_of(scene))
    boundary = "periodic images" if scene.box.periodic else "walls"
    disks = "equal disks" if w.mass is None else "disks of different radius or mass"
    big = f", {w.big.number} much larger than the rest" if w.big is not None else ""
    lists = ", neighbour lists" if w.lists is not None else ""
    prefetch = ", events prefetched" if w.deferred is not None else ""
    return f"{boundary}, {disks}{big}, {w.grid.columns} x {w.grid.rows} cells{lists}{prefetch}"


def _approximate_engines(scene: Scene) -> list[str]:
    """Return, for every other engine, what it models of the scene and at what cost, or why it cannot run it."""
    lines = []
    for name, definition in DEFINITIONS.items():
        if definition is REFERENCE.definition:
            continue
        engine = configured(name, **definition.candidates(scene)[0])
        try:
            engine.refuse_unfit(scene)
        except RequestError as error:
            lines.append(f"{name:<9} no: {str(error).partition(f'--engine {name} ')[2] or error}")
            continue
        options = engine.options.partition(" ")[2]
        model = f"{options}: {engine.model([scene])}" if options else engine.model([scene])
        cost = engine.forecast(scene)
        seconds = cost.seconds + cost.storing
        lines += [f"{name:<9} {model}; some {in_time(seconds)} per run", *_cautions(engine, [scene])]
    return lines


def _foreseen(scene: Scene, cost: forecast.Cost) -> list[str]:
    """Return a line for each reason why a run of the exact engine will fail or take days."""
    reasons = [_placement(REFERENCE, scene, RUNS), settling_caution(scene)]
    try:
        forecast.refuse_too_large(scene, 1, cost)
    except RequestError as error:
        reasons.append(str(error))
    seconds = cost.seconds + cost.storing
    if seconds >= LONG:
        interrupted = "`simulate --checkpoint-every` lets it be interrupted"
        reasons.append(f"{scene.name}: a run takes some {in_time(seconds)} of CPU on one core; {interrupted}")
    return [f"caution   {reason}" for reason in reasons if reason is not None]


def _placement(engine: Engine, scene: Scene, runs: int) -> str | None:
    """Return one line of caution if the disks that an engine needs are likely to find no places in some of the runs."""
    placed = engine.definition.scene_with_disks(scene, dict(engine.settings))
    if placed is None:
        return None
    if placed.placement == "lattice" and placed.species:
        try:
            lattice_sites(placed)
        except RequestError as error:
            return f"{placed.name}, N = {placed.particles}: every run will be refused: {error}"
    return placement_caution(placed, runs)


def _cautions(engine: Engine, scenes: Sequence[Scene]) -> list[str]:
    """Return a line for each limit of the engine's results in these scenes, each once."""
    cautions = dict.fromkeys(engine.definition.caution(scene) for scene in scenes)
    return [f"caution   {caution}" for caution in cautions if caution]


def _study(study: Study) -> list[str]:
    """Return the lines of the report on a study: a table of its cases, its engines and the whole workload."""
    study, seeds = _with_seeds(study)
    width = max(len(case.name) for case in study.cases)
    by_engine = workloads(study)
    parts = [*chain.from_iterable(by_engine)]
    lines = [f"{'scene':<{width}}  {'N':>8} {'phi':>8} {'collisions':>11} {'CPU':>9} {'file':>9}  per run"]
    for case in study.cases:
        used = ((part.engine, part.cost) for part in parts if part.case is case)
        engine, cost = next(used, (REFERENCE, forecast.of_run(case, *study.recording)))  # where none runs it
        collisions = _rounded(cost.pair_collisions + cost.wall_collisions) if cost.pair_collisions else "-"
        seconds = in_time(cost.seconds + cost.storing)
        row = f"{case.particles:>8} {case.packing_fraction:>8.4f} {collisions:>11} {seconds:>9}"
        by = "" if engine == REFERENCE else f"  {engine.label}"
        lines.append(f"{case.name:<{width}}  {row} {in_bytes(cost.recorded):>9}{by}")
    for of_engine in by_engine:
        engine, cases = of_engine[0].engine, [part.case for part in of_engine]
        names = ", ".join(dict.fromkeys(case.name for case in cases))
        where = "" if len(cases) == len(study.cases) else f" in {names}"
        model = f"{engine.model(cases)}; some {in_time(sum(part.seconds for part in of_engine))} of CPU"
        lines += [f"engine    {engine.label}{where}: {model}", *_cautions(engine, cases)]
    placements = [_placement(part.engine, part.case, len(part.seeds)) for part in parts]
    settling = [settling_caution(case) for case in study.cases]
    foreseen = dict.fromkeys(filter(None, [*placements, *settling, *cautions(study)]))
    lines += [f"caution   {reason}" for reason in foreseen]
    return [*lines, *seeds, f"total     {describe_workload(study)}", f"figures   {', '.join(study.figures)}"]


def _with_seeds(study: Study) -> tuple[Study, list[str]]:
    """Return a study with a tolerance with as many seeds as it is assumed to need, and a line that says so."""
    if study.tolerance is None:
        return study, []
    assumed = with_assumed_runs(study)
    runs = len(assumed.seeds)
    goal = f"{study.target} to {100 * study.tolerance:g} %"
    line = f"seeds     as many as {goal} needs: about {_rounded(runs)}, to be determined by pilot runs (brownpipe plan)"
    return assumed, [line]


def _rounded(count: float) -> str:
    """Return a count to two significant digits."""
    return f"{float(f'{count:.2g}'):,.0f}" if count < 1e9 else f"{count:.1e}"
