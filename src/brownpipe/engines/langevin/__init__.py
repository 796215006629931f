"""The Langevin engine: the tracer alone, friction and noise in place of its bath. Here is its
`Definition`.

The Langevin equation has one time scale, 1/gamma, and a noise without memory. It describes a disk
much heavier than those of its bath, in a bath so dilute that the same bath disk rarely hits it
twice; the velocity of a light disk would change too much in one collision. In the plane the flow of
the bath returns momentum, so that the velocity autocorrelation of hard disks has a 1/t tail (B. J.
Alder & T. E. Wainwright, Phys. Rev. A 1, 18 (1970)), and in a dense bath the neighbours form a
cage; neither tail nor cage is modelled. docs/theory.md, section 4.
"""

import math
from collections.abc import Collection, Sequence
from typing import Annotated, Literal, NamedTuple, NoReturn

from brownpipe.engines import forecast
from brownpipe.engines.definition import Definition
from brownpipe.engines.friction import (
    DENSEST,
    bath_of,
    friction_rate,
    partners_of,
)
from brownpipe.engines.units import SMALLEST_NORMAL
from brownpipe.errors import RequestError
from brownpipe.observables import tracer_observables
from brownpipe.scene import motion
from brownpipe.scene.reading import key
from brownpipe.scene.scene import Scene, disks_without_own_velocity

# mass of the tracer / heaviest bath disk; below, one collision changes most of its velocity
LIGHTEST = 2.0
# The caution is given below this mass ratio. A higher ratio does not ensure a small error, since
# density and the finite box matter, too: with a ratio of 50 at phi = 0.3 the MSD by Enskog's
# friction is 51 % too small (docs/results.md).
HEAVY = 10.0
# of the tracer, to measure its collision rate: error 1.6 % if they are independent
RATE_COLLISIONS = 4000
RATE_RUNS = 8  # of the exact engine, over which these collisions are divided
SETTLING = 0.1  # time to equilibrate before each of these runs, in units of its duration
Friction = Literal["enskog", "boltzmann", "measured"]


class Settings(NamedTuple):
    """The settings of the engine."""

    friction: Annotated[Friction, key("enskog, boltzmann or measured")]


def refuse_unfit(
    scene: Scene, settings: Settings, record: Collection[str] = frozenset({"tracer"})
) -> None:
    """Raise RequestError if the scene's bath cannot be replaced by this friction, or if `record`
    needs the bath.
    """
    if bath_records := {"all", "events"}.intersection(record):
        raise RequestError(
            f"--record {','.join(sorted(bath_records))}: the langevin engine has no bath; must be "
            "tracer or none"
        )
    if scene.box.is_channel:
        _refuse(scene, "needs a box with walls on all sides, or on none")
    if scene.has_one_state or scene.particles == 0:
        _refuse(scene, "needs disks whose velocities are drawn, of which the first is followed")
    if scene.particles == 1:
        _refuse(scene, "needs a bath, and there is a single disk")
    mass_ratio = _mass_ratio(scene)
    if mass_ratio < LIGHTEST:
        ratio = (
            f"the disk that is followed has {mass_ratio:.3g} times the mass of the heaviest of the "
            "others"
        )
        _refuse(scene, f"is for a heavy tracer: {ratio}; must be at least {LIGHTEST:g}")
    energy = bath_of(scene).temperature
    smallest = min(energy, energy / scene.mass[0])
    if motion.moves(scene) and not SMALLEST_NORMAL <= smallest <= energy < math.inf:
        allowed = f"from {SMALLEST_NORMAL:.3g} to 1.8e308"
        _refuse(scene, f"needs kT and kT/m {allowed}, found kT = {energy:.3g}")
    if settings.friction == "enskog" and scene.packing_fraction > DENSEST:
        phi = f"the packing fraction is {scene.packing_fraction:.4g}; must be at most {DENSEST:g}"
        _refuse(scene, f"has no contact value for --friction enskog: {phi}, or --friction measured")


def caution(scene: Scene) -> str | None:
    """Return one line of caution if the tracer has less than HEAVY times the mass of a bath disk;
    otherwise None.

    None, too, for scenes that `refuse_unfit` refuses because they have no bath.
    """
    if scene.has_one_state or scene.particles < 2:
        return None
    ratio = _mass_ratio(scene)
    if ratio >= HEAVY:
        return None
    light = f"the tracer has only {ratio:.3g} times the mass of a bath disk (less than {HEAVY:g})"
    return f"{scene.name}: langevin is rough here: {light}; compare with --engine exact"


def _mass_ratio(scene: Scene) -> float:
    """Return the tracer's mass over that of the heaviest bath disk."""
    return float(scene.mass[0] / scene.mass[1:].max())


def _refuse(scene: Scene, why: str) -> NoReturn:
    """Raise RequestError."""
    raise RequestError(f"{scene.title}: --engine langevin {why}")


def _model(scenes: Sequence[Scene], settings: Settings) -> str:
    """Return the model in a few words, with the range of the scenes' friction rates."""
    friction = settings.friction
    gamma = "as measured"
    if friction != "measured":
        rates = [friction_rate(scene, friction) / motion.bath_share(scene) for scene in scenes]
        lowest = f"{min(rates):.3g}"
        highest = f"{max(rates):.3g}"
        gamma = lowest if lowest == highest else f"{lowest} to {highest}"
    return (
        f"the tracer alone, gamma = {gamma}; no 1/t tail of the velocity autocorrelation, no cage"
    )


def _forecast(
    scene: Scene,
    settings: Settings,
    record: Collection[str],
    observables: Collection[str],
    average: str,
) -> forecast.Cost:
    """Return the cost of a run; measuring the friction by runs of the exact engine costs once per
    process.
    """
    measured = tracer_observables(observables)
    cost = forecast.run_cost(scene, record, measured, average, tracer_only=True)
    if rate_scene := scene_of_rate(scene, settings.friction):
        rate = forecast.run_cost(rate_scene)
        return cost._replace(
            working_bytes=max(rate.working_bytes, cost.working_bytes),
            seconds_per_process=RATE_RUNS * rate.seconds,
        )
    return cost


def scene_of_rate(scene: Scene, friction: str) -> Scene | None:
    """Return the scene in which the exact engine measures the tracer's collision rate.

    None if the friction is not `measured`, or nothing moves. All disks are in equilibrium at the
    temperature of the bath, and the tracer moves freely. The rate, from the first RATE_RUNS seeds,
    is an average over the positions of the tracer and does not depend on the seeds of the study.
    """
    expected = partners_of(scene).rate.sum() if friction == "measured" else 0.0
    if expected == 0:
        return None
    duration = float(RATE_COLLISIONS / (RATE_RUNS * expected))
    if scene.tracer_velocity is not None:
        scene = scene.replace(disks=disks_without_own_velocity(scene))
    return scene.replace(
        velocities={"temperature": bath_of(scene).temperature},
        duration=duration,
        sample_interval=None,
        samples=None,
        equilibrate={"time": max(SETTLING * duration, scene.equilibrate.time), "tracer": "free"},
    )


LANGEVIN = Definition(
    name="langevin",
    summary="the tracer alone, in friction and noise",
    simulation="brownpipe.engines.langevin.simulation",
    settings=Settings,
    model=_model,
    refuse_unfit=refuse_unfit,
    caution=caution,
    forecast=_forecast,
    moves_all_disks=False,
)
