"""The friction of a disk in a bath of others, and where a bath may be replaced by friction and noise.

The Langevin equation has one time scale, 1/gamma, and a noise without memory. It describes a disk that is much heavier
than those that hit it, in a bath so thin that they do not come back: the collisions of a light disk turn its velocity
too far at once, and in the plane the bath's own flow returns momentum, so that the velocity autocorrelation of hard
disks has a tail 1/t (Alder & Wainwright, Phys. Rev. A 1, 18 (1970)); in a dense one the neighbours form a cage.
Neither tail nor cage is modelled here.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from brownpipe import theory
from brownpipe.scene import Scene, SceneError, Species, Velocities

LIGHTEST = 2.0  # tracer, in masses of the heaviest bath disk: below, a collision changes its velocity as a whole
HEAVY = 10.0  # from here on, the Langevin equation is within some percent
DENSEST = 0.7  # packing fraction above which disks freeze; the contact value holds for the fluid
COLLISIONS = 4000  # of the tracer, that its rate is measured by: 1.6 % if they come at random
RUNS = 8  # that they are shared out to
SMALLEST = 2.3e-308  # floating-point number that has all its digits
SETTLING = 0.1  # of the time of such a run passes before it


class Bath(NamedTuple):
    """All disks but the one that is followed, by species, shape (K,) each."""

    number: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    temperature: float  # kT, the mean kinetic energy per disk


class Partners(NamedTuple):
    """Enskog's theory of the followed disk, by species of its bath, shape (K,) each."""

    contact_value: np.ndarray  # [1]
    friction: np.ndarray  # gamma = zeta/m_a [1/time]
    rate: np.ndarray  # collisions of the followed disk with the species [1/time]


def followed(scene: Scene) -> Species:
    """Return the species of disk 0."""
    return next(one for one in scene.species if one.count)


def bath_of(scene: Scene) -> Bath:
    """Return the bath of a scene of species: all disks but the one that is followed."""
    tracer, given = followed(scene), scene.velocities
    counted = [(one, one.count - (one is tracer)) for one in scene.species]
    rows = [(count, one.radius, one.mass) for one, count in counted if count]
    number, radius, mass = np.array(rows, dtype=float).reshape(-1, 3).T
    temperature = given.temperature
    if temperature is None:
        unit = math.ldexp(1.0, math.frexp(mass.max(initial=0.0))[1] - 1)  # many masses of 1e300 add up to infinity
        mean = float((number * (mass / unit)).sum() / number.sum()) * unit
        temperature = given.standard_deviation * given.standard_deviation * mean
    return Bath(number, radius, mass, temperature)


def friction_rate(scene: Scene, friction: str) -> float:
    """Return gamma [1/time] of the followed disk, dv/dt = -gamma v + noise.

    `enskog`: the sum of the frictions of all species of the bath (`partners_of`). `boltzmann`: the same with contact
    values 1, the limit of a thin bath. `measured`: Enskog's sum times the tracer's measured collision rate over
    Enskog's. Since for each species zeta = 2 n chi sigma sqrt(2 pi mu kT) = 2 mu times the rate
    n chi sigma sqrt(2 pi kT/mu), with one species this is 2 mu rate/m, the initial decay of the velocity
    autocorrelation, whatever chi is; with several the measured rate is divided in Enskog's proportions. It includes the
    higher density of centres between walls.
    """
    partners = partners_of(scene, crowded=friction != "boltzmann")
    gamma = partners.friction.sum()
    if friction == "measured" and gamma > 0:
        gamma *= _measured_rate(measuring_runs(scene)) / partners.rate.sum()
    moves = scene.velocities.temperature or scene.velocities.standard_deviation
    if not (math.isfinite(gamma) and (gamma >= SMALLEST or not moves)):
        allowed = f"from {SMALLEST:.3g} to 1.8e308"
        _refuse(scene, f"needs a friction rate {allowed}, found {gamma:g}; choose another unit of time")
    return float(gamma)


def partners_of(scene: Scene, crowded: bool = True) -> Partners:
    """Return contact values, frictions and collision rates of the followed disk with every species of its bath.

    A species of N_k disks, the followed one not counted, has the number density N_k/A. The contact values are those of
    the whole box, the followed disk included (`theory.mixture_contact_values`), at a packing fraction of at most
    DENSEST; 1 unless `crowded`. Walls are not considered. Masses and kT are divided by the mass of the followed disk
    first: its friction coefficient zeta alone may be no floating-point number.
    """
    tracer, bath = followed(scene), bath_of(scene)
    present = [one for one in scene.species if one.count]
    chi = np.ones(len(bath.number))
    if crowded:
        fluid = min(1.0, DENSEST / scene.packing_fraction)
        density = fluid * np.array([one.count for one in present]) / scene.box.area
        contact = theory.mixture_contact_values(density, 2 * np.array([one.radius for one in present]))
        met = np.array([one.count > (one is tracer) for one in present])
        chi = contact[present.index(tracer), met]
    mu = theory.reduced_mass(1.0, bath.mass / tracer.mass)
    known = bath.number / scene.box.area, tracer.radius + bath.radius, chi, mu, bath.temperature / tracer.mass
    return Partners(chi, theory.enskog_friction(*known), theory.collision_rate(*known))


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


def _measured_rate(scene: Scene) -> float:
    """Return the collisions of the tracer per time [1/time] in the runs that are made to measure it."""
    from brownpipe import exact
    from brownpipe.kernels import RunError

    found = exact.simulate(scene, range(RUNS), frozenset({"none"})).observables
    if found["failed"].any():
        raise RunError(f"{scene.name}: the runs that measure the friction failed their health check")
    heat = found["kinetic_energy"] / (scene.particles * scene.velocities.temperature)  # of a run; rates go as its root
    return float(np.sum(found["tracer_collisions"] / np.sqrt(heat)) / (RUNS * scene.duration))


# -- where it means something ---------------------------------------------------------------------------------------


def refuse_unfit(scene: Scene, friction: str, record=frozenset({"tracer"})) -> None:
    """Raise SceneError if the bath of a scene cannot be replaced by this friction and noise, or is to be recorded."""
    if more := record & {"all", "events"}:
        raise SceneError(f"--record {','.join(sorted(more))}: the langevin engine has no bath; must be tracer or none")
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
    if friction == "enskog" and scene.packing_fraction > DENSEST:
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
    raise SceneError(f"{scene.name}, N = {scene.particles}: --engine langevin {why}")
