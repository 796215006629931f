"""The figures: complete, the same bytes each time, and with the dataset's numbers in them."""

import csv
import warnings

import matplotlib
import numpy as np
import pytest

from brownpipe import figures, state, storage
from brownpipe.analysis import aggregate
from brownpipe.figures import cases, displacement_distribution, msd, style
from brownpipe.figures.tables import Table, to_csv
from ensembles import make_runs, make_scene, study, write

NAMES = ("msd", "displacement_distribution", "particle_counts", "health")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return aggregate(study(tmp_path_factory.mktemp("study"), failed=(7, 33)))


@pytest.fixture(scope="module")
def folder(dataset, tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    figures.render(dataset, folder)
    return folder


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_every_figure_is_png_svg_and_csv(dataset, folder, tmp_path):
    expected = {f"{name}.{kind}" for name in NAMES for kind in ("png", "svg", "csv")} | {"summary.csv"}
    assert {path.name for path in folder.iterdir()} == expected
    for name in NAMES:
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert b"<svg" in (folder / f"{name}.svg").read_bytes()


def test_same_bytes_whatever_the_user_has_set(dataset, folder, tmp_path):
    with matplotlib.rc_context({"font.size": 30, "axes.grid": False, "svg.hashsalt": None, "savefig.dpi": 20}):
        paths = figures.render(dataset, tmp_path)
    assert {path.name for path in paths} == {path.name for path in folder.iterdir()}
    assert all(path.read_bytes() == (folder / path.name).read_bytes() for path in paths)


def test_no_date_in_the_files(folder):
    assert not any(b"<dc:date>" in path.read_bytes() for path in folder.glob("*.svg"))
    assert not any(b"tIME" in path.read_bytes() or b"Software" in path.read_bytes() for path in folder.glob("*.png"))


def test_style_is_put_back(dataset, tmp_path):
    before = dict(matplotlib.rcParams)
    figures.render(dataset.sel(particles=[10]), tmp_path)
    assert dict(matplotlib.rcParams) == before


def test_one_particle_count_has_nothing_to_compare(dataset, tmp_path):
    names = {path.stem for path in figures.render(dataset.sel(particles=[10]), tmp_path)}
    assert names == {"msd", "displacement_distribution", "health", "summary"}


def test_particle_count_that_is_shown(dataset):
    def shown(data, particles=None):
        return [
            (str(case.scene.item()), int(case.particles)) for case in cases.one_count(cases.cases_of(data), particles)
        ]

    assert shown(dataset) == [("hot", 20), ("thermal", 20)]
    assert shown(dataset, 10) == [("hot", 10), ("thermal", 10)]
    assert shown(dataset.assign_coords(particles=[150, 200])) == [("hot", 150), ("thermal", 150)]
    with pytest.raises(ValueError, match=r"particles: 15 is not in the dataset; choose one of \[10, 20\]"):
        shown(dataset, 15)


def test_each_scene_shows_a_count_of_its_own(dataset):
    only = (dataset.scene == "hot") == (dataset.particles == 10)
    with_own = dataset.assign(runs=dataset.runs.where(only, 0), failed_runs=dataset.failed_runs.where(only, 0))
    assert [int(case.particles) for case in cases.one_count(cases.cases_of(with_own))] == [10, 20]


def test_figures_not_drawn_again_do_not_stay(dataset, tmp_path):
    (tmp_path / "msd.txt").write_text("of the user")
    figures.render(dataset, tmp_path, ["msd"])
    figures.render(dataset, tmp_path, ["health"])
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"msd.txt", "health.png", "health.svg", "health.csv", "summary.csv"}


def test_a_disk_that_is_full_leaves_no_new_summary(dataset, tmp_path, monkeypatch):
    def full(path, _):
        if path.suffix == ".svg":
            raise storage.StorageError("full")
        path.touch()

    monkeypatch.setattr(storage, "write_file", full)
    with pytest.raises(storage.StorageError):
        figures.render(dataset, tmp_path, ["health"])
    assert not (tmp_path / "summary.csv").exists()


def test_figures_asked_for(dataset, tmp_path):
    names = {path.stem for path in figures.render(dataset, tmp_path, ["health", "msd"])}
    assert names == {"health", "msd", "summary"}
    with pytest.raises(figures.FigureError, match="particle_counts: there is nothing to show"):
        figures.render(dataset.sel(particles=[10]), tmp_path / "other", ["health", "particle_counts"])
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("figure", [msd, displacement_distribution])
def test_legends_cover_no_data(dataset, figure):
    with style.drawing():
        drawn = figure.draw([dataset.sel(scene=s, particles=20, engine="exact") for s in dataset.scene.values])
        drawn.canvas.draw()
    for axes in drawn.axes:
        for legend in filter(None, [axes.get_legend()]):
            box = legend.get_window_extent()
            assert not any(box.overlaps(other.get_window_extent()) for other in drawn.axes)
            assert box.x1 <= drawn.bbox.x1


def test_msd_table_is_the_dataset(dataset, folder):
    table = [row for row in rows(folder / "msd.csv") if row["scene"] == "hot"]
    case = dataset.sel(scene="hot", particles=20, engine="exact")
    for name in ("msd", "msd_low", "msd_high"):
        assert [float(row[name]) for row in table] == case[name].values.tolist()
    assert [float(row["ballistic"]) for row in table] == (8 * case.time**2).values.tolist()
    fit = [float(row["fit over [0.1, 1]"] or "nan") for row in table]
    assert np.isnan(fit[:2]).all()  # before its window
    fit = fit[2:]
    assert np.allclose(np.diff(fit) / 0.05, case.slope.values[0])


def test_distribution_table_counts_every_run(dataset, folder):
    table = [row for row in rows(folder / "displacement_distribution.csv") if row["scene"] == "hot"]
    assert len(table) == 25
    assert table[-1]["r_outer"] == "inf"
    assert sum(float(row["runs"]) for row in table) == 58
    assert sum(float(row["expected, msd"]) for row in table) == pytest.approx(58)


def test_particle_counts_table_names_the_window(dataset, folder):
    table = rows(folder / "particle_counts.csv")
    assert len(table) == 2 * 2 * 2
    for row in table:
        fit = dataset.sel(scene=row["scene"], particles=int(row["particles"]), engine="exact")
        fit = fit.isel(window=[0.1, 0.5].index(float(row["window_start"])))
        assert float(row["diffusion_coefficient"]) == fit.diffusion_coefficient.item()


def test_health_table_has_the_worst_run(dataset, folder):
    table = {(row["scene"], row["particles"], row["measure"]): row for row in rows(folder / "health.csv")}
    worst = abs(dataset.energy_drift.sel(scene="hot", particles=10, engine="exact")).max().item()
    assert float(table["hot", "10", "energy_drift"]["greatest"]) == worst
    assert table["hot", "10", "energy_drift"]["failed_runs"] == "2"


def test_summary(dataset):
    text = figures.summary(dataset)
    line = next(line for line in text.splitlines() if line.split()[:2] == ["hot", "20"])
    case = dataset.sel(scene="hot", particles=20, engine="exact")
    assert cases.plus_minus(case.msd[-1], case.msd_standard_error[-1]) in line
    assert cases.plus_minus(case.slope[0], case.slope_standard_error[0]) in line
    assert "MSD(1)" in text
    assert "D [0.1, 1]" in text
    assert "hot, N = 20: failed and left out: 2 of 60 seeds (7,33)" in text
    assert "missing" not in text


def test_summary_names_missing_seeds_and_engines(tmp_path):
    full, partial = make_runs(make_scene(), range(20)), make_runs(make_scene(), [*range(5), *range(9, 20)])
    coarse = partial._replace(engine="timestep", settings={"time_step": 0.01})
    text = figures.summary(aggregate([write(tmp_path, full), write(tmp_path, coarse)]))
    assert "plain, N = 20, timestep time_step=0.01: missing: 4 of 20 seeds (5-8)" in text
    assert "engine" in text.splitlines()[0]


def test_summary_table_has_a_row_per_window(dataset, folder):
    table = rows(folder / "summary.csv")
    assert len(table) == 8
    assert {(row["window_start"], row["window_end"]) for row in table} == {("0.1", "1"), ("0.5", "1")}


@pytest.mark.parametrize("runs", [1, 12])
def test_few_runs_draw_without_a_warning(runs, tmp_path):
    trajectories = make_runs(make_scene(duration=0.4), range(runs))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dataset = aggregate([write(tmp_path, trajectories)])
        assert len(figures.render(dataset, tmp_path)) == 10
    assert "plain" in figures.summary(dataset)


def test_disk_at_rest_and_no_disk(tmp_path):
    trajectories = make_runs(make_scene(), range(12))
    rest = trajectories.ensemble._replace(tracer=state.Track(0 * trajectories.ensemble.tracer.position))
    nothing = trajectories.ensemble._replace(tracer=None)
    for ensemble, files in ((rest, 10), (nothing, 4)):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            dataset = aggregate([write(tmp_path, trajectories._replace(ensemble=ensemble))])
            assert len(figures.render(dataset, tmp_path)) == files
        assert "plain" in figures.summary(dataset)


def test_numbers_are_written_to_their_error():
    assert cases.plus_minus(0.97364, 0.0249) == "0.974 ± 0.025"
    assert cases.plus_minus(123.4, 12.0) == "123 ± 12"
    assert cases.plus_minus(0.5, np.nan) == "0.5"
    assert cases.plus_minus(np.nan, np.nan) == "-"


def test_csv_gives_numbers_back():
    contents = to_csv(Table(("a", "b", "c"), [(0.1 + 0.2, np.float64("nan"), np.int64(3)), (1.0, np.inf, "x, y")]))
    assert contents == b'a,b,c\n0.30000000000000004,,3\n1,inf,"x, y"\n'
