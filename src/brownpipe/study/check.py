"""What a scene or a study asks for, in words and numbers, before anything is run: `brownpipe check`."""

import math
from collections.abc import Sequence
from dataclasses import replace

from brownpipe import observables
from brownpipe.engines import DEFINITIONS, Engine, configured, forecast
from brownpipe.engines.exact.layout import prepare
from brownpipe.engines.units import frame_of
from brownpipe.errors import RequestError
from brownpipe.formatting import in_bytes, in_time
from brownpipe.scene import Scene, parse_scene, reading
from brownpipe.scene.scene_file import MOST_BYTES
from brownpipe.study import Study, read_study
from brownpipe.study.total import kept_of, seconds_of, total, uses_of

STUDY_KEYS = {"scenes", "seeds", "tolerance", "engines", "batch", "figures"}  # that no scene has
FEWEST = 10  # disks that make a gas


def describe(path: str, particles: int | None = None) -> str:
    """Return what the scene or study in the file asks for. Raises RequestError for whatever is wrong with it."""
    mapping = reading.read_yaml(path, MOST_BYTES)
    if isinstance(mapping, dict) and _is_study(mapping):
        if particles is not None:
            raise RequestError(f"{path}: --particles is for scenes; a study says for itself")
        return "\n".join([f"{path}: a valid study", *_study(read_study(path))])
    return "\n".join([f"{path}: a valid scene", *_scene(parse_scene(mapping, path, particles))])


def _is_study(mapping: dict) -> bool:
    """A mistaken key of the other kind does not make a scene a study."""
    return "scenes" in mapping or ("box" not in mapping and bool(mapping.keys() & STUDY_KEYS))


def _scene(scene: Scene) -> list[str]:
    one = forecast.of_run(scene)
    return [
        f"box       {scene.box.width:g} x {scene.box.height:g}, {scene.box.boundary}",
        f"disks     {_disks(scene)}; packing fraction {scene.packing_fraction:.4g}",
        f"start     {_start(scene)}",
        f"run       from t = 0 to {scene.duration:g}, {len(scene.times)} samples",
        f"engine    exact: {_engine(scene)}",
        f"expected  {_expected(scene, one)}",
        f"cost      some {in_time(one.seconds)} of CPU a run, once {forecast.START_UP:g} s have passed to start;"
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


def _expected(scene: Scene, one: forecast.Cost) -> str:
    if scene.particles < FEWEST:
        return "too few disks to say"
    walls = f" and {_rounded(one.wall_collisions)} with walls" if not scene.box.periodic else ""
    return f"{_rounded(one.pair_collisions)} collisions between disks{walls} (Enskog, in equilibrium)"


def _measured(scene: Scene, one: forecast.Cost) -> list[str]:
    """What each observable that the scene has would add to the CPU time of a run."""
    names = [name for name in observables.OBSERVABLES if observables.problem(scene, (name,)) is None]
    more = {name: forecast.of_run(scene, observables=(name,)).seconds - one.seconds for name in names}
    listed = ", ".join(f"{name} {in_time(seconds)}" for name, seconds in more.items())
    return [f"measure   --observables adds to a run, one by one: {listed}"] if names else []


def _engine(scene: Scene) -> str:
    """What the engine will model of it, as it would lay it out."""
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
    lines = []
    for name, definition in DEFINITIONS.items():
        if name == "exact":
            continue
        one = configured(name, **definition.candidates(scene)[0])
        try:
            one.refuse_unfit(scene)
        except RequestError as error:
            lines.append(f"{name:<9} no: {str(error).partition(f'--engine {name} ')[2] or error}")
            continue
        options = one.options.partition(" ")[2]
        some = f"some {in_time(one.forecast(scene).seconds)} a run"
        lines += [f"{name:<9} {options}: {one.model([scene])}; {some}", *_cautions(one, [scene])]
    return lines


def _cautions(engine: Engine, scenes: Sequence[Scene]) -> list[str]:
    remarks = dict.fromkeys(engine.definition.caution(scene) for scene in scenes)
    return [f"caution   {one}" for one in remarks if one]


def _study(study: Study) -> list[str]:
    study, remarks = _with_seeds(study)
    names = max(len(case.name) for case in study.cases)
    lines = [f"{'scene':<{names}}  {'N':>8} {'phi':>8} {'collisions':>11} {'CPU':>9} {'file':>9}  of a run"]
    for case in study.cases:
        one = forecast.of_run(case, *kept_of(study))
        count = _rounded(one.pair_collisions + one.wall_collisions)
        row = f"{case.particles:>8} {case.packing_fraction:>8.4f} {count:>11} {in_time(one.seconds):>9}"
        lines.append(f"{case.name:<{names}}  {row} {in_bytes(one.recorded):>9}")
    for engine, seeds, cases in uses_of(study):
        where = "" if len(cases) == len(study.cases) else f" in {', '.join(dict.fromkeys(one.name for one in cases))}"
        some = f"some {in_time(seconds_of(study, engine, seeds, cases))} of CPU"
        lines += [f"engine    {engine.label}{where}: {engine.model(cases)}; {some}", *_cautions(engine, cases)]
    return [*lines, *remarks, f"total     {total(study)}", f"figures   {', '.join(study.figures)}"]


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
