"""What is measured in the runs: as by plain loops, as theory has it, and the same however runs are
batched.
"""

from itertools import product

import numpy as np
import pytest
import xarray
from scipy import stats

import brownpipe as bp
from brownpipe import observables
from brownpipe.analysis.displacement import (
    component_squares,
    squared_of,
    tracer_square_displacement,
)
from brownpipe.analysis.estimator import Case
from brownpipe.engines import Engine
from brownpipe.engines.exact.simulation import simulate
from brownpipe.errors import RequestError
from brownpipe.observables import (
    ARRAYS,
    AXES,
    OBSERVABLES,
    averages,
    numbers_in,
    observe,
    orientation,
    pairs,
)
from brownpipe.observables.average import AVERAGES
from brownpipe.observables.trajectory import Run, Track
from brownpipe.scene import parse_scene
from brownpipe.storage.trajectories import read_trajectories, write_trajectories
from scenes import CHANNEL_X, CHANNEL_Y

W = "reflecting"
P = "periodic"
CHANNELS = [pytest.param(CHANNEL_X, id="channel-x"), pytest.param(CHANNEL_Y, id="channel-y")]
BOUNDARIES = [W, P, *CHANNELS]
SQUARE = ("square_displacement",)
QUARTIC = ("quartic_displacement",)
TRACER_ALONE = observables.tracer_observables(OBSERVABLES)
ALL = tuple(OBSERVABLES)
OF_TRACKS = [name for name in ALL if not observables.needs_events([name])]
REPORTED = {"quarter_collisions", "quarter_virial", "quarter_energy"}  # by the exact engine itself
MEASURED = [name for name in ARRAYS if name not in REPORTED]
UNLIKELY = 1e-7  # chance that a test against a distribution fails though all is right
SIGMAS = stats.norm.isf(UNLIKELY / 2)  # 5.3
TRACER = {"radius": 0.3, "mass": 2.0}
# in runs in channels, whose kernels for a big tracer are compiled for other tests, too
BIG_TRACER = TRACER | {"radius": 0.4}
BATH = (
    {"name": "bath", "count": 12, "radius": 0.2, "mass": 0.5},
    {"name": "rare", "count": 3, "radius": 0.1, "mass": 4},
)
FREE = {"time": 1.0, "tracer": "free"}


def make(boundary=P, kinds=BATH, tracer=TRACER, **more):
    """A stationary scene of three kinds of disks in an oblong box away from the origin."""
    mapping = {
        "box": {"x": [-1.0, 4.0], "y": [2.0, 6.0], "boundary": boundary},
        "disks": {"species": list(kinds)} | ({"tracer": tracer} if tracer else {}),
        "velocities": {"temperature": 1.5},
        "duration": 2.05,
        "sample_interval": 0.1,
        "equilibrate": FREE,
    }
    mapping = {key: value for key, value in (mapping | more).items() if value is not None}
    return parse_scene(mapping, "made.yaml")


def made_up(scene, seed=1):
    """A run of random positions, some outside the box by round-off, images and velocities."""
    rng = np.random.default_rng(seed)
    shape = (len(scene.times), scene.particles, 2)
    box = scene.box
    size = np.array([box.width, box.height])
    position = box.origin + rng.random(shape) * size
    position[:, 1] = np.where(
        box.periodic_axes, box.origin - np.array([1e-16, 1e-17]), position[:, 1]
    )
    position[:, 2] = np.where(box.periodic_axes, box.origin + size, position[:, 2])
    velocity = rng.normal(size=shape) * np.sqrt(1.5 / scene.mass)[:, None]
    image = None
    if box.has_images:
        image = np.where(box.periodic_axes, rng.integers(-3, 4, shape), 0).astype(np.int32)
    whole = Track(position, velocity, image)
    return Run(whole.select(slice(0, 1)), whole)


# -- against plain loops ---------------------------------------------------------------------------


def plain_pair_counts(scene, positions):
    """All pairs, all images, one by one."""
    disks = list(zip(scene.radius, scene.mass, strict=True))
    kinds = list(dict.fromkeys(disks))
    kind_of_disk = [kinds.index(disk) for disk in disks]
    row = {}
    for a in range(len(kinds)):
        for b in range(a, len(kinds)):
            row[a, b] = len(row)
    middles = AXES["distance"].coordinates(scene)
    width = middles[1] - middles[0]
    counts = np.zeros((len(row), len(middles)), int)
    boxes = product(*((0, -1, 1, -2, 2) if axis else (0,) for axis in scene.box.periodic_axes))
    images = np.array([*boxes]) * [scene.box.width, scene.box.height]
    for position in positions:
        for i in range(len(position)):
            for j in range(i):
                between = position[i] - position[j] + images
                r = np.sqrt((between**2).sum(axis=1)).min()
                if r < width * len(middles):
                    a, b = sorted((kind_of_disk[i], kind_of_disk[j]))
                    counts[row[a, b], int(r / width)] += 1
    return counts


@pytest.mark.parametrize("kinds", [BATH, BATH[:1], (BATH[1] | {"count": 15},)])
@pytest.mark.parametrize("tracer", [TRACER, None])
@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_pairs_are_counted_as_one_by_one(boundary, tracer, kinds):
    scene = make(boundary, kinds, tracer)
    run = made_up(scene)
    found = observe(scene, run, ("pair_distribution",))
    assert found["pair_snapshots"] == len(scene.times)
    expected = plain_pair_counts(scene, run.whole.position)
    disk_samples = scene.particles * len(scene.times)
    assert expected.sum() > 200
    assert expected.sum() == pytest.approx(disk_samples * pairs.pairs_in_reach(scene), rel=0.5)
    assert np.array_equal(found["pair_counts"], expected)


@pytest.mark.parametrize("boundary", CHANNELS)
def test_pairs_in_reach_of_a_narrow_channel(boundary):
    """The histogram ends at twice its height. Of 2,660 pairs, 2 % off each, within 10 %."""
    along = 0 if boundary == CHANNEL_X else 1
    sides = [[0, 60.0], [0, 0.5]] if along == 0 else [[0, 0.5], [0, 60.0]]
    box = {"x": sides[0], "y": sides[1], "boundary": boundary}
    bath = {"name": "bath", "count": 400, "radius": 0.1, "mass": 1.0}
    scene = make(kinds=[bath], tracer=None, box=box, equilibrate=None)
    position = np.random.default_rng(4).random((400, 2)) * scene.box.size
    counts = plain_pair_counts(scene, [position])
    assert counts.sum() / 400 == pytest.approx(pairs.pairs_in_reach(scene), rel=0.1)


@pytest.mark.parametrize("at_once", [20, 300])
@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_many_pairs_are_counted_in_small_blocks(boundary, at_once, monkeypatch):
    """Of a large disk among many small ones: memory is that of a block, the counts are the same."""
    kinds = (BATH[0] | {"count": 60, "radius": 0.05}, BATH[1])
    scene = make(boundary, kinds, TRACER | {"radius": 0.9})
    run = made_up(scene)
    expected = observe(scene, run, ("pair_distribution",))["pair_counts"]
    distances = pairs._distances
    pairs_in_blocks = []

    def noted(scene, inside, pair):
        pairs_in_blocks.append(len(pair))
        return distances(scene, inside, pair)

    monkeypatch.setattr(pairs, "_distances", noted)
    monkeypatch.setattr(pairs, "PAIRS_AT_ONCE", at_once)
    counts = observe(scene, run, ("pair_distribution",))["pair_counts"]
    assert np.array_equal(counts, expected)
    per_disk = 2 * pairs.pairs_in_reach(scene)  # with fewer pairs at once, a disk is a block
    most = max(pairs_in_blocks)
    assert sum(pairs_in_blocks) > 20 * most
    assert most <= 2 * max(at_once, per_disk)
    assert pairs.working_memory(scene) == pairs.BYTES_PER_PAIR * at_once


@pytest.mark.parametrize("small", [0.1, 0.5])
@pytest.mark.parametrize("boundary", [W, *CHANNELS])
def test_pairs_expected_around_the_tracer_are_those_of_many_points(boundary, small):
    """In all samples, against 20,000 points a sample; with 0.5 it is nearer the walls than the
    others can be. Along a channel to the nearest images, between walls 4 or 5 apart.
    """
    bath = BATH[0] | {"radius": small}
    scene = make(boundary, [bath, BATH[1]], {"radius": 0.3, "mass": 2.0})
    period = np.where(scene.box.periodic_axes, [5.0, 4.0], np.inf)
    run = made_up(scene)
    rng = np.random.default_rng(3)
    found = observe(scene, run, ("pair_distribution",))["pair_expected"]
    assert np.isnan(found[[0, 3, 4, 5]]).all()  # pairs without the tracer
    middles = AXES["distance"].coordinates(scene)
    edges = np.append(middles - middles[0], middles[-1] + middles[0])
    for number, radius, expected in ((12, small, found[1]), (3, 0.1, found[2])):
        accessible = np.array([5.0, 4.0]) - 2 * radius * ~scene.box.periodic_axes
        counts = np.zeros(len(middles), int)
        for tracer in run.whole.position[:, 0]:
            points = [1.5, 4.0] + (rng.random((20_000, 2)) - 0.5) * accessible
            apart = np.abs(points - tracer)
            distance = np.hypot(*np.minimum(apart, period - apart).T)
            counts += np.histogram(distance, edges)[0]
        points_expected = expected / number * 20_000
        assert points_expected.sum() > 1e5
        assert len(middles) > 160  # up to 2 or more
        assert counts.sum() == pytest.approx(points_expected.sum(), rel=0.02)  # 6 standard errors
        errors = np.sqrt(points_expected)
        assert (np.abs(counts - points_expected) < SIGMAS * errors + 4).all()


def test_reach_of_the_pair_distribution():
    """The smallest contact distance is the 40th edge; the last edge is where a pair may have two
    distances.
    """
    low = make(W, BATH[:1], box={"x": [0, 3.0], "y": [0, 2.0]})
    narrow = make(kinds=BATH[1:], box={"x": [0, 3.0], "y": [0, 0.7], "boundary": CHANNEL_X})
    small_tracer = {"radius": 0.12, "mass": 1}
    wide = make(P, BATH[:1], small_tracer, box={"x": [0, 9], "y": [0, 9], "boundary": P})
    for scene, contact, reach in (
        (make(P), 0.2, 2.0),  # half the shorter side, below 5 * 0.5
        (make(W), 0.2, 2.5),  # 5 * 0.5, below the accessible 4 - 0.6
        (low, 0.4, 1.4),  # accessible to the largest
        (make(CHANNEL_X), 0.2, 2.5),  # half its length, and 5 * 0.5
        (make(CHANNEL_Y), 0.2, 2.0),  # half its length
        (narrow, 0.2, 1.5),  # half its length, whatever its height
        (wide, 0.32, 2.0),
    ):
        middles = AXES["distance"].coordinates(scene)
        width = contact / 40
        assert middles[:2] == pytest.approx([width / 2, 3 * width / 2], rel=1e-14)
        assert middles[-1] + width / 2 == pytest.approx(reach, rel=1e-14)
    # of 0.006, 40 to the smallest diameter, up to 5 * 0.4
    assert len(AXES["wall_distance"].coordinates(wide)) == 333


def plain_mean_over(scene, average, product_of):
    """For each sample time the mean of a product of two samples, perhaps of each component, by the
    definition of the average.
    """
    last = len(scene.times) - 1
    equidistant = last + 1 if scene.duration == 2.0 else last
    means = []
    for lag in range(last + 1):
        origins = 1
        if "origins" in average and lag < last:
            origins = equidistant - lag
        products = [product_of(origin, origin + lag) for origin in range(origins)]
        means.append(np.mean(products, axis=0))
    return means


@pytest.mark.parametrize(
    ("boundary", "number", "axes"),
    [  # bins to the middle for the largest, of height 4 or width 5, or five diameters
        (W, 340, (0, 1)),
        (P, 400, (0, 1)),
        (CHANNEL_X, 340, (1,)),
        (CHANNEL_Y, 440, (0,)),
    ],
)
def test_density_profile_is_that_of_plain_loops(boundary, number, axes):
    """Each disk at the nearer of two opposite walls, in both directions, over the area along all
    walls; in a channel across it alone.
    """
    # 70 samples, of which 64 are counted at a time
    scene = make(boundary, sample_interval=0.03)
    run = made_up(scene)
    width = 0.005
    low = np.array([-1.0, 2.0])
    high = np.array([4.0, 6.0])
    expected = np.zeros((3, number))
    species = ((0.3, [0]), (0.2, range(1, 13)), (0.1, range(13, 16)))
    for k, (radius, disks) in enumerate(species):
        margin = np.where(scene.box.periodic_axes, 0.0, radius)
        length = high - low - 2 * margin
        area = 2 * width * sum(length[1 - axis] for axis in axes)
        for position, i, axis in product(run.whole.position, disks, axes):
            coordinate = position[i, axis]
            gap = min(coordinate - low[axis], high[axis] - coordinate) - margin[axis]
            if gap < number * width:
                expected[k, max(int(gap / width), 0)] += 1 / area
    found = observe(scene, run, ("density_profile",))["density_profile"]
    assert (expected > 0).sum() > 100
    np.testing.assert_allclose(found, expected / len(scene.times), rtol=1e-13)


@pytest.mark.parametrize("average", AVERAGES)
@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_averages_are_those_of_plain_loops(boundary, average):
    # others have this radius, or this mass
    same = {"name": "same", "count": 13, "radius": 0.2, "mass": 4}
    more = same | {"name": "more", "count": 2}
    kinds = (same, *BATH[::-1], more)  # the bath, most of the others, is not first
    duration = 2.0 if boundary == W else 2.05  # a multiple of 0.1, or none
    scene = make(boundary, kinds, None, duration=duration)
    run = made_up(scene)
    found = observe(scene, run, (*TRACER_ALONE, "bath_velocity_autocorrelation"), average)
    unwrapped = run.whole.position
    if boundary != W:
        unwrapped = unwrapped + run.whole.image * np.array([5.0, 4.0])
    followed = [*range(13), 28, 29] if "disks" in average else [0]
    both = np.stack([unwrapped, run.whole.velocity], axis=2)  # (T, N, 2, 2)
    rows = [
        ("square_displacement", followed, unwrapped, lambda a, b: np.sum((b - a) ** 2)),
        ("quartic_displacement", followed, unwrapped, lambda a, b: np.sum((b - a) ** 2) ** 2),
        ("component_square_displacement", followed, unwrapped, lambda a, b: (b - a) ** 2),
        ("displacement_velocity", followed, both, lambda a, b: np.vdot(b[1], b[0] - a[0])),
        ("velocity_autocorrelation", followed, run.whole.velocity, np.vdot),
        ("velocity_displacement", followed, both, lambda a, b: np.vdot(a[1], b[0] - a[0])),
        ("bath_velocity_autocorrelation", range(16, 28), run.whole.velocity, np.vdot),
    ]
    if scene.box.axes_differ:
        name = "component_quartic_displacement"
        rows.append((name, followed, unwrapped, lambda a, b: (b - a) ** 4))
        name = "component_displacement_velocity"
        rows.append((name, followed, both, lambda a, b: b[1] * (b[0] - a[0])))
        name = "component_velocity_displacement"
        rows.append((name, followed, both, lambda a, b: a[1] * (b[0] - a[0])))
        name = "component_velocity_autocorrelation"
        rows.append((name, followed, run.whole.velocity, lambda a, b: a * b))
    assert {name for name, *_ in rows} == {*found}, "each array needs a row"
    for name, disks, tracks, product_of in rows:
        by_disk = []
        for disk in disks:
            values = tracks[:, disk]

            def of_samples(i, k, values=values, product_of=product_of):
                return product_of(values[i], values[k])

            by_disk.append(plain_mean_over(scene, average, of_samples))
        # sums of some 100 products of size 100: round-off below 1e-12; fourth powers are larger and
        # do not cancel
        np.testing.assert_allclose(
            found[name], np.mean(by_disk, axis=0).T, rtol=1e-13, atol=1e-12 * 100
        )


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("top", [6.0, 7.0])
def test_the_numbers_of_a_run_are_counted_before_it(boundary, top):
    """Components are measured in channels and between walls of unequal lengths alone."""
    scene = make(boundary, box={"x": [-1.0, 4.0], "y": [2.0, top], "boundary": boundary})
    run = made_up(scene)
    for name in TRACER_ALONE:
        found = observe(scene, run, [name])
        assert sum(values.size for values in found.values()) == numbers_in(scene, [name])
    has_components = boundary != P and not (boundary == W and top == 7.0)
    found = observe(scene, run, ["velocity_autocorrelation"])
    assert ("component_velocity_displacement" in found) == has_components


# -- averages over many time origins, by Fourier transforms ----------------------------------------


def extended_means(scene, track, lag):
    """For each array its mean over all pairs of samples so far apart, and its scale, in extended
    precision.
    """
    size = np.array([scene.box.width, scene.box.height], np.longdouble)
    count = len(track.position)
    r = track.position[lag:].astype(np.longdouble) - track.position[: count - lag]
    if track.image is not None:
        r += (track.image[lag:] - track.image[: count - lag]) * size
    earlier = track.velocity[: count - lag].astype(np.longdouble)
    later = track.velocity[lag:].astype(np.longdouble)
    square = (r**2).sum(axis=-1)
    speed = np.sqrt((track.velocity**2).sum(axis=-1).mean())
    growth = speed * np.sqrt(square.mean())
    quartic = (square**2).mean()
    along_later = (r * later).sum(axis=-1).mean()
    along_earlier = (r * earlier).sum(axis=-1).mean()
    correlation = (earlier * later).sum(axis=-1).mean()
    along = {}
    for name, power in (("square", 2), ("quartic", 4)):
        mean = (r**power).mean(axis=(0, 1))
        along[f"component_{name}_displacement"] = (mean, mean)
    for name, products in (
        ("displacement_velocity", r * later),
        ("velocity_displacement", r * earlier),
    ):
        along[f"component_{name}"] = (products.mean(axis=(0, 1)), growth)
    product = (earlier * later).mean(axis=(0, 1))
    along["component_velocity_autocorrelation"] = (product, speed**2)
    return along | {
        "square_displacement": (square.mean(), square.mean()),
        "quartic_displacement": (quartic, quartic),
        "displacement_velocity": (along_later, growth),
        "velocity_displacement": (along_earlier, growth),
        "velocity_autocorrelation": (correlation, speed**2),
    }


@pytest.mark.parametrize("duration", [30.0, 30.05])
@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_averages_over_many_origins_are_plain_sums(boundary, duration, monkeypatch):
    """At all lags, however few samples and disks are transformed at once; the last sample of a
    duration of 30.05 has t = 0 as its only origin.
    """
    scene = make(boundary, duration=duration)
    run = made_up(scene)
    names = (*TRACER_ALONE, "bath_velocity_autocorrelation")
    found = observe(scene, run, names, "origins")
    equidistant = run.tracer.first_samples(301)
    bath = run.whole.select(slice(1, 13)).first_samples(301)
    for lag in range(301):
        expected = extended_means(scene, equidistant, lag)
        for name in expected.keys() & found.keys():
            value, scale = expected[name]
            assert (abs(found[name][..., lag] - value) <= 1e-13 * scale).all()
        value, scale = extended_means(scene, bath, lag)["velocity_autocorrelation"]
        assert abs(found["bath_velocity_autocorrelation"][lag] - value) <= 1e-13 * scale
    if duration > 30:
        alone = Track(*(None if values is None else values[[0, 301]] for values in run.tracer))
        expected = extended_means(scene, alone, 1)
        for name in expected.keys() & found.keys():
            value, scale = expected[name]
            assert (abs(found[name][..., 301] - value) <= 1e-13 * scale).all()
    monkeypatch.setattr(averages, "VALUES_AT_ONCE", 100)
    monkeypatch.setattr(averages, "MOST_LAGS", 64)
    in_small_blocks = observe(scene, run, names, "origins")
    for name, values in found.items():
        np.testing.assert_allclose(in_small_blocks[name], values, rtol=1e-12, atol=1e-13)


def straight(samples, rng):
    """A path on which disks go farthest from their origin compared with the first lags."""
    velocity = np.tile([0.8, -0.6], (samples, 1))
    return 0.1 * np.arange(samples)[:, None] * velocity, velocity


def caged(samples, rng):
    """A path in a cage of 0.01, which the disk leaves some ten times."""
    velocity = rng.normal(size=(samples, 2))
    jumps = rng.random((samples, 2)) < 10 / samples
    return np.cumsum(jumps, axis=0) + 0.01 * rng.normal(size=(samples, 2)), velocity


@pytest.mark.parametrize("boundary", [P, CHANNELS[0]])
@pytest.mark.parametrize("path", [straight, caged])
def test_no_digits_are_lost_far_from_the_first_image(path, boundary):
    """21,001 samples, a million boxes from the first image: squares to 1e-12, fourth powers to
    1e-10.
    """
    scene = make(boundary, duration=2100.0)
    assert list(observables.problems(scene, TRACER_ALONE, "origins")) == []
    position, velocity = path(len(scene.times), np.random.default_rng(2))
    size = np.array([scene.box.width, scene.box.height])
    boxes = np.floor(position / size)
    inside = position - boxes * size + scene.box.origin
    far = np.add(boxes, [1_000_000, -1_000_000])
    track = Track(inside[:, None], velocity[:, None], far.astype(np.int32)[:, None])
    found = observe(scene, Run(track, track), TRACER_ALONE, "origins")
    some = np.geomspace(1, 21_000, 60).astype(int)
    for lag in np.unique([*some, *(21_001 - some)]):
        expected = extended_means(scene, track, lag)
        for name in expected.keys() & found.keys():
            value, scale = expected[name]
            tolerance = 1e-10 if "quartic" in name else 1e-12
            assert (abs(found[name][..., lag] - value) <= tolerance * scale).all()


def test_few_lags_of_many_are_averaged_one_by_one(monkeypatch):
    """Which would take a time that grows as the square of the number of samples."""
    scene = make(duration=2000.0, kinds=BATH[:1])
    track = made_up(scene).tracer
    pairs_of_samples = averages.Pairs
    lags = []

    def noted(track, size, earlier, later):
        lags.append(later)
        return pairs_of_samples(track, size, earlier, later)

    monkeypatch.setattr(averages, "Pairs", noted)
    observe(scene, Run(track, None), SQUARE, "origins")
    assert 10 < len(lags) < 60


def test_what_was_not_recorded_is_refused():
    track = Track(np.zeros((3, 1, 2)))
    with pytest.raises(ValueError, match="track: has no velocities"):
        _ = track.known_velocity
    with pytest.raises(ValueError, match="run: has no tracks of all disks"):
        _ = Run(track, None).every_disk


# -- orientational order ---------------------------------------------------------------------------


def plain_bonds(scene, position):
    """Pairs of disks whose Voronoi cells share an edge inside the box, and the vectors between
    them, one by one.

    A point of the edge is as far from both disks and no nearer to any other: a segment of their
    bisector, cut by one line for each other disk. Periodic: all disks and those of the 24 nearest
    boxes, in a channel 4; walls cut it, too.
    """
    size = np.array([scene.box.width, scene.box.height])
    is_wall = ~scene.box.periodic_axes
    boxes = product(*(range(-2, 3) if axis else (0,) for axis in scene.box.periodic_axes))
    shifts = np.array(sorted(boxes, key=lambda shift: shift != (0, 0)))  # its own box first
    sites = position - scene.box.origin
    points = np.concatenate([sites + shift * size for shift in shifts])
    for i, j in product(range(len(sites)), range(len(points))):
        if i == j:
            continue
        bond = points[j] - sites[i]
        middle = (points[j] + sites[i]) / 2
        along = np.array([-bond[1], bond[0]])
        others = np.delete(points, (i, j), axis=0)
        # |middle + t along - other|^2 >= |middle + t along - site|^2 for each other
        slope = 2 * (others - sites[i]) @ along
        limit = ((others - middle) ** 2).sum(axis=1) - bond @ bond / 4
        slope = np.concatenate([slope, along[is_wall], -along[is_wall]])
        limit = np.concatenate([limit, (size - middle)[is_wall], middle[is_wall]])
        falls = slope < 0
        rises = slope > 0
        begin = np.max(limit[falls] / slope[falls], initial=-np.inf)
        end = np.min(limit[rises] / slope[rises], initial=np.inf)
        if begin < end and (limit[slope == 0] >= 0).all():
            yield i, bond


@pytest.mark.slow
@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_orientational_order_is_that_of_neighbours_one_by_one(boundary, monkeypatch):
    # of images at first; it is to grow until there are enough
    monkeypatch.setattr(orientation, "MARGIN", 0.1)
    scene = make(boundary, duration=0.4)
    run = made_up(scene)
    if boundary == P:
        run.whole.position[:, 2] -= 0.5  # it is an image of disk 1
    found = observe(scene, run, ("orientational_order",))
    roots = []
    for position in run.whole.position:
        angles = [[] for _ in range(16)]
        for disk, (x, y) in plain_bonds(scene, position):
            angles[disk].append(np.exp(6j * np.arctan2(y, x)))
        assert boundary != P or np.mean([len(bonds) for bonds in angles]) == 6  # Euler's formula
        roots.append(abs(np.mean([np.mean(bonds) for bonds in angles])))
    squares = np.square(roots)
    assert found["orientational_order_squared"] == pytest.approx(squares.mean(), rel=1e-10)
    assert found["orientational_order"] == pytest.approx(np.mean(roots), rel=1e-10)
    assert found["quarter_order"] == pytest.approx(roots[1:], rel=1e-10)  # a sample each


def test_orientational_order_of_a_triangular_lattice_is_1():
    side = 12.0 * np.array([1.0, np.sqrt(0.75)])
    box = {"x": [-side[0] / 2, side[0] / 2], "y": [-side[1] / 2, side[1] / 2], "boundary": P}
    scene = make(
        kinds=[{"name": "gas", "count": 144, "radius": 0.1, "mass": 1.0}], tracer=None, box=box
    )
    row, column = np.divmod(np.arange(144), 12)
    lattice = np.stack([column + row % 2 / 2, row * np.sqrt(0.75)], axis=1) - side / 2
    assert orientation.square_order(scene, lattice) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("boundary", "columns", "rows", "spacing", "expected"),
    [
        (P, 7, 7, (0.3, 0.3), 0.0),  # bonds at 0, 90, 180 and 270 degrees
        (P, 5, 8, (0.7, 0.4), 0.0),
        (P, 1, 1, (1.0, 1.0), 0.0),  # a disk and its own images
        (W, 5, 5, (0.3, 0.3), 0.0),
        (W, 6, 4, (0.9, 0.4), 1 / 18),  # at the long sides +1/3, at the short ones -1/3, of 24
        (CHANNEL_X, 6, 4, (0.9, 0.4), 1 / 6),  # at both walls +1/3, of 4 rows
        (CHANNEL_Y, 6, 4, (0.9, 0.4), 1 / 9),  # at both walls -1/3, of 6 columns
        (CHANNEL_X, 1, 1, (1.0, 1.0), 1.0),  # a disk and its images at both sides
    ],
)
def test_disks_across_the_rectangles_of_a_lattice_are_no_neighbours(
    boundary, columns, rows, spacing, expected
):
    size = np.array([columns, rows]) * spacing
    box = {"x": [0, size[0]], "y": [0, size[1]], "boundary": boundary}
    kinds = [{"name": "gas", "count": columns * rows, "radius": 0.1, "mass": 1.0}]
    scene = make(kinds=kinds, tracer=None, box=box)
    row, column = np.divmod(np.arange(columns * rows), columns)
    lattice = (np.stack([column, row], axis=1) + 0.5) * spacing
    assert np.sqrt(orientation.square_order(scene, lattice)) == pytest.approx(expected, abs=1e-12)


def test_energies_and_the_temperature_of_a_scene_without_one():
    scene = make(velocities={"standard_deviation": 2.0}, equilibrate=None)
    run = made_up(scene)
    found = observe(scene, run, ("species_energy", "velocity_distribution"))
    energy = 0.5 * scene.mass * np.sum(run.whole.velocity**2, axis=-1)
    plain = [energy[:, 0], energy[:, 1:13].mean(axis=1), energy[:, 13:].mean(axis=1)]
    np.testing.assert_allclose(found["species_energy"].T, plain, rtol=1e-14)
    # of the last sample, as the scene is not stationary
    thermal_speed = np.sqrt(energy[-1].mean() / scene.mass)
    scaled = run.whole.velocity[-1] / thermal_speed[:, None]
    speed = np.hypot(scaled[:, 0], scaled[:, 1])
    species_index = [0, *[1] * 12, *[2] * 3]
    for name, values in (("velocity", scaled), ("speed", speed[:, None])):
        middles = AXES[f"{name}_bin"].coordinates(scene)
        counts = np.zeros((3, len(middles)), int)
        for species, components in zip(species_index, values, strict=True):
            for component in components:
                counts[species, np.argmin(abs(middles - component))] += 1
        assert np.array_equal(found[f"{name}_counts"], counts)


def test_what_lies_beyond_the_bins_is_in_the_outermost(monkeypatch):
    # three samples of these disks
    monkeypatch.setattr("brownpipe.observables.velocity.VALUES_AT_ONCE", 100)
    scene = make()
    run = made_up(scene)
    run.whole.velocity[:, :2] = [[1e3, -1e3], [1e300, 0.0]]
    run.whole.velocity[:, 2:4] = 0.0
    found = observe(scene, run, ("velocity_distribution",))
    samples = len(scene.times)
    assert found["velocity_counts"][0, [0, -1]].tolist() == [samples, samples]
    assert found["speed_counts"][0, -1] == samples
    assert found["velocity_counts"].sum(axis=1).tolist() == [2 * samples, 24 * samples, 6 * samples]


def test_kinds_in_a_list_of_disks():
    kinds = [(0.1, 1.0), (0.2, 1.0), (0.1, 1.0), (0.1, 3.0)]
    disks = []
    for i, (radius, mass) in enumerate(kinds):
        motion = {"position": [i, 3.0], "velocity": [i, 0.0]}
        disks.append(motion | {"radius": radius, "mass": mass})
    short = {"duration": 1e-3, "sample_interval": None}
    scene = make(W, disks=disks, velocities=None, equilibrate=None, **short)
    names = ("species_energy", "pair_distribution")
    found = simulate(scene, [0], {"none"}, observables=names).observables
    assert AXES["species"].coordinates(scene) == ["kind-1", "kind-2", "kind-3"]
    assert found["species_energy"][0, 0].tolist() == [1.0, 0.5, 13.5]
    pairs_of_kinds = found["pair_counts"][0].sum(axis=1).tolist()
    pair_names = AXES["species_pair"].coordinates(scene)
    assert dict(zip(pair_names, pairs_of_kinds, strict=True)) == {  # nearer than 5 * 0.3 = 1.5
        "kind-1:kind-1": 0,
        "kind-1:kind-2": 2,
        "kind-1:kind-3": 1,
        "kind-2:kind-2": 0,
        "kind-2:kind-3": 0,
        "kind-3:kind-3": 0,
    }


# -- against nature --------------------------------------------------------------------------------


def test_ballistic_flight():
    """Disks that do not meet: <r^2> = v0^2 t^2, and the autocorrelation stays v0^2, but for
    round-off.
    """
    lone = [{"name": "bath", "count": 1, "radius": 1e-4, "mass": 1.0}]
    scene = make(kinds=lone, tracer={"radius": 1e-4, "mass": 2.0})
    names = ("square_displacement", "velocity_autocorrelation")
    found = simulate(scene, range(20), {"none"}, observables=names).observables
    assert not found["pair_collisions"].any()
    v2 = found["initial_square_speed"][:, None]
    unchanged = np.tile(v2, len(scene.times))
    np.testing.assert_allclose(found["velocity_autocorrelation"], unchanged, rtol=1e-14)
    square = v2 * scene.times**2
    np.testing.assert_allclose(found["square_displacement"], square, rtol=1e-12, atol=1e-14)
    rounding = 1e-14 * np.sqrt(v2.max())  # positions of size 6 have round-off 1e-15
    for name in ("displacement_velocity", "velocity_displacement"):
        growth = v2 * scene.times
        np.testing.assert_allclose(found[name], growth, rtol=1e-12, atol=rounding)


def test_logarithmic_samples_see_the_same_run():
    """From ballistic flight on: the run does not know when it is looked at."""
    ends = {"sample_interval": None, "equilibrate": None, "duration": 2.0}
    logarithmic = make(**ends, samples={"per_decade": 4, "first": 1e-6})
    runs = simulate(logarithmic, range(4), {"tracer"}, observables=SQUARE)
    runs_at_ends = simulate(make(**ends), range(4), {"tracer"}, observables=SQUARE)
    assert runs.times.tolist() == logarithmic.times.tolist()
    assert len(runs.times) > 25
    assert runs.tracer.position[-1].tobytes() == runs_at_ends.tracer.position[-1].tobytes()
    first = runs.observables["square_displacement"][:, 1]
    flight = runs.observables["initial_square_speed"] * 1e-12
    # positions of size 6 have round-off 1e-15, so that of a path of 1e-6 is 1e-9
    np.testing.assert_allclose(first, flight, rtol=1e-7)


# -- the same however runs are batched and recorded ------------------------------------------------


@pytest.mark.parametrize("average", ["runs", "origins"])
@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_the_same_to_the_bit(boundary, average):
    scene = make(boundary, tracer=BIG_TRACER)
    measured = {"observables": ALL, "average": average}
    unrecorded = simulate(scene, range(5), {"none"}, **measured)
    assert (unrecorded.tracer, unrecorded.whole, unrecorded.average) == (None, {}, average)
    batches = [simulate(scene, seeds, {"tracer"}, **measured) for seeds in ([0, 1], [2, 3, 4])]
    recorded = simulate(scene, range(5), {"tracer", "all"}, **measured)
    assert list(recorded.whole) == list(range(5))
    for name, values in unrecorded.observables.items():
        assert values.tobytes() == recorded.observables[name].tobytes()
        in_batches = np.concatenate([batch.observables[name] for batch in batches])
        assert values.tobytes() == in_batches.tobytes()
    case = Case(scene, Engine("exact"), scene.times)
    square = recorded.observables["square_displacement"]
    assert squared_of(case, recorded) is square
    components = recorded.observables["component_square_displacement"]
    assert component_squares(case, recorded) is components
    if average == "runs":
        from_track = tracer_square_displacement(case, recorded)
        assert from_track.tobytes() == square.tobytes()
        assert components.sum(axis=1).tobytes() == square.tobytes()
        tracks_alone = simulate(scene, range(5), {"tracer"})
        assert component_squares(case, tracks_alone).tobytes() == components.tobytes()
    square_speed = [np.sum(recorded.whole[seed].velocity[0, 0] ** 2) for seed in range(5)]
    assert square_speed == unrecorded.observables["initial_square_speed"].tolist()


@pytest.mark.parametrize("name", ALL)
def test_an_observable_alone_is_what_it_is_among_all(name):
    """Whether the tracks of all disks are kept for it or that of the tracer alone."""
    for scene in (make(), make(kinds=[{"name": "same", "count": 4, **TRACER}], tracer=None)):
        names = [other for other in ALL if OBSERVABLES[other].why_unfit(scene) is None]
        if name not in names:
            continue
        alone = simulate(scene, [0, 1], {"none"}, observables=(name,)).observables
        among_all = simulate(scene, [0, 1], {"none"}, observables=names).observables
        arrays = [array for array in OBSERVABLES[name].arrays if array in alone]
        assert arrays == [array for array in MEASURED if array in alone]
        for array in arrays:
            assert np.array_equal(alone[array], among_all[array], equal_nan=True)


@pytest.mark.parametrize("name", OF_TRACKS)
def test_histograms_are_of_the_last_sample_unless_the_scene_is_stationary(name):
    """Two runs with the same last sample have the same arrays exactly if the record says so."""
    for scene in (make(), make(equilibrate={"time": 1.0, "tracer": "pinned"})):
        run = made_up(scene)
        other_run = made_up(scene, seed=2)
        for values, last in zip(other_run.whole, run.whole, strict=True):
            values[-1] = last[-1]
        arrays = observe(scene, run, (name,))
        other_arrays = observe(scene, other_run, (name,))
        same = all(np.array_equal(arrays[array], other_arrays[array]) for array in arrays)
        assert same == (OBSERVABLES[name].is_over_samples and not observables.is_stationary(scene))


# -- in files --------------------------------------------------------------------------------------


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_arrays_in_a_file(boundary, tmp_path):
    scene = make(boundary, tracer=BIG_TRACER)
    ensemble = simulate(scene, [3, 4, 9], {"none"}, observables=ALL, average="origins")
    write_trajectories(tmp_path / "x.h5", scene, Engine("exact"), ensemble)
    again = read_trajectories(tmp_path / "x.h5").ensemble
    assert again.average == "origins"
    assert again.times.tobytes() == scene.times.tobytes()
    assert again.observables.keys() == ensemble.observables.keys()
    for name, values in ensemble.observables.items():
        assert np.array_equal(again.observables[name], values, equal_nan=True)
    with xarray.open_dataset(tmp_path / "x.h5", engine="h5netcdf") as run:
        for name in ARRAYS.keys() & ensemble.observables.keys():
            variable = ARRAYS[name]
            assert run[name].dims == ("seed", *variable.dims)
            assert run[name].attrs == {"units": variable.units, "long_name": variable.long_name}
            for dim in variable.dims:
                assert np.array_equal(run[dim], AXES[dim].coordinates(scene))
        tracer = run.species_energy.sel(seed=9, species="tracer").sel(time=0.5, method="nearest")
        assert tracer == ensemble.observables["species_energy"][2, 5, 0]
        pairs_of_tracer = run.species_pair.values.tolist()[:3]
        assert pairs_of_tracer == ["tracer:tracer", "tracer:bath", "tracer:rare"]


# -- what is refused -------------------------------------------------------------------------------

LISTED = [{"position": [0.0, 3.0], "velocity": [1.0, 0.0], "radius": 0.1, "mass": 1.0}]
EXPLICIT = {"disks": LISTED, "velocities": None, "equilibrate": None}
HUGE = TRACER | {"radius": 1.85}  # in a box of height 4
DUST = {"name": "dust", "count": 2, "radius": 1e-7, "mass": 1.0}
LOGARITHMIC = {"sample_interval": None, "samples": {"per_decade": 5}}


@pytest.mark.parametrize(
    ("more", "names", "average", "message"),
    [
        (
            {},
            ("msd",),
            "runs",
            "observables: 'msd' is unknown; must be of square_displacement, velocity_auto",
        ),
        ({}, SQUARE * 2, "runs", "observables: must have names that differ"),
        (EXPLICIT | {"kinds": (), "tracer": None, "disks": []}, SQUARE, "runs", "no disk"),
        (
            EXPLICIT,
            ("pair_distribution",),
            "runs",
            "observables: pair_distribution needs two disks",
        ),
        (
            {"boundary": W, "kinds": (), "tracer": HUGE},
            ("density_profile",),
            "runs",
            "needs walls farther apart",
        ),
        ({"kinds": [DUST, BATH[0]]}, ("pair_distribution",), "runs", "more than 1000000 bins"),
        ({}, SQUARE, "all", "average: 'all' is unknown; must be runs or origins or disks"),
        (
            {},
            ("species_energy",),
            "origins",
            "average: origins needs square_displacement or velocity_autocorrelation",
        ),
        (
            EXPLICIT,
            SQUARE,
            "origins",
            "stationary from t = 0, but the velocities of its disks are given",
        ),
        (
            {"velocities": {"standard_deviation": 1}},
            SQUARE,
            "origins",
            "velocities.temperature is not given",
        ),
        (
            {"equilibrate": None},
            SQUARE,
            "origins",
            "but they do not equilibrate; must be equilibrate: {time: T, tracer: free}",
        ),
        (
            {"equilibrate": 3.0},
            SQUARE,
            "disks",
            "default; must be equilibrate: {time: 3, tracer: free}",
        ),
        (
            {},
            SQUARE,
            "disks",
            "average: disks needs disks of the tracer's radius and mass, and there is no",
        ),
        (LOGARITHMIC, SQUARE, "origins", "average: origins needs sample_interval, not samples"),
    ],
)
def test_what_a_scene_does_not_have_is_refused(more, names, average, message):
    scene = make(**more)
    with pytest.raises(RequestError) as refusal:
        simulate(scene, [0], {"none"}, observables=names, average=average)
    assert str(refusal.value).startswith("made: ")
    assert message in str(refusal.value)


# -- averages over time origins and disks ----------------------------------------------------------


FLUID = {
    "box": {"x": [0.0, 6.0], "y": [0.0, 6.0], "boundary": P},
    "disks": {"species": [{"name": "a", "count": 12, "radius": 0.5, "mass": 1.0}]},
    "velocities": {"temperature": 1.0},
    "equilibrate": {"time": 1.0, "tracer": "free"},
    "duration": 2.0,
    "sample_interval": 0.1,
}


def test_an_average_over_both_is_the_mean_of_all_disks_over_origins():
    """Averages over origins of each disk alone, as if it were the tracer."""
    scene = parse_scene(FLUID, "fluid.yaml")
    names = ("square_displacement", "velocity_autocorrelation")
    run = made_up(scene)
    both = observe(scene, run, names, "origins,disks")
    by_disk = []
    for disk in range(scene.particles):
        alone = Run(run.whole.select([disk]), run.whole)
        by_disk.append(observe(scene, alone, names, "origins"))
    for name in ("square_displacement", "velocity_autocorrelation"):
        mean = np.mean([arrays[name] for arrays in by_disk], axis=0)
        np.testing.assert_allclose(both[name], mean, rtol=1e-12, atol=1e-12)


def test_both_are_one_average_however_they_are_written():
    scene = bp.Scene(**FLUID, name="fluid")
    asked = {"observables": "square_displacement", "record": "none", "quiet": True}
    listed = bp.simulate(scene, 2, average=["disks", "origins"], **asked)
    text = bp.simulate(scene, 2, average="origins, disks", **asked)
    assert listed.attrs["average"] == "origins,disks"
    assert np.array_equal(listed.square_displacement, text.square_displacement)
    with pytest.raises(RequestError, match="'origins,runs' is unknown; must be runs or origins or"):
        bp.simulate(scene, 2, average=["origins", "runs"], **asked)
