"""Exported runs, as gsd, MDAnalysis, freud, ASE and the csv module read them: the numbers of the
trajectory file.

The tests import these programs themselves: every process that runs tests imports this file to list
them.
"""

import csv
import itertools
import sys
import warnings

import gsd.hoomd
import numpy as np
import pytest

import brownpipe as bp
from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.engines.exact.simulation import simulate
from brownpipe.errors import DONE, WRONG_REQUEST
from brownpipe.observables import observe
from brownpipe.observables.trajectory import Run, Track
from brownpipe.scene import parse_scene
from brownpipe.storage.trajectories import read_trajectories, write_trajectories
from ensembles import make_runs, make_scene
from pipeline import ROOT
from scenes import CHANNEL_X, CHANNEL_Y, PERIODIC, WALLS

SINGLE = 2.0**-24  # largest relative error of a number rounded to single precision
SHIFTED = 2.0**-25 + 1e-15  # and of a position, of the box: at most half of it from the centre
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings(
        "ignore:Reader has no dt information"
    ),  # MDAnalysis does not read log/time
]


@pytest.fixture(scope="module")
def fluid(tmp_path_factory):
    """The file of a run of 200 equal disks in equilibrium, in an oblong periodic box away from the
    origin.
    """
    mapping = {
        "box": {"x": [-3.0, 17.0], "y": [2.0, 14.0], "boundary": "periodic"},
        "disks": {"species": [{"name": "disk", "count": 200, "radius": 0.4, "mass": 0.7}]},
        "velocities": {"temperature": 1.5},
        "equilibrate": {"time": 2.0, "tracer": "free"},
        "duration": 2.0,
        "sample_interval": 0.1,
    }
    scene = parse_scene(mapping, "fluid.yaml")
    measured = ("pair_distribution", "square_displacement")
    path = tmp_path_factory.mktemp("fluid") / "fluid.h5"
    ensemble = simulate(scene, [5], {"tracer", "all"}, observables=measured, average="disks")
    write_trajectories(path, scene, Engine("exact"), ensemble)
    for form in ("gsd", "xyz"):
        exported(path, form)
    return path


@pytest.fixture(scope="module")
def walled(tmp_path_factory):
    """The file of two made-up runs of a large and 11 small disks between walls."""
    return written(
        tmp_path_factory.mktemp("walled") / "walled.h5", make_scene("walled", 12), (3, 8)
    )


@pytest.fixture(scope="module")
def channel_x(tmp_path_factory):
    """The file of two made-up runs in a channel along x."""
    scene = make_scene("channel_x", 12, boundary=CHANNEL_X)
    return written(tmp_path_factory.mktemp("channel_x") / "channel_x.h5", scene, (3, 8))


@pytest.fixture(scope="module")
def channel_y(tmp_path_factory):
    """The file of two made-up runs in a channel along y."""
    scene = make_scene("channel_y", 12, boundary=CHANNEL_Y)
    return written(tmp_path_factory.mktemp("channel_y") / "channel_y.h5", scene, (3, 8))


def written(path, scene, seeds, speed=1.0):
    """A file of runs of random positions and velocities."""
    runs = make_runs(scene, seeds)
    shape = (len(scene.times), scene.particles, 2)
    numbers = np.random.default_rng(1)
    crossed = numbers.integers(-2, 3, shape).astype(np.int32) * scene.box.periodic_axes
    image = crossed if scene.box.has_images else None
    whole = {
        seed: Track(numbers.uniform(-2.7, 2.7, shape), numbers.normal(0, speed, shape), image)
        for seed in seeds
    }
    write_trajectories(path, scene, Engine("exact"), runs.ensemble._replace(whole=whole))
    return path


def exported(path, form, *options):
    """The file that the verb writes."""
    target = path.with_suffix(f".{form}")
    target.unlink(missing_ok=True)  # an export replaces no file
    assert main(["export", str(path), "--to", form, "--output", str(target), *options]) == DONE
    return target


def run_in(path, seed):
    """The scene, the sample times and the track of a whole run."""
    scene, _, ensemble = read_trajectories(path)[:3]
    return scene, ensemble.times, ensemble.whole[seed]


def edges_of(scene):
    return np.array([scene.box.width, scene.box.height])


def refused(capsys, *options):
    """The one line with which an export is refused."""
    assert main(["export", *map(str, options)]) == WRONG_REQUEST
    out, error = capsys.readouterr()
    assert out == "" and error.count("\n") == 1
    return error


# -- what the files contain ------------------------------------------------------------------------

NO_WALLS = ": GSD has no walls, so programs take the box for periodic"
REMARKS = {
    "fluid": "",
    "walled": f"{NO_WALLS}: switch that off, or enlarge the box\n",
    "channel_x": f"{NO_WALLS} in y, too: switch that off, or enlarge the box in y\n",
    "channel_y": f"{NO_WALLS} in x, too: switch that off, or enlarge the box in x\n",
}


@pytest.mark.parametrize(
    ("name", "seed", "types"),
    [
        ("fluid", 5, ["disk"]),
        ("walled", 3, ["tracer", "bath"]),
        ("channel_x", 3, ["tracer", "bath"]),
        ("channel_y", 3, ["tracer", "bath"]),
    ],
)
def test_gsd_has_the_first_run_in_single_precision(name, seed, types, request, capsys):
    path = request.getfixturevalue(name)
    scene, times, track = run_in(path, seed)
    edges = edges_of(scene)
    periodic = scene.box.periodic_axes
    target = exported(path, "gsd")
    remark = capsys.readouterr().err
    assert remark.endswith(REMARKS[name]) and bool(remark) == scene.box.has_walls
    with gsd.hoomd.open(target) as frames:
        assert len(frames) == len(times) == 21
        for k, frame in enumerate(frames):
            box = frame.configuration
            disks = frame.particles
            assert (box.step, box.dimensions, list(box.box)) == (k, 2, [*edges, 0, 0, 0, 0])
            assert frame.log["time"] == times[k]
            assert frame.log["periodic"].tolist() == periodic.tolist()
            assert disks.types == types
            assert list(disks.typeid) == [0] + [len(types) - 1] * (scene.particles - 1)
            np.testing.assert_allclose(disks.diameter, 2 * scene.radius, rtol=SINGLE)
            np.testing.assert_allclose(disks.mass, scene.mass, rtol=SINGLE)
            centred = track.position[k] - scene.box.origin - edges / 2
            assert np.all(abs(disks.position[:, :2] - centred) <= SHIFTED * edges)
            np.testing.assert_allclose(disks.velocity[:, :2], track.velocity[k], rtol=SINGLE)
            image = track.image[k] if periodic.any() else np.zeros_like(disks.image[:, :2])
            np.testing.assert_array_equal(disks.image[:, :2], image)
            assert not disks.position[:, 2].any()
            assert not disks.velocity[:, 2].any()
            assert not disks.image[:, 2].any()
    assert disks.image.any(axis=0).tolist() == [*periodic, False]


@pytest.mark.parametrize(
    ("name", "seed", "periodic"),
    [
        ("fluid", 5, [True, True]),
        ("walled", 8, [False, False]),
        ("channel_x", 8, [True, False]),
        ("channel_y", 8, [False, True]),
    ],
)
def test_ase_reads_every_digit_of_the_xyz(name, seed, periodic, request):
    import ase.io

    path = request.getfixturevalue(name)
    scene, times, track = run_in(path, seed)
    frames = ase.io.read(exported(path, "xyz", "--seed", str(seed)), ":")
    assert [frame.info["Time"] for frame in frames] == list(times)
    for k, frame in enumerate(frames):
        assert list(frame.pbc) == [*periodic, False]
        assert list(frame.cell.lengths()) == [
            *edges_of(scene),
            1,
        ]
        assert list(frame.info["Origin"]) == [*scene.box.origin, -0.5]
        np.testing.assert_array_equal(frame.positions[:, :2], track.position[k])
        np.testing.assert_array_equal(frame.arrays["velo"][:, :2], track.velocity[k])
        np.testing.assert_allclose(
            frame.get_velocities()[:, :2], track.velocity[k], rtol=4e-16
        )  # m v / m
        for key, values in {
            "radius": scene.radius,
            "mass": scene.mass,
            "masses": scene.mass,
        }.items():
            np.testing.assert_array_equal(frame.arrays[key], values)
        np.testing.assert_array_equal(frame.get_masses(), scene.mass)
        assert not frame.positions[:, 2].any() and ("image" in frame.arrays) == any(periodic)
        if any(periodic):
            np.testing.assert_array_equal(frame.arrays["image"][:, :2], track.image[k])
        if name != "fluid":
            assert list(frame.arrays["type"]) == ["tracer", *["bath"] * 11]


@pytest.mark.parametrize("boundary", [PERIODIC, WALLS, CHANNEL_X, CHANNEL_Y])
def test_a_table_has_every_digit_of_all_whole_runs(boundary, tmp_path):
    scene = make_scene("table", 4, boundary=boundary)
    path = written(tmp_path / "table.h5", scene, (3, 8))
    tracks = read_trajectories(path).ensemble.whole
    with open(exported(path, "csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    columns = {
        "position": ("x", "y"),
        "velocity": ("velocity_x", "velocity_y"),
        "image": ("image_x", "image_y"),
    }
    if boundary == WALLS:
        del columns["image"]
    vectors = itertools.chain(*columns.values())
    assert list(rows[0]) == ["seed", "time", "disk", "species", *vectors, "radius", "mass"]
    expected = itertools.product((3, 8), enumerate(scene.times), range(4))
    for row, (seed, (k, time), disk) in zip(rows, expected, strict=True):
        assert (int(row["seed"]), float(row["time"]), int(row["disk"])) == (seed, time, disk)
        assert row["species"] == ("bath" if disk else "tracer")
        assert float(row["radius"]) == scene.radius[disk]
        assert float(row["mass"]) == scene.mass[disk]
        for name, titles in columns.items():
            stored = getattr(tracks[seed], name)[k, disk]
            assert [float(row[title]) for title in titles] == list(stored)
    assert exported(path, "csv", "--seed", "8").read_text().count("\n") == 1 + len(rows) // 2


def test_a_table_of_a_file_without_whole_runs_has_all_tracers(tmp_path, capsys):
    scene = make_scene()
    runs = make_runs(scene, [0, 1, 4], failed=[4])
    write_trajectories(tmp_path / "tracer.h5", scene, Engine("exact"), runs.ensemble)
    with open(exported(tmp_path / "tracer.h5", "csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    out, error = capsys.readouterr()
    assert "tracer.csv: 3 runs, " in out
    assert error.endswith("tracer.csv: failed their health check: 1 of 3 runs: 4\n")
    position = np.array([[float(row["x"]), float(row["y"])] for row in rows]).reshape(3, -1, 2)
    np.testing.assert_array_equal(position, runs.ensemble.tracer.position.swapaxes(0, 1))
    assert [int(row["seed"]) for row in rows] == [0] * 21 + [1] * 21 + [4] * 21
    one = exported(tmp_path / "tracer.h5", "csv", "--seed", "1").read_text().splitlines()
    assert len(one) == 22 and one[1].startswith("1,0.0,0,tracer,")


# -- the same results from other programs ----------------------------------------------------------


@pytest.mark.parametrize(
    ("average", "mode", "disks"), [("disks", "direct", 200), ("origins", "window", 1)]
)
def test_square_displacement_by_freud_and_mdanalysis(fluid, average, mode, disks):
    """`disks` is freud's mode `direct`: all disks, from t = 0. `origins` is `window`, of the tracer
    alone.

    Rounding to single precision changes a squared displacement by a few SINGLE * r^2. freud's
    `window` is a difference of sums of r^2 over all T samples, in single precision, divided by the
    number of time origins.
    """
    import freud
    import MDAnalysis
    from MDAnalysis.analysis.msd import EinsteinMSD

    scene, _, track = run_in(fluid, 5)
    run = Run(Track(*(values[:, :1] for values in track)), track)
    ours = observe(scene, run, ["square_displacement"], average)["square_displacement"]
    if average == "disks":
        np.testing.assert_array_equal(
            ours, read_trajectories(fluid).ensemble.observables["square_displacement"][0]
        )
    with gsd.hoomd.open(fluid.with_suffix(".gsd")) as frames:
        tracks = [
            (frame.particles.position[:disks], frame.particles.image[:disks]) for frame in frames
        ]
        position, image = map(np.array, zip(*tracks, strict=True))
        box = frames[0].configuration.box
    unwrapped = position + image * box[:3].astype(float)
    bound = 8 * SINGLE * (unwrapped**2).sum(axis=-1).max()
    measured = freud.msd.MSD(freud.box.Box.from_box(box), mode).compute(position, images=image)
    samples = len(ours)
    sums = samples / (samples - np.arange(samples)) if mode == "window" else 1.0
    assert np.all(bound * sums < 1e-4 * ours[-1])
    assert np.all(abs(measured.msd - ours) <= bound * sums)
    if mode == "window":
        universe = MDAnalysis.Universe.empty(1, trajectory=True).load_new(unwrapped)
        theirs = EinsteinMSD(universe, msd_type="xy", fft=False).run().results.timeseries
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=bound)


@pytest.mark.parametrize("form", ["gsd", "xyz"])
def test_the_lines_of_the_guide_read_times_and_displacements_into_mdanalysis(fluid, form):
    """MDAnalysis holds positions in single precision, rounded at the size of the box."""
    guide = (ROOT / "docs" / "guide.md").read_text()
    lines = guide.partition("import MDAnalysis\n")[2].partition("```")[0]
    own = (
        ("seed17.gsd", str(fluid.with_suffix(f".{form}"))),
        ("dt=0.01", "dt=0.1"),
        ("[6, 6, ", "[20, 12, "),
    )
    for of_guide, of_fluid in own:
        assert lines.count(of_guide) == 1
        lines = lines.replace(of_guide, of_fluid)
    names = {}
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message="Reader has no dt information")
        warnings.filterwarnings("ignore", message="Unknown masses")  # of types that are no elements
        exec(f"import MDAnalysis\n{lines}", names)
    scene, times, track = run_in(fluid, 5)
    edges = edges_of(scene)
    unwrapped = track.position + track.image * edges
    expected = []
    for lag in range(len(times)):
        displaced = unwrapped[lag:] - unwrapped[: len(times) - lag]
        expected.append(np.mean(np.sum(displaced**2, axis=-1)))
    assert abs(track.image).max() > 0
    np.testing.assert_allclose(names["msd"].times, times, rtol=1e-15, atol=0)
    rounding = 8 * SINGLE * edges.max() * np.sqrt(np.max(expected))
    np.testing.assert_allclose(names["msd"].results.timeseries, expected, rtol=0, atol=rounding)


# -- refusals, and what is left --------------------------------------------------------------------


def test_refusals(walled, tmp_path, capsys, monkeypatch):
    tracer, empty, bare = (tmp_path / name for name in ("tracer.h5", "empty.h5", "bare.h5"))
    runs = make_runs(make_scene(), [1])
    write_trajectories(tracer, make_scene(), Engine("exact"), runs.ensemble)
    write_trajectories(empty, make_scene(), Engine("exact"), runs.ensemble._replace(tracer=None))
    bath = {"species": [{"name": "bath", "count": 0, "radius": 0.1, "mass": 0.4}]}
    bp.save(bp.simulate(make_scene("bare", 0, disks=bath), [2], record="all", quiet=True), bare)
    monkeypatch.chdir(tmp_path)
    asked = {
        "tracer.h5: holds no whole runs; brownpipe simulate SCENE --record all makes some": (
            tracer,
            "gsd",
        ),
        "walled.h5: holds no run of seed 17; must be of 3,8": (walled, "csv", "--seed", 17),
        "empty.h5: holds no whole runs; brownpipe simulate SCENE --record all makes some": (
            empty,
            "csv",
        ),
        "bare.h5: holds no disks": (bare, "csv"),
        "run.xyz: the output must end in .gsd, not '.xyz'": (walled, "gsd", "--output", "run.xyz"),
        "is an input": (walled, "gsd", "--output", walled),
    }
    for message, (path, form, *options) in asked.items():
        assert message in refused(capsys, path, "--to", form, *options)
    monkeypatch.setitem(sys.modules, "gsd", None)
    message = refused(capsys, walled, "--to", "gsd")
    assert (
        "--to gsd: needs the package gsd (" in message
        and "pip install gsd; or xyz or csv" in message
    )
    assert sorted(tmp_path.iterdir()) == [bare, empty, tracer]


@pytest.mark.parametrize(("length", "speed"), [(1e-40, 1.0), (1e40, 1.0), (1.0, 1e40)])
def test_gsd_refuses_what_it_would_round_to_nothing(length, speed, tmp_path, capsys):
    side = [0.0, 10 * length]
    disks = [{"name": "disk", "count": 2, "radius": length, "mass": 1.0}]
    velocities = {"standard_deviation": length}
    scene = make_scene(
        "far", 2, velocities=velocities, box={"x": side, "y": side}, disks={"species": disks}
    )
    path = written(tmp_path / "far.h5", scene, [0], speed)
    message = refused(capsys, path, "--to", "gsd", "--output", tmp_path / "far.gsd")
    assert "holds numbers from 1.2e-38 to 3.4e+38 only; use xyz or csv" in message
    assert [*tmp_path.iterdir()] == [path]
