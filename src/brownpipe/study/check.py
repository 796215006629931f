"""`brownpipe check`: what a scene or study will simulate, and its expected cost, before anything is
run.

Collisions, CPU time and memory are those of `Engine.forecast`; nothing is simulated or timed here,
but one run for observables of the user's own.
"""

import math

from brownpipe.engines import forecast, friction
from brownpipe.engines.friction import DECAY_TIMES, not_diffusive_before
from brownpipe.engines.windows import default_windows, window_caution
from brownpipe.figures.cases import aligned
from brownpipe.report.description import (
    disks_in_words,
    start_in_words,
    times_in_words,
    velocities_in_words,
)
from brownpipe.scene import Scene, motion, parse_scene
from brownpipe.storage.configurations import read_scene_file
from brownpipe.study import Study, read_study
from brownpipe.study.run_sets import RunSet, describe_workload, run_sets
from brownpipe.study.trial import refuse_mistakes
from brownpipe.text import in_bytes, in_lines, in_time


def describe_scene_or_study(path: str, particles: int | None = None) -> str:
    """Return a description of the scene or study in a file. Raises RequestError for any mistake in
    it.
    """
    mapping = read_scene_file(path)
    study_keys = Study.model_fields.keys() - Scene.model_fields.keys()
    if "box" not in mapping and mapping.keys() & study_keys:
        replaced = {} if particles is None else {"particles": particles}
        study = read_study(path, replaced)
        return in_lines([f"{path}: a valid study", *_study_report(study)])
    scene = parse_scene(mapping, path, particles)
    return in_lines([f"{path}: a valid scene", *_scene_report(scene)])


def _scene_report(scene: Scene) -> list[str]:
    """Return the lines of the report on a scene."""
    cost = forecast.run_cost(scene)
    cost_of_all_disks = forecast.run_cost(scene, {"all"})
    start = not_diffusive_before(scene)
    boundary = scene.box.sides_in_words if scene.box.is_channel else scene.box.boundary
    properties = {
        "box": f"{scene.box.width:g} x {scene.box.height:g}, {boundary}",
        "disks": _disks(scene),
        "start": start_in_words(scene),
        "settle": forecast.settling_in_words(scene),
        "momentum": _momentum(scene),
        "velocities": velocities_in_words(scene),
        "run": times_in_words(scene),
        "diffusion": _diffusion(start),
        "single file": _single_file(scene),
        "collisions": _collisions(scene, cost),
        "cost": _tracer_run_cost(cost),
        "record": _all_disks_run_cost(cost_of_all_disks),
    }
    lines = [f"{name:12}{text}" for name, text in properties.items() if text]
    window = window_caution(default_windows([scene])[0], {scene.name: start})
    from brownpipe.engines.start.initial_state import separation_in_words  # imports Numba

    separation = separation_in_words(scene)
    cautions = [forecast.caution(scene), forecast.settling_caution(scene), window, separation]
    return [*lines, *_cautions(cautions)]


def _disks(scene: Scene) -> str:
    """Return number and kinds of the disks, and their packing fraction."""
    return (
        f"{scene.particles}: {disks_in_words(scene)}; packing fraction {scene.packing_fraction:.4g}"
    )


def _diffusion(start: float) -> str | None:
    """Return when the tracer's motion can be diffusive at the earliest, or that a lone disk's never
    is; None if from t = 0 on, and where it is not known (NaN).
    """
    if start == math.inf:
        return "none: a lone disk never forgets its initial velocity"
    if not start > 0:
        return None
    return f"not before t = {start:.3g}, {DECAY_TIMES:g}/gamma of the tracer (Enskog)"


def _single_file(scene: Scene) -> str | None:
    """Return that no disk can pass the tracer in a channel; None where one can."""
    if not scene.box.is_channel or scene.particles < 2:
        return None
    (height,) = scene.box.size[~scene.box.periodic_axes]
    beside_tracer = height - 2 * scene.radius[0]
    smallest = 2 * scene.radius[1:].min()
    if beside_tracer >= smallest:
        return None
    return (
        f"disks cannot pass the tracer: {beside_tracer:.3g} of the channel is free beside it, and "
        f"the smallest has a diameter of {smallest:.3g}"
    )


def _collisions(scene: Scene, cost: forecast.Cost) -> str:
    """Return the collisions of a run, with the theory that forecasts them."""
    theory = "Enskog" if scene.packing_fraction <= friction.DENSEST else "free volume of a crystal"
    run = "run and its equilibration" if scene.equilibrate.time else "run"
    return (
        f"{cost.pair_collisions:,.0f} between disks, {cost.wall_collisions:,.0f} with walls per "
        f"{run} ({theory}, in equilibrium)"
    )


def _tracer_run_cost(cost: forecast.Cost) -> str:
    """Return what a run of the exact engine takes if it records the tracer."""
    memory = in_bytes(forecast.memory(cost, 1))
    return (
        f"some {in_time(cost.seconds)} of CPU and {in_bytes(cost.bytes_in_file)} of file per run "
        f"of the exact engine; {memory} of memory"
    )


def _all_disks_run_cost(cost: forecast.Cost) -> str:
    """Return what a run of the exact engine takes if it records all disks."""
    memory = in_bytes(forecast.memory(cost, 1))
    return (
        f"the tracer; with `simulate --record all` some {in_time(cost.seconds)} of CPU, "
        f"{in_bytes(cost.bytes_in_file)} of file and {memory} of memory per run"
    )


def _momentum(scene: Scene) -> str | None:
    """Return what the total momentum along periodic axes does to the tracer's D; None where
    there is nothing.
    """
    if not scene.box.has_images or scene.has_one_state or scene.particles < 2:
        return None
    along = scene.box.along  # of a channel
    if motion.starts_with_zero_momentum(scene):
        recoil = motion.bath_share(scene) ** 2
        total = f"zero{along or ' in total'}"
        return f"{total}: D{along} is (1 - m/M)^2 = {recoil:.3g} times that without recoil"
    growth = friction.drift_diffusion(scene)
    temperature = friction.bath_of(scene).temperature
    expected = temperature / scene.mass[0] * not_diffusive_before(scene) / DECAY_TIMES
    return (
        f"not zero: the centre of mass drifts{along}, which adds {growth:.2g} to a D of "
        f"{expected:.2g} by the end of a run"
    )


def _study_report(study: Study) -> list[str]:
    """Return the lines of the report on a study: a table of its runs, its engines and the whole
    workload.
    """
    refuse_mistakes(study)
    sets = run_sets(study)
    lines = aligned(_run_columns(sets))
    for engine in dict.fromkeys(runs.engine for runs in sets):
        cases = [runs.case for runs in sets if runs.engine == engine]
        lines.append(f"engine    {engine.label}: {engine.model(cases)}")
    lines += _cautions(_cautions_of_study(study, sets))
    if study.tolerance is not None:
        goal = f"{study.target} to {100 * study.tolerance:g} %"
        lines.append(
            f"seeds     as many as {goal} needs, by pilot runs; here assumed {len(study.seeds):,}"
        )
    lines.append(f"total     {describe_workload(study)}")
    lines.append(f"figures   {', '.join(study.figures)}")
    return lines


def _run_columns(sets: list[RunSet]) -> list[tuple[str, ...]]:
    """Return the columns of the table of runs, each with its heading first."""
    cases = [runs.case for runs in sets]
    costs = [runs.cost for runs in sets]
    collisions = [cost.pair_collisions + cost.wall_collisions for cost in costs]
    return [
        ("scene", *(case.name for case in cases)),
        ("N", *(f"{case.particles}" for case in cases)),
        ("phi", *(f"{case.packing_fraction:.4f}" for case in cases)),
        ("engine", *(runs.engine.label for runs in sets)),
        ("runs", *(f"{len(runs.seeds):,}" for runs in sets)),
        ("collisions", *(f"{number:,.0f}" for number in collisions)),
        ("CPU", *(in_time(cost.seconds) for cost in costs)),
    ]


def _cautions_of_study(study: Study, sets: list[RunSet]) -> list[str | None]:
    """Return what limits the results of a study: its engines, starts and fit windows; None where
    nothing does.
    """
    cautions: list[str | None] = []
    for runs in sets:
        cautions += runs.engine.cautions(runs.case, study.observables)
    for use in study.uses:
        if use.engine.moves_all_disks:
            cautions.append(forecast.settling_caution(use.case))
    starts = {}
    for case in study.cases:
        starts[case.title] = not_diffusive_before(case)
    for title, start in starts.items():
        if start == math.inf:
            cautions.append(f"{title}: no diffusion, as a lone disk never forgets its velocity")
    for window in study.fit_windows or ():
        cautions.append(window_caution(window, starts))
    return cautions


def _cautions(cautions: list[str | None]) -> list[str]:
    """Return a line for each caution, once."""
    return [f"caution   {caution}" for caution in dict.fromkeys(cautions) if caution]
