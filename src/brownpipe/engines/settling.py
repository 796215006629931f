"""How long a scene is expected to take to forget its start: the motion of its disks, and the friction of its tracer."""

import math

import numpy as np

from brownpipe.engines.forecast import mixture_of, pair_rate
from brownpipe.engines.friction import DENSEST, partners_of
from brownpipe.engines.saturation import is_grown
from brownpipe.engines.units import SMALLEST_NORMAL
from brownpipe.observables.quarters import claims_equilibrium
from brownpipe.scene import Scene

FRICTION_TIMES = 5.0  # 1/gamma, in which a hot tracer's kinetic energy comes within e^-10 of that of its bath
FEWEST_DISKS = 10  # for kinetic theory to predict collisions
TOO_SHORT = 0.5  # of the forecast, which is rough


def settling_time(scene: Scene) -> float:
    """Return the time [time] in which the fluid of a scene forgets its start; NaN beyond Enskog's theory.

    The most numerous disks, of speed v (standard deviation of a component), move by the distance of neighbours a: a/v
    in flight and, to forget a lattice, also a^2/D, with D = v^2/gamma and gamma about their collision rate. It is at
    least FRICTION_TIMES of the tracer, unless velocities are drawn at a temperature.
    """
    mixture = mixture_of(scene)
    rate = 2 * pair_rate(scene, mixture) / scene.particles if scene.particles >= FEWEST_DISKS else 0.0
    if not rate > 0 or scene.packing_fraction > DENSEST:
        return math.nan
    flight = math.sqrt(scene.box.area / scene.particles) / mixture.speed[np.argmax(mixture.number)]
    diffusion = flight * flight * rate if _is_ordered(scene) else 0.0
    is_hot = scene.velocities.temperature is None
    cooling = FRICTION_TIMES / max(partners_of(scene).friction.sum(), SMALLEST_NORMAL) if is_hot else 0.0
    return float(max(flight + diffusion, cooling))


def _is_ordered(scene: Scene) -> bool:
    """Return whether a scene starts far from the places of a fluid: on a lattice, or of disks that have grown."""
    return scene.placement == "lattice" or is_grown(scene)


def settling_in_words(scene: Scene) -> str | None:
    """Return how long to equilibrate and what that rests on; None for a scene that does not claim equilibrium."""
    if not claims_equilibrium(scene):
        return None
    needed = settling_time(scene)
    if math.isnan(needed):
        return f"no forecast for few disks, or above a packing fraction of {DENSEST:g}, where disks freeze"
    basis = "to move to a neighbour's place" + (" by diffusion" if _is_ordered(scene) else "")
    hot = "" if scene.velocities.temperature is not None else f", {FRICTION_TIMES:g}/gamma of the tracer"
    return f"some {needed:.2g} should be enough ({basis}{hot}; Enskog's theory of the fluid, not of crystals)"


def settling_caution(scene: Scene) -> str | None:
    """Return one line of caution if a scene equilibrates for far less than it is expected to need; otherwise None."""
    time, words = scene.equilibrate.time, settling_in_words(scene)
    if words is None or not time < TOO_SHORT * settling_time(scene):
        return None
    return f"{scene.name}, N = {scene.particles}: equilibrate.time {time:g} is short: {words}"
