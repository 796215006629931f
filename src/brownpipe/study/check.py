"""`brownpipe check`: what a scene or study will simulate, and its expected cost, before anything is
run.

Collisions, CPU time and memory are those of `Engine.forecast`; nothing is simulated or timed here,
but one run for observables of the user's own.
"""

from brownpipe.analysis.windows import default_windows, window_caution
from brownpipe.engines import forecast, friction
from brownpipe.engines.friction import DECAY_TIMES, not_diffusive_before
from brownpipe.figures.cases import aligned
from brownpipe.report.description import (
    disks_in_words,
    start_in_words,
    times_in_words,
    velocities_in_words,
)
from brownpipe.scene import Scene, motion, parse_scene
from brownpipe.scene.reading import read_yaml
from brownpipe.study import Study, read_study
from brownpipe.study.run_sets import describe_workload, run_sets
from brownpipe.study.trial import refuse_mistakes
from brownpipe.text import in_bytes, in_lines, in_time


def describe_scene_or_study(path: str, particles: int | None = None) -> str:
    """Return a description of the scene or study in a file. Raises RequestError for any mistake in
    it.
    """
    mapping = read_yaml(path)
    if "box" not in mapping and mapping.keys() & (
        Study.model_fields.keys() - Scene.model_fields.keys()
    ):
        replaced = {} if particles is None else {"particles": particles}
        return in_lines([f"{path}: a valid study", *_study(read_study(path, replaced))])
    return in_lines([f"{path}: a valid scene", *_scene(parse_scene(mapping, path, particles))])


def _scene(scene: Scene) -> list[str]:
    """Return the lines of the report on a scene."""
    cost = forecast.of_run(scene)
    of_all_disks = forecast.of_run(scene, {"all"})
    start = not_diffusive_before(scene)
    theory = "Enskog" if scene.packing_fraction <= friction.DENSEST else "free volume of a crystal"
    said = {
        "box": f"{scene.box.width:g} x {scene.box.height:g}, {scene.box.boundary}",
        "disks": f"{scene.particles}: {disks_in_words(scene)}; packing fraction "
        f"{scene.packing_fraction:.4g}",
        "start": start_in_words(scene),
        "settle": forecast.settling_in_words(scene),
        "momentum": _momentum(scene),
        "velocities": velocities_in_words(scene),
        "run": times_in_words(scene),
        "diffusion": f"not before t = {start:.3g}, {DECAY_TIMES:g}/gamma of the tracer (Enskog)"
        if start > 0
        else None,
        "collisions": f"{cost.pair_collisions:,.0f} between disks, "
        f"{cost.wall_collisions:,.0f} with walls per run"
        f"{' and its equilibration' if scene.equilibrate.time else ''} ({theory}, in equilibrium)",
        "cost": f"some {in_time(cost.seconds)} of CPU and {in_bytes(cost.recorded)} of file per run"
        f" of the exact engine; {in_bytes(forecast.memory(cost, 1))} of memory",
        "record": "the tracer; with `simulate --record all` some "
        f"{in_time(of_all_disks.seconds)} of CPU, {in_bytes(of_all_disks.recorded)} of file and "
        f"{in_bytes(forecast.memory(of_all_disks, 1))} of memory per run",
    }
    window = window_caution(default_windows([scene])[0], {scene.name: start})
    cautions = [forecast.caution(scene), forecast.settling_caution(scene), window]
    return [*(f"{name:12}{text}" for name, text in said.items() if text), *_cautions(cautions)]


def _momentum(scene: Scene) -> str | None:
    """Return what the total momentum of disks in a periodic box does to the tracer's D; None where
    there is nothing.
    """
    if not scene.box.periodic or scene.listed or scene.particles < 2:
        return None
    if motion.starts_with_zero_momentum(scene):
        return (
            f"zero in total: D is (1 - m/M)^2 = {motion.bath_share(scene) ** 2:.3g} times that "
            "without recoil"
        )
    growth = friction.drift_diffusion(scene)
    mass, temperature = friction.followed(scene).mass, friction.bath_of(scene).temperature
    expected = temperature / mass * not_diffusive_before(scene) / DECAY_TIMES
    return (
        f"not zero: the centre of mass drifts, which adds {growth:.2g} to a D of {expected:.2g} "
        "by the end of a run"
    )


def _study(study: Study) -> list[str]:
    """Return the lines of the report on a study: a table of its runs, its engines and the whole
    workload.
    """
    refuse_mistakes(study)
    sets = run_sets(study)
    columns = {
        "scene": [runs.case.name for runs in sets],
        "N": [f"{runs.case.particles}" for runs in sets],
        "phi": [f"{runs.case.packing_fraction:.4f}" for runs in sets],
        "engine": [runs.engine.label for runs in sets],
        "runs": [f"{len(runs.seeds):,}" for runs in sets],
        "collisions": [
            f"{runs.cost.pair_collisions + runs.cost.wall_collisions:,.0f}" for runs in sets
        ],
        "CPU": [in_time(runs.cost.seconds) for runs in sets],
    }
    lines = aligned([(heading, *cells) for heading, cells in columns.items()])
    for engine in study.engines:
        cases = [runs.case for runs in sets if runs.engine == engine]
        lines.append(f"engine    {engine.label}: {engine.model(cases)}")
    cautions: list[str | None] = [
        line for runs in sets for line in runs.engine.cautions(runs.case, study.observables)
    ]
    simulated = [use.case for use in study.uses if use.engine.definition.moves_all_disks]
    cautions += [forecast.settling_caution(case) for case in simulated]
    starts = {
        f"{case.name}, N = {case.particles}": not_diffusive_before(case) for case in study.cases
    }
    cautions += [window_caution(window, starts) for window in study.fit_windows or ()]
    lines += _cautions(cautions)
    if study.tolerance is not None:
        goal = f"{study.target} to {100 * study.tolerance:g} %"
        lines.append(
            f"seeds     as many as {goal} needs, by pilot runs; here assumed {len(study.seeds):,}"
        )
    return [
        *lines,
        f"total     {describe_workload(study)}",
        f"figures   {', '.join(study.figures)}",
    ]


def _cautions(cautions: list[str | None]) -> list[str]:
    """Return a line for each caution, once."""
    return [f"caution   {caution}" for caution in dict.fromkeys(cautions) if caution]
