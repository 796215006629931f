"""Failed runs in words: which they are, and why."""

from collections.abc import Mapping

import numpy as np

from brownpipe.engines.state import Ensemble
from brownpipe.scene.seeds import seed_text

HEALTH = ("energy_drift", "worst_overlap", "momentum_residual")  # observables with bounds that a run must not exceed


def failures(ensemble: Ensemble) -> str:
    """Return which runs failed their health check, which could not go on and why the first could not; "" for none."""
    runs = len(ensemble.seeds)
    unhealthy = [seed for seed in ensemble.failed_seeds.tolist() if seed not in ensemble.stopped]
    parts = [f"failed their health check: {len(unhealthy)} of {runs} runs: {seed_text(unhealthy)}"] if unhealthy else []
    if ensemble.stopped:
        stopped = sorted(ensemble.stopped)
        first = f"seed {stopped[0]}: {ensemble.stopped[stopped[0]]}"
        parts.append(f"could not go on: {len(stopped)} of {runs} runs: {seed_text(stopped)} ({first})")
    return "; ".join(parts)


def stopped_in_words(stopped: Mapping[int, str]) -> str:
    """Return how many runs could not go on, and why the first of them could not, in one line."""
    seed = min(stopped)
    return f"{len(stopped)} could not go on, seed {seed}: {stopped[seed]}"


def reason_of(ensemble: Ensemble, column: int) -> str:
    """Return why a run failed: why it could not go on, or the numbers of its health check."""
    seed = int(ensemble.seeds[column])
    if seed in ensemble.stopped:
        return f"it could not go on: {ensemble.stopped[seed]}"
    known = [name for name in HEALTH if name in ensemble.observables]
    numbers = [f"{name} {np.abs(ensemble.observables[name][column]):.2g}" for name in known]
    return f"its health check: {', '.join(numbers)}" if numbers else "its health check"
