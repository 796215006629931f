"""The exact step of the Langevin equation, of any length: D. T. Gillespie, Phys. Rev. E 54, 2084 (1996)."""

import numpy as np

from brownpipe.engines.kernels import entry_point

FLAT = 0.1  # gamma dt below which x - 2 tanh(x/2) is summed as a series: the closed form cancels


def step_weights(dt, gamma: float, square_speed: float) -> np.ndarray:
    """Return (steps, 4) weights of the exact step of length `dt` (steps,); `square_speed` is kT/m, of one component.

    v' = e v + w1 xi and x' = x + w2 (v + v') + w3 eta with independent standard normal xi, eta, where X = gamma dt,
    e = exp(-X), w1^2 = kT/m (1 - e^2), w2 = tanh(X/2)/gamma, w3^2 = 2 kT/(m gamma^2) (X - 2 tanh(X/2)). This is
    Gillespie's pair of correlated numbers, written so that x' is that of the middle of v and v' plus what v and v'
    leave open. Without friction it is x' = x + v dt.
    """
    dt = np.asarray(dt, float)
    x = gamma * dt
    speed = np.sqrt(square_speed)
    spread = speed * np.sqrt(-np.expm1(-2 * x))
    middle = dt / 2 * _tanh_ratio(x / 2)
    return np.stack([np.exp(-x), spread, middle, dt * np.sqrt(2 * _left_open(x)) * speed], axis=-1)


def _tanh_ratio(y):
    """tanh(y) / y, 1 at 0."""
    safe = np.where(y == 0.0, 1.0, y)
    return np.where(y == 0.0, 1.0, np.tanh(safe) / safe)


def _left_open(x):
    """(x - 2 tanh(x/2)) / x^2; below FLAT by the power series of tanh, of which 5 terms are enough."""
    y2 = (np.minimum(x, FLAT) / 2) ** 2
    series = x / 12 * (1 + y2 * (-2 / 5 + y2 * (17 / 105 + y2 * (-62 / 945 + y2 * 1382 / 51975))))
    safe = np.where(x < FLAT, 1.0, x)
    return np.where(x < FLAT, series, (1 - 2 * np.tanh(safe / 2) / safe) / safe)


@entry_point
def follow(path, normal, weights):
    """Continue a path from its first entry: path (T, 2, 2) holds position and velocity, normal (T - 1, 2, 2)."""
    for k in range(len(normal)):
        decay, spread, middle, loose = weights[k, 0], weights[k, 1], weights[k, 2], weights[k, 3]
        for c in range(2):
            v = path[k, 1, c]
            after = decay * v + spread * normal[k, 0, c]
            path[k + 1, 1, c] = after
            path[k + 1, 0, c] = path[k, 0, c] + middle * (v + after) + loose * normal[k, 1, c]
