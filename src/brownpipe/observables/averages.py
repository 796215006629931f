"""Averages of products of two samples of a run, as functions of the time between them: from t = 0,
or over time origins. T samples, M disks.

An average over time origins is one over all pairs of samples that are as far apart. A product of
two samples is a sum over k of f_k(earlier) g_k(later), like |b - a|^2 = |a|^2 + |b|^2 - 2 a.b. The
sums of such terms over all pairs are correlations, which Fourier transforms give in O(T log T) in
place of O(T^2) (G. R. Kneller et al., Comput. Phys. Commun. 91, 191 (1995)).

The terms are much larger than the product where the disk has gone far in the run and little between
the two samples: transforms of whole runs lose digits. Here lags that are alike are averaged
together, in blocks of the run as long as the longest of them, with positions from the middle of the
block: displacements between its samples are not much larger than those asked for. On a straight
path, the worst case, squares agree with plain sums to 1e-12 and fourth powers to 1e-11.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from brownpipe.observables.average import over_origins
from brownpipe.observables.trajectory import Track, displacement
from brownpipe.scene import Scene
from brownpipe.scene.scene import SAME

# lags that are averaged together, a power of two; fewer are averaged one by one
FEWEST_LAGS = 32
MOST_LAGS = 2**17  # which bounds the memory that it takes to some 50 MB
MOST_LAGS_PER_LAG = 8  # times the first of them at most, so that no digits are lost
VALUES_AT_ONCE = 2**16  # samples of disks that are transformed together, to stay in the cache


@dataclass(frozen=True)
class Pairs:
    """Pairs of samples of a track: each of the earlier with its later one, or one with all."""

    track: Track
    size: tuple[float, float]  # (width, height) of the box
    earlier: slice
    later: slice

    @cached_property
    def displacement(self) -> np.ndarray:
        """(T', M, 2) [length], from the earlier to the later sample."""
        return displacement(
            self.track.position, self.track.image, self.size, self.earlier, self.later
        )

    @property
    def earlier_velocity(self) -> np.ndarray:
        """(T', M, 2), or (1, M, 2) [length/time]."""
        return self.track.known_velocity[self.earlier]

    @property
    def later_velocity(self) -> np.ndarray:
        """(T', M, 2) [length/time]."""
        return self.track.known_velocity[self.later]


@dataclass(frozen=True)
class Samples:
    """Samples of B blocks of a run, W of each; all values are 0 for samples after its last."""

    track: Track
    size: tuple[float, float]  # (width, height) of the box
    index: np.ndarray  # (B, W) of the samples
    origin: np.ndarray  # (B, 1) index of the sample from which displacements are measured

    @cached_property
    def present(self) -> np.ndarray:
        """(B, W, 1) 1.0 for samples of the run."""
        return (self.index < len(self.track.position)).astype(float)[..., None]

    @cached_property
    def displacement(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y, (B, W, M) each [length]."""
        position, _, image = self.track
        displacements = displacement(
            position, image, self.size, self._inside(self.origin), self._inside(self.index)
        )
        return displacements[..., 0] * self.present, displacements[..., 1] * self.present

    @cached_property
    def square(self) -> np.ndarray:
        """(B, W, M) squared displacement."""
        x, y = self.displacement
        return x * x + y * y

    @cached_property
    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Components along x and y, (B, W, M) each [length/time]."""
        velocity = self.track.known_velocity[self._inside(self.index)]
        return velocity[..., 0] * self.present, velocity[..., 1] * self.present

    def _inside(self, index: np.ndarray) -> np.ndarray:
        """Return indices of samples of the run: beyond its end that of the last one."""
        return np.minimum(index, len(self.track.position) - 1)


# f_k of the earlier and g_k of the later samples, (B, W, M or 1) each
Factors = Iterator[tuple[np.ndarray, np.ndarray]]


class Product(NamedTuple):
    """A product of two samples of a disk, in the two forms of which averages are made."""

    values: Callable[[Pairs], np.ndarray]  # (T', M) of pairs of samples
    factors: Callable[[Samples, Samples], Factors]  # whose products add up to it


def averaged(scene: Scene, track: Track, average: str, products: Sequence[Product]) -> np.ndarray:
    """Return the means (K, T) of K products over the M disks of a track and, if `average` says so,
    over time origins; otherwise the earlier sample is that at t = 0.
    """
    if over_origins(average):
        return averaged_over_origins(scene, track, products)
    pairs = Pairs(track, _size(scene), slice(0, 1), slice(None))
    return np.stack([product.values(pairs).mean(axis=1) for product in products])


def averaged_by_component(
    scene: Scene, track: Track, average: str, products: Mapping[str, Sequence[Product]]
) -> dict[str, np.ndarray]:
    """Return the means of products along x and along y (2, T), as `component_NAME` by the names of
    the products, and their sums (T,) by these names.
    """
    sums = {}
    components = {}
    for name, along_axes in products.items():
        means = averaged(scene, track, average, along_axes)
        sums[name] = means.sum(axis=0)
        components[f"component_{name}"] = means
    return sums | components


def averaged_over_origins(scene: Scene, track: Track, products: Sequence[Product]) -> np.ndarray:
    """Return the means (K, T) of K products over all pairs of samples that are as far apart, and
    over the M disks of a track.

    Sample times are multiples of the sample interval; a duration that is not has t = 0 as its only
    time origin.
    """
    size = _size(scene)
    count = _equidistant_samples(scene)

    def mean_of_pairs(earlier: slice, later: slice) -> list[float]:
        pairs = Pairs(track, size, earlier, later)
        return [product.values(pairs).mean() for product in products]

    means = np.empty((len(products), len(scene.times)))
    equidistant = track.first_samples(count)
    lag = 0
    while lag < count:
        lags = _lags_at_once(lag, count - lag)
        if lags < FEWEST_LAGS:
            means[:, lag] = mean_of_pairs(slice(0, count - lag), slice(lag, count))
            lag += 1
        else:
            origins = count - lag - np.arange(lags)
            sums = _sums_over_origins(equidistant, size, products, lag, lags)
            means[:, lag : lag + lags] = sums / (origins * track.disks)
            lag += lags
    if count < len(scene.times):
        means[:, count] = mean_of_pairs(slice(0, 1), slice(count, count + 1))
    return means


def _equidistant_samples(scene: Scene) -> int:
    """Return how many sample times are multiples of the sample interval: all, or all but the
    last.
    """
    count = len(scene.times)
    last = (count - 1) * scene.sample_interval
    return count if abs(scene.duration - last) <= SAME * scene.sample_interval else count - 1


def _lags_at_once(lag: int, origins: int) -> int:
    """Return how many lags, from `lag` with its number of origins on, are averaged together: a
    power of two, or 0.

    The last of them has an eighth of the origins at least: a transform has the round-off of the sum
    over most origins at all lags.
    """
    most = min(MOST_LAGS, MOST_LAGS_PER_LAG * lag, origins - origins // 8)
    return 2 ** (most.bit_length() - 1) if most else 0


def _sums_over_origins(
    track: Track, size: tuple[float, float], products: Sequence[Product], lag: int, lags: int
) -> np.ndarray:
    """Return the sums (K, lags) of products over all time origins and disks, for `lags` lags from
    `lag` on.

    Time origins are taken in blocks of `lags` samples; the later samples that belong to a block are
    twice as many, with which a transform is as long.
    """
    starts = np.arange(0, len(track.position) - lag, lags)[:, None]
    disks_at_once = max(1, VALUES_AT_ONCE // lags)
    blocks_at_once = max(1, VALUES_AT_ONCE // (lags * min(disks_at_once, track.disks)))
    spectra = np.zeros((len(products), lags + 1), complex)
    for first_disk in range(0, track.disks, disks_at_once):
        tracks = track.select(slice(first_disk, first_disk + disks_at_once))
        for first_block in range(0, len(starts), blocks_at_once):
            start = starts[first_block : first_block + blocks_at_once]
            middle = start + (lag + 2 * lags) // 2
            earlier = Samples(tracks, size, start + np.arange(lags), middle)
            later = Samples(tracks, size, start + lag + np.arange(2 * lags), middle)
            for spectrum, product in zip(spectra, products, strict=True):
                for f, g in product.factors(earlier, later):
                    transform = np.conj(np.fft.rfft(f, 2 * lags, axis=1))
                    spectrum += np.sum(transform * np.fft.rfft(g, axis=1), axis=(0, 2))
    return np.fft.irfft(spectra, 2 * lags, axis=1)[:, :lags]


def _size(scene: Scene) -> tuple[float, float]:
    return scene.box.width, scene.box.height
