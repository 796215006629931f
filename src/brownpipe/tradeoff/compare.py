"""All biases of one engine and setting, relative to the exact runs of a scene, with their
uncertainties.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.displacement import per_run_lines
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.runs import Group, blocks_of, reported
from brownpipe.analysis.variables import with_intervals
from brownpipe.engines import Engine
from brownpipe.engines.definition import REFERENCE_NAME
from brownpipe.engines.ensemble import Ensemble, select
from brownpipe.errors import AnalysisError
from brownpipe.observables.trajectory import displacement
from brownpipe.scene import Scene
from brownpipe.tradeoff import bias
from brownpipe.tradeoff.bias import Pairs

Numbers = dict[str, float]  # the variables of one setting, by name
Comparison = dict[str, float | Estimate]  # some of them, with their uncertainties
DIFFUSION_ALONG = ("d_x", "d_y")  # names of D along x and along y
APART = 1e-3  # of the tracer's radius: two trajectories further apart than this have departed


class EngineRuns(NamedTuple):
    """All runs of one scene, number of disks and engine, in the order of their seeds; failed ones
    left out.
    """

    scene: Scene
    engine: Engine
    seeds: np.ndarray  # (S,) int64
    times: np.ndarray  # (T,) [time]
    displacement: np.ndarray  # (S, T, 2) of the tracer from its start [length]
    squared: np.ndarray  # (S, T) its square [length^2]
    worst_overlap: np.ndarray  # (S,) in contact distances; NaN where an engine does not report it
    pair_counts: np.ndarray | None  # (S, P, R) pairs of species by distance, if recorded
    failed: int  # number of runs left out

    @property
    def share_sound(self) -> float:
        """The share of runs that did not fail."""
        return len(self.seeds) / max(len(self.seeds) + self.failed, 1)

    @property
    def is_reference(self) -> bool:
        return self.engine.name == REFERENCE_NAME


def read_runs(groups: Sequence[Group]) -> list[EngineRuns]:
    """Return the runs of groups of trajectory files, `analysis.runs.group_by_case`.

    Of each block of runs only what is compared is kept, so that tracks of other disks and further
    observables are in memory for one block at a time.
    """
    all_runs = []
    for group in groups:
        contents = group.pattern.contents
        blocks = [runs_of(contents.scene, contents.engine, block) for block in blocks_of(group)]
        all_runs.append(join_blocks(blocks))
    return all_runs


def join_blocks(blocks: Sequence[EngineRuns]) -> EngineRuns:
    """Return blocks of runs of one scene and engine, their seeds ascending, as one."""
    pair_counts = _join_counts(blocks)
    return blocks[0]._replace(
        seeds=np.concatenate([block.seeds for block in blocks]),
        displacement=np.concatenate([block.displacement for block in blocks]),
        squared=np.concatenate([block.squared for block in blocks]),
        worst_overlap=np.concatenate([block.worst_overlap for block in blocks]),
        pair_counts=pair_counts,
        failed=sum(block.failed for block in blocks),
    )


def _join_counts(blocks: Sequence[EngineRuns]) -> np.ndarray | None:
    """Return the pair counts (S, P, R) of all blocks: 0 in blocks without, None if all are."""
    recorded = [block.pair_counts for block in blocks if block.pair_counts is not None]
    if not recorded:
        return None
    _, *shape = recorded[0].shape
    runs = sum(len(block.seeds) for block in blocks)
    joined = np.zeros((runs, *shape), recorded[0].dtype)
    end = 0
    for block in blocks:
        start = end
        end = start + len(block.seeds)
        if block.pair_counts is not None:
            joined[start:end] = block.pair_counts
    return joined


def runs_of(
    scene: Scene, engine: Engine, ensemble: Ensemble, squares: str | None = None
) -> EngineRuns:
    """Return the runs of an ensemble with ascending seeds.

    squares: an observable that stands for the tracer's squared displacement. Without its track
    displacements are NaN.
    """
    runs = select(ensemble, reported(ensemble, "failed") == 0)
    failed = len(ensemble.seeds) - len(runs.seeds)
    from_start = _from_start(scene, runs)
    squared = runs.observables[squares] if squares else (from_start**2).sum(axis=-1)
    worst_overlap = reported(runs, "worst_overlap")
    pair_counts = runs.observables.get("pair_counts")
    return EngineRuns(
        scene=scene,
        engine=engine,
        seeds=runs.seeds,
        times=runs.times,
        displacement=from_start,
        squared=squared,
        worst_overlap=worst_overlap,
        pair_counts=pair_counts,
        failed=failed,
    )


def _from_start(scene: Scene, runs: Ensemble) -> np.ndarray:
    """Return the tracer's displacements (S, T, 2) from its start; NaN without its track."""
    if runs.tracer is None:
        return np.full((len(runs.seeds), len(runs.times), 2), np.nan)
    size = (scene.box.width, scene.box.height)
    by_time = displacement(runs.tracer.position, runs.tracer.image, size)
    return np.ascontiguousarray(by_time.transpose(1, 0, 2))


# --- biases


def compare(
    runs: EngineRuns,
    exact: EngineRuns,
    window: tuple[float, float],
    seconds: float,
    paired: bool = True,
) -> Numbers:
    """Return every variable of one setting by name. `seconds` is the CPU time of a run; `window`
    that of D.

    `paired`: runs of equal seeds start from the same state. Raises AnalysisError for fewer than two
    runs, and if the tracer of the exact runs does not move.
    """
    refuse_unfit(exact, runs)
    pairs = bias.same_seeds(runs.seeds, exact.seeds) if paired else None
    if pairs is not None and len(pairs[0]) < 2:
        pairs = None
    values: Comparison = {
        "runs": len(runs.seeds),
        "failed_runs": runs.failed,
        "seconds": seconds,
        "worst_overlap": runs.worst_overlap.max(),
    }
    values["paired_runs"] = 0 if pairs is None else len(pairs[0])
    values["departure_time"] = np.nan if pairs is None else _departure(runs, exact, pairs)
    values |= _biases(runs, exact, pairs, window)
    values |= _distribution(runs, exact, pairs)
    values |= _contact(runs, exact, pairs)
    arrays = with_intervals(values)
    return {name: np.asarray(value, float).item() for name, value in arrays.items()}


def refuse_unfit(exact: EngineRuns, *others: EngineRuns) -> None:
    """Raise AnalysisError for fewer than two runs, or an MSD of `exact` of 0 at the end: errors are
    relative to it.
    """
    for runs in (*others, exact):
        if len(runs.seeds) < 2:
            raise AnalysisError(
                f"{runs.scene.name}, {runs.engine.label}: fewer than two runs that did not fail"
            )
    if not exact.squared[:, -1].mean() > 0.0:
        why = "the tracer does not move, and errors are relative to its MSD"
        raise AnalysisError(f"{exact.scene.name}: {why}; leave this scene out of the study")


def _biases(
    runs: EngineRuns, exact: EngineRuns, pairs: Pairs | None, window: tuple[float, float]
) -> Comparison:
    """MSD at the end and each D in the window that is stated, in one resampling; NaN for D of all
    motion where it is not.
    """
    axes = exact.scene.box.axes_of_diffusion
    values_of_runs = _per_run(runs, window, axes)
    samples = np.stack([*values_of_runs.values()], axis=1)
    references = np.stack([*_per_run(exact, window, axes).values()], axis=1)
    biases = bias.relative_bias(samples, references, pairs)
    values: Comparison = {}
    if axes:
        values["d_bias"] = Estimate(*np.full(4, np.nan))
        values["d_spread"] = np.nan
    for column, name in enumerate(values_of_runs):
        deviation = samples[:, column].std(ddof=1)
        values[f"{name}_bias"] = biases.at(column)
        values[f"{name}_spread"] = deviation / abs(references[:, column].mean())
    return values


def _per_run(
    runs: EngineRuns, window: tuple[float, float], axes: Sequence[int]
) -> dict[str, np.ndarray]:
    """Return by name (S,) each: r^2 at the end, and the slope of r^2 over the window, or in its
    place those of the squared displacements along the axes, x (0) and y (1).
    """
    values = {"msd": runs.squared[:, -1]}
    if not axes:
        values["d"] = _slopes(runs, runs.squared, window)
    for axis in axes:
        name = DIFFUSION_ALONG[axis]
        values[name] = _slopes(runs, runs.displacement[..., axis] ** 2, window)
    return values


def _slopes(runs: EngineRuns, squared: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """Return the slopes (S,) of the lines through squared displacements (S, T) in a window."""
    return per_run_lines(squared, runs.times, [window])[:, 0, 0]


def diffusion_of(runs: EngineRuns, window: tuple[float, float]) -> tuple[float, float]:
    """Return the mean over runs of D, slope/4 in a window of time, and its standard error."""
    slopes = _slopes(runs, runs.squared, window)
    error = slopes.std(ddof=1) / np.sqrt(len(slopes))
    return float(slopes.mean()) / 4, float(error) / 4


def _distribution(runs: EngineRuns, exact: EngineRuns, pairs: Pairs | None) -> Comparison:
    """Distance of the distributions of displacements at the end, and its spread in one run."""
    distance = np.sqrt(runs.squared[:, -1])
    exact_distance = np.sqrt(exact.squared[:, -1])
    return {
        "displacement_bias": bias.total_variation(distance, exact_distance, pairs),
        "displacement_spread": bias.spread_of_shares(),
    }


def _contact(runs: EngineRuns, exact: EngineRuns, pairs: Pairs | None) -> Comparison:
    """g(r) near contact; {} without pair counts, or if the two sets of runs have different bins."""
    counts = runs.pair_counts
    reference = exact.pair_counts
    if counts is None or reference is None or counts.shape[1:] != reference.shape[1:]:
        return {}
    deviation = bias.contact_deviation(counts, reference, pairs)
    return {} if deviation is None else {"contact_bias": deviation}


def _departure(runs: EngineRuns, exact: EngineRuns, pairs: Pairs) -> float:
    """Median over common seeds of the time at which the tracer departs from the exact trajectory;
    inf for never.
    """
    rows, exact_rows = pairs
    track = runs.displacement[rows].transpose(1, 0, 2)
    exact_track = exact.displacement[exact_rows].transpose(1, 0, 2)
    bound = APART * exact.scene.radius[0]
    times = np.sort(departure_time(exact.times, track, exact_track, bound))
    return float(times[len(times) // 2])


def departure_time(
    times: np.ndarray, position: np.ndarray, reference: np.ndarray, bound: float
) -> np.ndarray:
    """Return the first of `times` (T,) at which tracks (T, S, 2) are further apart than `bound`:
    (S,), inf for never.

    A position that is NaN counts as departed. Trajectories of hard disks diverge exponentially, so
    this time grows only as the logarithm of 1/error: it tells for how long single collisions are
    right, but nothing about averages. It is resolved to one sample interval.
    """
    apart = position - reference
    departed = ~(np.hypot(apart[..., 0], apart[..., 1]) <= bound)
    return np.where(departed.any(axis=0), times[departed.argmax(axis=0)], np.inf)
