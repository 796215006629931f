"""The Langevin engine: the tracer alone, its bath replaced by friction and noise.

The Langevin equation has one time scale, 1/gamma, and a noise without memory. It describes a disk that is much heavier
than those that hit it, in a bath so thin that they do not come back: the collisions of a light disk turn its velocity
too far at once, and in the plane the bath's own flow returns momentum, so that the velocity autocorrelation of hard
disks has a tail 1/t (Alder & Wainwright, Phys. Rev. A 1, 18 (1970)); in a dense one the neighbours form a cage.
Neither tail nor cage is modelled.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from brownpipe.engines import forecast
from brownpipe.engines.definition import Definition, Setting
from brownpipe.engines.friction import DENSEST, SMALLEST, bath_of, followed, friction_rate, partners_of
from brownpipe.errors import RequestError
from brownpipe.scene import reading
from brownpipe.scene.scene import Scene, Velocities

LIGHTEST = 2.0  # tracer, in masses of the heaviest bath disk: below, a collision changes its velocity as a whole
HEAVY = 10.0  # from here on, the Langevin equation is within some percent

COLLISIONS = 4000  # of the tracer, that its rate is measured by: 1.6 % if they come at random
RUNS = 8  # that they are shared out to
SETTLING = 0.1  # of the time of such a run passes before it
EACH_RUN = 4.5e-5  # CPU seconds; two streams of random numbers are begun
SECONDS_PER_SAMPLE = 1.3e-7  # CPU seconds
FRICTIONS = ("enskog", "boltzmann", "measured")


def refuse_unfit(scene: Scene, settings: dict, record=frozenset({"tracer"})) -> None:
    """Raise RequestError if the bath of a scene cannot be replaced by this friction and noise, or is to be recorded."""
    if more := record & {"all", "events"}:
        raise RequestError(
            f"--record {','.join(sorted(more))}: the langevin engine has no bath; must be tracer or none"
        )
    if scene.disks or scene.particles == 0:
        _refuse(scene, "needs a scene with species, of which the first disk is followed")
    if scene.particles == 1:
        _refuse(scene, "needs a bath, and there is a single disk")
    if _mass_ratio(scene) < LIGHTEST:
        ratio = f"the disk that is followed has {_mass_ratio(scene):.3g} times the mass of the heaviest of the others"
        _refuse(scene, f"is for a heavy tracer: {ratio}; must be at least {LIGHTEST:g}")
    temperature, moves = bath_of(scene).temperature, scene.velocities.temperature or scene.velocities.standard_deviation
    if not math.isfinite(temperature):
        _refuse(scene, "needs a temperature of the bath below 1.8e308")
    if moves and not min(temperature, temperature / followed(scene).mass) >= SMALLEST:
        found = f"{temperature:.3g} for a disk of mass {followed(scene).mass:g}"
        _refuse(scene, f"needs kT and kT/m of at least {SMALLEST:.3g}, found kT = {found}; choose other units")
    if settings["friction"] == "enskog" and scene.packing_fraction > DENSEST:
        phi = f"the packing fraction is {scene.packing_fraction:.4g}; must be at most {DENSEST:g}"
        _refuse(scene, f"has no contact value for --friction enskog: {phi}, or --friction measured")


def caution(scene: Scene) -> str | None:
    """Return one line if the tracer is so light that the Langevin equation is only roughly right."""
    ratio = _mass_ratio(scene)
    if ratio >= HEAVY:
        return None
    few = f"the tracer has only {ratio:.3g} times the mass of a bath disk (good from {HEAVY:g} on)"
    return f"{scene.name}: langevin is rough here: {few}; compare with --engine exact"


def _mass_ratio(scene: Scene) -> float:
    return followed(scene).mass / bath_of(scene).mass.max()


def _refuse(scene: Scene, why: str):
    raise RequestError(f"{scene.name}, N = {scene.particles}: --engine langevin {why}")


def _model(scenes: Sequence[Scene], settings: dict) -> str:
    which = settings["friction"]
    rates = [] if which == "measured" else sorted(friction_rate(one, which) for one in scenes)
    gamma = " to ".join(dict.fromkeys(f"{rate:.3g}" for rate in rates[:1] + rates[-1:])) or "as measured"
    return f"the tracer alone, gamma = {gamma}; no 1/t tail of the velocity autocorrelation, no cage"


def _forecast(scene: Scene, settings: dict, record, observables, average: str) -> forecast.Cost:
    seconds = EACH_RUN + SECONDS_PER_SAMPLE * len(scene.times)
    seconds += forecast.seconds_to_measure_tracer(scene, observables, average)
    measuring = measuring_runs(scene) if settings["friction"] == "measured" else None
    once = 0.0 if measuring is None else RUNS * forecast.of_run(measuring).seconds
    recorded = forecast.of_run(scene, record, observables, average).recorded
    return forecast.Cost(0.0, 0.0, seconds, recorded, 0.0, once)


def _candidates(scene: Scene) -> list[dict]:
    return [{"friction": "enskog"}]


def measuring_runs(scene: Scene) -> Scene | None:
    """Return the scene whose RUNS first seeds measure the rate of the tracer's collisions; None if nothing moves.

    All disks are in equilibrium at the temperature of the bath, and the tracer free: it is an average over where the
    tracer comes to, and the same number whichever runs it is for.
    """
    expected = partners_of(scene).rate.sum()
    if expected == 0:
        return None
    duration = float(COLLISIONS / (RUNS * expected))
    return replace(
        scene,
        velocities=Velocities(None, bath_of(scene).temperature),
        duration=duration,
        sample_interval=duration,
        equilibrate=max(SETTLING * duration, scene.equilibrate),
        tracer_while_equilibrating="free",
    )


LANGEVIN = Definition(
    name="langevin",
    simulation="brownpipe.engines.langevin.simulation",
    settings={"friction": Setting(lambda entry: reading.choice(entry, FRICTIONS))},
    model=_model,
    refuse_unfit=refuse_unfit,
    caution=caution,
    forecast=_forecast,
    candidates=_candidates,
)
