"""How fast the disks are: autocorrelation, kinetic energies and distributions of the velocities of one run.

T sample times, N disks, K kinds of them.
"""

from collections.abc import Iterator

import numpy as np

from brownpipe.observables.displacement import velocity_displacement
from brownpipe.observables.species import bath_disks, species_table, tracer_tracks
from brownpipe.observables.time_origins import is_stationary, lags
from brownpipe.scene import Scene

BIN = 0.1  # of velocities and speeds, in units of sqrt(kT/m)
FASTEST = 6.0  # component, up or down, from which all is in one bin
BINS = {"velocity": 120, "speed": 80}
VALUES_AT_ONCE = 2**18  # so that what is computed on the way takes little memory


def autocorrelation(scene: Scene, run, average: str) -> dict[str, np.ndarray]:
    """v(0).v(t) (T,) of the tracer and, averaged over its disks, of the most numerous other kind, if there is one.

    With the tracer's v(0).(r(t) - r(0)), the integral of v(0).v(s) up to t: in the plane D is half of it (Green-Kubo).
    `average` is that of `displacement.square_displacement`; over `disks` it is the mean over those equal to the tracer.
    """
    found = {
        "velocity_autocorrelation": _correlation(scene, tracer_tracks(scene, run, average).velocity, average),
        "velocity_displacement": velocity_displacement(scene, run, average),
    }
    bath = bath_disks(scene)
    if len(bath) and run.whole is not None:  # not in a run of the tracer alone
        found["bath_velocity_autocorrelation"] = _correlation(scene, run.whole.velocity[:, bath], average)
    return found


def _correlation(scene: Scene, velocity: np.ndarray, average: str) -> np.ndarray:
    """Mean (T,) over disks, and origins if these are asked for, of the product of velocities (T, M, 2)."""
    disks, flat = velocity.shape[1], velocity.reshape(len(velocity), -1)
    if average != "origins":
        return np.einsum("tm,m->t", flat, flat[0]) / disks
    products = (np.einsum("tm,tm->t", flat[earlier], flat[later]) for earlier, later in lags(scene))
    return np.array([product.mean() / disks for product in products])


def species_energy(scene: Scene, run, _) -> dict[str, np.ndarray]:
    """Kinetic energy per disk (T, K) of each kind: kT in equilibrium, whatever its mass (equipartition)."""
    kinds, square = species_table(scene), np.sum(run.whole.velocity**2, axis=-1)
    energy = [mass / 2 * square[:, kinds.label == k].mean(axis=1) for k, mass in enumerate(kinds.mass)]
    return {"species_energy": np.stack(energy, axis=1)}


def distribution(scene: Scene, run, _) -> dict[str, np.ndarray]:
    """Counts of velocity components (K, 120) and of speeds (K, 80) in units of sqrt(kT/m).

    kT is the scene's temperature; without one, the mean kinetic energy per disk of the samples that are counted. In
    equilibrium the components are normal and the speeds have the density u exp(-u^2/2) (Maxwell-Boltzmann). Of all
    samples if the run is stationary, of the last one otherwise. The outermost bins hold what lies beyond.
    """
    kinds, velocity = species_table(scene), run.whole.velocity[slice(None) if is_stationary(scene) else slice(-1, None)]
    scale = np.sqrt(scene.mass / (_temperature(scene, velocity) or np.inf))[:, None]
    counts = [np.zeros((len(kinds.name), each), np.int64) for each in BINS.values()]
    for part in _parts(velocity):
        scaled = part * scale
        _count(counts[0], kinds.label[:, None], scaled + FASTEST)
        _count(counts[1], kinds.label, np.hypot(scaled[..., 0], scaled[..., 1]))
    return {"velocity_counts": counts[0], "speed_counts": counts[1]}


def _temperature(scene: Scene, velocity: np.ndarray) -> float:
    given = scene.velocities and scene.velocities.temperature
    if given is not None:
        return given
    return float(np.mean([(scene.mass / 2 * np.sum(one**2, axis=-1)).mean() for one in velocity]))


def _parts(velocity: np.ndarray) -> Iterator[np.ndarray]:
    """Cut (T, N, 2) into pieces along T."""
    step = max(1, VALUES_AT_ONCE // velocity[0].size)
    return (velocity[start : start + step] for start in range(0, len(velocity), step))


def _count(counts: np.ndarray, label: np.ndarray, value: np.ndarray) -> None:
    """Add to counts (K, bins) the values >= 0, each in the row of its label."""
    last = counts.shape[1] - 1
    place = np.clip(np.floor(value / BIN), 0, last).astype(np.int64) + label * (last + 1)
    counts += np.bincount(place.ravel(), minlength=counts.size).reshape(counts.shape)
