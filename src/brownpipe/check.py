"""What a scene or a study asks for, in words and numbers, before anything is run: `brownpipe check`."""

import math
from collections.abc import Sequence
from dataclasses import replace

from brownpipe import cost, friction, observables, reading
from brownpipe.engines import USUAL, Engine, refuse_unfit
from brownpipe.scene import MOST_BYTES, Scene, parse_scene
from brownpipe.study import Study, read_study

STUDY_KEYS = {"scenes", "seeds", "tolerance", "engines", "batch", "figures"}  # that no scene has
STEPS = 1000  # of a run, to name a cost of the time step engine
FEWEST = 10  # disks that make a gas


def describe(path: str, particles: int | None = None) -> str:
    """Return what the scene or study in the file asks for. Raises SceneError for whatever is wrong with it."""
    mapping = reading.read_yaml(path, MOST_BYTES)
    if isinstance(mapping, dict) and _is_study(mapping):
        if particles is not None:
            raise reading.SceneError(f"{path}: --particles is for scenes; a study says for itself")
        return "\n".join([f"{path}: a valid study", *_study(read_study(path))])
    return "\n".join([f"{path}: a valid scene", *_scene(parse_scene(mapping, path, particles))])


def _is_study(mapping: dict) -> bool:
    """A mistaken key of the other kind does not make a scene a study."""
    return "scenes" in mapping or ("box" not in mapping and bool(mapping.keys() & STUDY_KEYS))


def _scene(scene: Scene) -> list[str]:
    one = cost.of_run(scene)
    return [
        f"box       {scene.box.width:g} x {scene.box.height:g}, {scene.box.boundary}",
        f"disks     {_disks(scene)}; packing fraction {scene.packing_fraction:.4g}",
        f"start     {_start(scene)}",
        f"run       from t = 0 to {scene.duration:g}, {len(scene.times)} samples",
        f"engine    exact: {_engine(scene)}",
        f"expected  {_expected(scene, one)}",
        f"cost      some {in_time(one.seconds)} of CPU a run, once {cost.START_UP:g} s have passed to start;"
        f" {in_bytes(one.working)} of memory, {in_bytes(one.recorded)} of file",
        *_measured(scene, one),
        *_cautions(Engine("exact"), [scene]),
        *_others(scene),
    ]


def _disks(scene: Scene) -> str:
    kinds = [f"{one.count} {one.name} (radius {one.radius:g}, mass {one.mass:g})" for one in scene.species if one.count]
    return f"{scene.particles}: {', '.join(kinds)}" if kinds else f"{scene.particles}, each placed by hand"


def _start(scene: Scene) -> str:
    given = scene.velocities
    if given is None:
        return "as listed"
    width = f"kT = {given.temperature:g}" if given.standard_deviation is None else f"{given.standard_deviation:g} wide"
    placed = {"random": "placed at random", "lattice": "on a lattice"}[scene.placement]
    at_rest = ", total momentum zero" if given.zero_momentum else ""
    before = (
        f", {scene.equilibrate:g} before t = 0, tracer {scene.tracer_while_equilibrating}" if scene.equilibrate else ""
    )
    return f"{placed}; velocity components normal, {width}{at_rest}{before}"


def _expected(scene: Scene, one: cost.Cost) -> str:
    if scene.particles < FEWEST:
        return "too few disks to say"
    walls = f" and {_rounded(one.wall_collisions)} with walls" if not scene.box.periodic else ""
    return f"{_rounded(one.pair_collisions)} collisions between disks{walls} (Enskog, in equilibrium)"


def _measured(scene: Scene, one: cost.Cost) -> list[str]:
    """What each observable that the scene has would add to the CPU time of a run."""
    names = [name for name in observables.OBSERVABLES if observables.problem(scene, (name,)) is None]
    more = {name: cost.of_run(scene, observables=(name,)).seconds - one.seconds for name in names}
    listed = ", ".join(f"{name} {in_time(seconds)}" for name, seconds in more.items())
    return [f"measure   --observables adds to a run, one by one: {listed}"] if names else []


def _engine(scene: Scene) -> str:
    """What the engine will model of it, as it would lay it out."""
    from brownpipe.exact.setup import frame_of, prepare

    if scene.particles == 0:
        return "nothing moves"
    w = prepare(scene, frame_of(scene))
    alike = "equal disks" if w.mass is None else "radius and mass of each disk"
    edge = "periodic images" if scene.box.periodic else "walls"
    big = f", {w.big.number} much bigger than the rest" if w.big is not None else ""
    lists = ", neighbour lists" if w.lists is not None else ""
    ahead = ", events prefetched" if w.ahead is not None else ""
    return f"{edge}, {alike}{big}, {w.grid.columns} x {w.grid.lines} cells{lists}{ahead}"


def _others(scene: Scene) -> list[str]:
    """What the other engines would make of the scene."""
    step = Engine("timestep", (("time_step", scene.duration / STEPS), *USUAL.items()))
    stepping = f"in steps of --time-step; some {in_time(cost.of_engine(step, scene).seconds)} a run in {STEPS:,} steps"
    engine = Engine("langevin", (("friction", "enskog"),))
    try:
        refuse_unfit(engine, scene)
    except reading.SceneError as error:
        return [f"timestep  {stepping}", f"langevin  no: {str(error).partition('--engine langevin ')[2]}"]
    stochastic = f"{_model(engine, [scene])}; some {in_time(cost.of_engine(engine, scene).seconds)} a run"
    return [f"timestep  {stepping}", f"langevin  --friction enskog: {stochastic}", *_cautions(engine, [scene])]


def _model(engine: Engine, scenes: Sequence[Scene]) -> str:
    """What an engine will model, in words."""
    if engine.name == "exact":
        return "from collision to collision"
    if engine.name == "timestep":
        return "all disks, in steps"
    which = dict(engine.settings)["friction"]
    rates = [] if which == "measured" else sorted(friction.friction_rate(one, which) for one in scenes)
    gamma = " to ".join(dict.fromkeys(f"{rate:.3g}" for rate in rates[:1] + rates[-1:])) or "as measured"
    return f"the tracer alone, gamma = {gamma}; no 1/t tail of the velocity autocorrelation, no cage"


def _cautions(engine: Engine, scenes: Sequence[Scene]) -> list[str]:
    return [f"caution   {one}" for one in dict.fromkeys(cost.caution(engine, scene) for scene in scenes) if one]


def forecast(study: Study) -> str:
    """Return what running a study comes to, in one line. Its seeds must be known."""
    used, most, size = _uses(study), 0, 0.0
    for _, seeds, cases in used:
        most = max(most, len(seeds))
        size += len(seeds) * sum(cost.of_run(case, *_kept(study)).recorded for case in cases)
    runs = sum(len(seeds) * len(cases) for _, seeds, cases in used)
    seconds = sum(_seconds(study, *use) for use in used)
    jobs = f"{runs:,} runs in {len(study.jobs())} jobs of up to {min(study.batch, most):,} seeds"
    return f"{jobs}: some {in_time(seconds)} of CPU, {in_bytes(size)} in results/{study.name}"


def _study(study: Study) -> list[str]:
    study, remarks = _with_seeds(study)
    names = max(len(case.name) for case in study.cases)
    lines = [f"{'scene':<{names}}  {'N':>8} {'phi':>8} {'collisions':>11} {'CPU':>9} {'file':>9}  of a run"]
    for case in study.cases:
        one = cost.of_run(case, *_kept(study))
        count = _rounded(one.pair_collisions + one.wall_collisions)
        row = f"{case.particles:>8} {case.packing_fraction:>8.4f} {count:>11} {in_time(one.seconds):>9}"
        lines.append(f"{case.name:<{names}}  {row} {in_bytes(one.recorded):>9}")
    for engine, seeds, cases in _uses(study):
        where = "" if len(cases) == len(study.cases) else f" in {', '.join(dict.fromkeys(one.name for one in cases))}"
        some = f"some {in_time(_seconds(study, engine, seeds, cases))} of CPU"
        lines += [f"engine    {engine.label}{where}: {_model(engine, cases)}; {some}", *_cautions(engine, cases)]
    return [*lines, *remarks, f"total     {forecast(study)}", f"figures   {', '.join(study.figures)}"]


def _kept(study: Study) -> tuple:
    """What is kept and measured of each run."""
    return {study.record}, study.observables, study.average


def _seconds(study: Study, engine: Engine, seeds: Sequence[int], cases: Sequence[Scene]) -> float:
    """The CPU time [s] of an engine's jobs."""
    takes, batches = [cost.of_engine(engine, case, *_kept(study)) for case in cases], len(study.batches_of(seeds))
    return sum(batches * (cost.START_UP + one.once) + len(seeds) * one.seconds for one in takes)


def _uses(study: Study) -> list[tuple[Engine, Sequence[int], list[Scene]]]:
    """The engines, the seeds and the cases they are used for."""
    cases = {name: [case for case in study.cases if case.name == name] for name in study.table}
    return [
        (one.engine, one.seeds or study.seeds, [c for name in one.scenes for c in cases[name]]) for one in study.uses
    ]


def _with_seeds(study: Study) -> tuple[Study, list[str]]:
    """A study with a tolerance gets the number of seeds that runs with a scatter of 100 % would need."""
    if study.tolerance is None:
        return study, []
    runs = math.ceil(study.tolerance**-2)
    asked = f"as many as {study.observable} to {100 * study.tolerance:g} % needs, some {_rounded(runs)}"
    return replace(study, seeds=range(runs)), [f"seeds     {asked}; brownpipe plan says how many"]


def _rounded(count: float) -> str:
    """A count to two digits."""
    return f"{float(f'{count:.2g}'):,.0f}" if count < 1e9 else f"{count:.1e}"


def in_time(seconds: float) -> str:
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("min", 60.0), ("s", 1.0)):
        if seconds >= 2 * size or (unit == "s" and seconds >= size):
            return f"{seconds / size:.2g} {unit}" if seconds < 100 * size else f"{seconds / size:,.0f} {unit}"
    return f"{1e3 * seconds:.0f} ms" if seconds >= 0.01 else f"{1e3 * seconds:.2g} ms"


def in_bytes(count: float) -> str:
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{float(f'{count / size:.2g}'):g} {unit}"
    return f"{count:.0f} B"
