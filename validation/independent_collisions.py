"""Why the Langevin equation is off in the note's scene: the tracer with collisions that know
nothing of each other.

    python -m validation.independent_collisions        half a minute

Partners come from a bath in equilibrium, at the rate of Enskog's theory and with a random impact
parameter: the Boltzmann-Enskog equation, solved by random numbers. It shares with the Langevin
equation that the bath forgets the tracer at once, and with the exact engine the mass ratio, the hot
start and the collisions themselves. The difference from the Langevin equation is therefore that of
friction and noise in place of collisions; the difference from exact runs is what collisions that
depend on each other do. Neither has walls, which the tracer hardly reaches by t = 1.
"""

import math

import numpy as np

from brownpipe import simulate
from brownpipe.engines.friction import bath_of, friction_rate, partners_of
from brownpipe.scene import Scene, motion
from brownpipe.storage.configurations import read_scene

SCENES = ("harrison2020", "harrison2020_thermal")
PARTICLES, TRACERS, EXACT_RUNS = 150, 60_000, 20_000
STEP = 5e-4  # time, in which a tracer has at most one collision: 0.3 % of them are missed
FASTEST = 8.0  # relative speed, in standard deviations of a component of the bath's velocities


def msd_of_independent_collisions(scene: Scene, rng: np.random.Generator) -> tuple[float, float]:
    """Return the MSD at the end [length^2] and its standard error."""
    bath, (species,) = bath_of(scene), partners_of(scene).contact_value
    mass, speed = bath.mass[0] / scene.mass[0], math.sqrt(bath.temperature / bath.mass[0])
    sigma = scene.radius[0] + bath.radius[0]
    most = (
        bath.number[0] / scene.box.area * species * 2 * sigma * FASTEST * speed
    )  # rate at the fastest relative speed
    velocity = rng.normal(size=(TRACERS, 2)) * initial_speed(scene)
    moved = np.zeros((TRACERS, 2))
    for _ in range(round(scene.duration / STEP)):
        moved += velocity * STEP / 2
        hit = np.flatnonzero(rng.random(TRACERS) < most * STEP)
        relative = velocity[hit] - rng.normal(size=(len(hit), 2)) * speed
        fast = np.hypot(*relative.T)
        real = rng.random(len(hit)) < fast / (FASTEST * speed)
        hit, along = hit[real], relative[real] / fast[real, None]
        impact = rng.uniform(-1, 1, len(hit))  # in contact distances
        head_on = np.sqrt(1 - impact**2)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        normal = along * head_on[:, None] + across * impact[:, None]
        velocity[hit] -= 2 * mass / (1 + mass) * (fast[real] * head_on)[:, None] * normal
        moved += velocity * STEP / 2
    return mean_and_error((moved**2).sum(axis=1))


def msd_of_langevin(scene: Scene) -> float:
    """Return the MSD at the end [length^2] of the Langevin equation without walls, in closed
    form.
    """
    gamma, thermal = friction_rate(scene, "enskog"), bath_of(scene).temperature / scene.mass[0]
    decay = -math.expm1(-gamma * scene.duration)
    noise = (
        4 * thermal / gamma * (scene.duration - decay / gamma) - 2 * thermal * (decay / gamma) ** 2
    )
    return 2 * initial_speed(scene) ** 2 * (decay / gamma) ** 2 + noise


def initial_speed(scene: Scene) -> float:
    """Return the standard deviation of a component of the tracer's initial velocity
    [length/time].
    """
    temperature = motion.temperature(scene)
    if temperature is None:
        return motion.common_deviation(scene)
    return math.sqrt(temperature / scene.mass[0])


def msd_of_exact_runs(scene: Scene) -> tuple[float, float]:
    """Return the MSD at the end [length^2] and its standard error."""
    position = simulate(
        scene.replace(sample_interval=scene.duration), seeds=EXACT_RUNS
    ).position.values
    return mean_and_error(((position[-1] - position[0]) ** 2).sum(axis=1))


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    return float(values.mean()), float(values.std() / math.sqrt(len(values)))


def main() -> None:
    """Print the three MSDs of each scene."""
    for name in SCENES:
        scene = read_scene(f"config/scenes/{name}.yaml", PARTICLES)
        exact, error = msd_of_exact_runs(scene)
        independent, its_error = msd_of_independent_collisions(scene, np.random.default_rng(2020))
        langevin = msd_of_langevin(scene)
        print(
            f"{name}: exact {exact:.4f} +- {error:.4f}, independent collisions {independent:.4f} "
            f"+- {its_error:.4f},"
        )
        print(
            f"    langevin {langevin:.4f}: {100 * (langevin / independent - 1):+.1f} % from "
            "independent collisions,"
        )
        print(f"    which are {100 * (independent / exact - 1):+.1f} % from exact runs")


if __name__ == "__main__":
    main()
