"""The figures: complete, the same bytes each time, and with the dataset's numbers in them."""

import csv
import re
import warnings
from dataclasses import replace
from functools import partial
from itertools import combinations, product

import matplotlib
import numpy as np
import pytest
import xarray
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from PIL import Image

from brownpipe import provenance, theory
from brownpipe.analysis import aggregate, diffusive, goodness
from brownpipe.engines import engine_of_request
from brownpipe.errors import FigureError
from brownpipe.figures import (
    cases,
    displacement_distribution,
    pair_distribution,
    scan,
    style,
    thermodynamics,
    velocity_distribution,
)
from brownpipe.figures import msd as msd_figure
from brownpipe.figures.figure import Columns, figure_named
from brownpipe.figures.render import cases_shown, draw_into
from brownpipe.figures.render import draw as draw_figure
from brownpipe.figures.summary import FIT, SHAPE, TESTED, answer, summary, summary_table
from brownpipe.needs import (
    COMPARISON,
    COUNTED_COLLISIONS,
    DISPLACEMENTS,
    FIGURES,
    FOLLOWED_DISK,
    SPREADING,
)
from brownpipe.observables.trajectory import Track
from ensembles import make_runs, make_scene, study, write
from synthetic import CASE_DIMS, CONTACT, PAIRS, SPECIES, at_times, render, with_measures

# of an analysis; test_tradeoff.py has the other
NAMES = tuple(name for name, needs in FIGURES.items() if COMPARISON not in needs)
OF_ALL = {"summary.csv", "summary.txt", "provenance.json"}  # written beside the figures
RECORDS = {name: figure_named(name) for name in NAMES}
WITH_TRAJECTORIES = {FOLLOWED_DISK, COUNTED_COLLISIONS, DISPLACEMENTS, SPREADING}
OF_TRAJECTORIES = [name for name in NAMES if set(FIGURES[name]) <= WITH_TRAJECTORIES]


def needs_observable(name):
    """Whether the runs for a figure must have measured an observable."""
    return any(need.text.startswith("the observable ") for need in FIGURES[name])


OF_OBSERVABLES = {name: tuple(RECORDS[name].variables) for name in NAMES if needs_observable(name)}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """What trajectories alone give."""
    runs = study(tmp_path_factory.mktemp("study"), failed=(7, 33))
    return aggregate(runs, [(0.1, 1.0), (0.5, 1.0)])


@pytest.fixture(scope="module")
def dataset(plain):
    """The same with every other variable that a figure can show."""
    return with_measures(plain)


@pytest.fixture(scope="module")
def hot(dataset):
    """One of its two scenes: half the panels, for tests of the pictures' bytes."""
    return dataset.sel(scene=["hot"])


@pytest.fixture(scope="module")
def pictures(hot, tmp_path_factory):
    """The folder of two figures of one scene."""
    folder = tmp_path_factory.mktemp("pictures")
    render(hot, folder, ["energy", "health"])
    return folder


@pytest.fixture(scope="module")
def rendered(dataset, tmp_path_factory):
    """The folder of all tables, with empty pictures, and the figures by name, which have no layout
    yet.
    """
    folder = tmp_path_factory.mktemp("tables")
    figures = []

    def kept(figure, kind, _):
        figures.extend([figure] if kind == "png" else [])
        return b""

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("brownpipe.figures.render.image_bytes", kept)
        render(dataset, folder)
    assert len(figures) == len(NAMES), (
        "with_measures of synthetic.py must add the variables of every figure"
    )
    return folder, dict(zip(NAMES, figures, strict=True))


@pytest.fixture(scope="module")
def folder(rendered):
    return rendered[0]


def lay_out(figure):
    """Place all artists and run through drawing them, without a picture. Their boxes are known
    then.
    """
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()


@pytest.fixture
def run_through(monkeypatch):
    """Figures are drawn without a picture, and their files are empty: for tests of what drawing may
    complain of.

    They have no layout, whose own complaint, of panels without room, depends on words and not on
    the data.
    """
    figures = []

    def empty(figure, kind, _):
        if kind == "png":
            figure.set_layout_engine(None)
            lay_out(figure)
            figures.append(figure)
        return b""

    monkeypatch.setattr("brownpipe.figures.render.image_bytes", empty)
    return figures


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_every_figure_is_png_svg_and_csv_without_a_date(folder, pictures):
    expected = {f"{name}.{kind}" for name in NAMES for kind in ("png", "svg", "csv")} | OF_ALL
    assert {path.name for path in folder.iterdir()} == expected
    for name in ("energy", "health"):
        png, svg = ((pictures / f"{name}.{kind}").read_bytes() for kind in ("png", "svg"))
        assert (
            png.startswith(b"\x89PNG")
            and b"<svg" in svg
            and b"tIME" not in png
            and b"<dc:date>" not in svg
        )


@pytest.mark.slow
def test_same_picture_whatever_the_user_has_set_and_that_is_put_back(hot, pictures, tmp_path):
    """But for the metadata, which say what figures were asked for."""
    with matplotlib.rc_context(
        {"font.size": 30, "axes.grid": False, "svg.hashsalt": None, "savefig.dpi": 20}
    ):
        before = dict(matplotlib.rcParams)
        render(hot, tmp_path, ["health"])
        assert dict(matplotlib.rcParams) == before
    folders = (pictures, tmp_path)
    png = [folder / "health.png" for folder in folders]
    svg = [folder / "health.svg" for folder in folders]
    assert np.array_equal(*(np.asarray(Image.open(path)) for path in png))
    first, again = (re.sub(r"<dc:source>[^<]*<", "", path.read_text()) for path in svg)
    assert first == again


def test_every_figure_there_is_has_a_name_that_studies_may_use():
    """A module that draws cases but is not listed would never run; one that lacks a part or its
    caption would fail.
    """
    folder = provenance.PACKAGE / "figures"
    modules = {file.stem: file.read_text() for file in folder.glob("*.py")}
    drawing = {name for name, text in modules.items() if "\nFIGURE = Figure(" in text}
    assert drawing == set(FIGURES)
    assert {path.stem for path in folder.glob("*.rst")} >= drawing
    documents = (
        provenance.PACKAGE / "interface.py",
        provenance.PACKAGE.parents[1] / "config" / "README.md",
    )
    assert all(drawing <= set(re.findall(r"\w+", document.read_text())) for document in documents)


@pytest.mark.parametrize("name", OF_OBSERVABLES)
def test_figure_of_an_observable_that_was_not_asked_for(dataset, name, tmp_path):
    without = dataset.drop_vars(
        [var for var in dataset.data_vars if var.startswith(OF_OBSERVABLES[name])]
    )
    with pytest.raises(FigureError, match=f"^{name}: .*{FIGURES[name][0].text}"):
        render(without, tmp_path, [name])


def test_figures_and_particle_count_asked_for(plain, dataset, tmp_path):
    def shown(data, particles=None):
        of_one_count = cases.one_count(cases.cases_of(data), particles)
        return [(case.scene.item(), int(case.particles)) for case in of_one_count]

    assert [*cases_shown(dataset, names=["health", "msd"])] == ["health", "msd"]
    assert [*cases_shown(plain.sel(particles=[10]))] == OF_TRAJECTORIES
    with pytest.raises(FigureError, match=r"^scan: .*two particle counts"):
        render(dataset.sel(particles=[10]), tmp_path / "other", ["health", "scan"])
    assert not (tmp_path / "other").exists()
    with pytest.raises(
        FigureError, match=r"^ax: must not be given for health, "
    ):  # it has no main panel
        draw_into(matplotlib.figure.Figure().add_subplot(), dataset, "health")
    with pytest.raises(
        ValueError, match=r"particles: 15 is not in the dataset; choose one of \[10, 20\]"
    ):
        render(dataset, "never made", particles=15)
    assert shown(dataset) == [("hot", 20), ("thermal", 20)]
    assert shown(dataset, 10) == [
        ("hot", 10),
        ("thermal", 10),
    ]
    walled = dataset.assign(contact_density=dataset.contact_density.where(dataset.scene == "hot"))
    assert [one.scene for one in cases_shown(walled)["density_profile"]] == ["hot"]
    only = (dataset.scene == "hot") == (dataset.particles == 10)
    with_own = dataset.assign(
        runs=dataset.runs.where(only, 0), failed_runs=dataset.failed_runs.where(only, 0)
    )
    assert shown(with_own) == [("hot", 10), ("thermal", 20)]


def title(axes):
    """The title of a panel, which stands at its left; None if it has none."""
    said = axes.get_title("left")
    own = (artist for artist in axes.get_children() if said and isinstance(artist, Text))
    return next((text for text in own if text.get_text() == said), None)


def made(name, data):
    """The figure and its panels before their layout: nothing has a place on the page yet."""
    figure = draw_figure(data, name, panel=["scene"])
    return figure, panels_of(figure)


def panels_of(figure):
    return [axes for axes in figure.axes if axes.get_visible()]


@pytest.fixture(scope="module")
def as_it_is(rendered):
    """Figure and panels of the dataset as it is, by name, without a layout."""
    return {name: (figure, panels_of(figure)) for name, figure in rendered[1].items()}


def only_hot(dataset, *names):
    """The dataset without these variables in the other scenes."""
    return dataset.assign({name: dataset[name].where(dataset.scene == "hot") for name in names})


def test_green_kubo_needs_a_temperature(dataset):
    data = only_hot(dataset, "enskog_diffusion")
    shown = [{line.get_label() for line in axes.lines} for axes in made("diffusion", data)[1]]
    assert [any("Green" in label for label in labels) for labels in shown] == [True, False]


def test_what_the_legend_of_diffusion_names_is_in_the_panel_or_said_not_to_be(dataset):
    """Far beyond the curves of the MSD, the Green-Kubo integral and Enskog's D would leave these no
    room.
    """
    one = dataset.sel(scene=["hot"], particles=[20])
    top = max(float(one[name].max()) for name in ("msd_over_4t", "diffusion_running"))
    integral = one.green_kubo / one.green_kubo.max()
    for enskog, highest, shown in (
        (1.9, 1.5, 1.9),
        (1.5, 1.9, 1.9),
        (3.1, 1.5, 2.0),
        (1.5, 3.1, 2.0),
    ):
        data = one.assign(
            enskog_diffusion=0 * one.enskog_diffusion + enskog * top,
            green_kubo=highest * top * integral,
        )
        (panel,) = made("diffusion", data)[1]
        assert panel.get_ylim()[1] == pytest.approx(1.25 * shown * top)
        labels = [line.get_label() for line in panel.lines]
        assert any("Enskog" in label and "above the panel" in label for label in labels) == (
            enskog > 3
        )
        assert any("Green-Kubo" in label and "leaves the panel" in label for label in labels) == (
            highest > 3
        )


@pytest.mark.parametrize("correlated", [1, 30])
def test_residuals_of_velocities_that_follow_the_model_are_standard_normal(correlated):
    """Samples of a run repeat a velocity `correlated` times on average: whether a bin is shown must
    not depend on it.

    Of 100 data sets of 40 runs; the bounds are four standard errors of independent residuals. Each
    has at least five independent counts expected, so that its distribution is not far from normal.
    """
    rng = np.random.default_rng(1)
    name = "velocity_density"
    width = 0.1
    centres = np.arange(-5.95, 6, width)
    _, expected = velocity_distribution._expected(centres, name)
    shown = []
    for _ in range(100):
        times = rng.geometric(1 / correlated, (40, 3000 // correlated))
        velocities = rng.standard_normal(times.shape)
        bins = np.clip((velocities + 6) / width, 0, centres.size - 1).astype(int)
        counts = [
            np.bincount(*of_run, minlength=centres.size) for of_run in zip(bins, times, strict=True)
        ]
        density = np.array(counts) / np.sum(counts, axis=1, keepdims=True) / width
        error = density.std(axis=0, ddof=1) / np.sqrt(len(density))
        residuals = velocity_distribution._residuals(density.mean(axis=0), error, expected)
        shown += residuals[np.isfinite(residuals)].tolist()
    assert len(shown) > 3000
    assert abs(np.mean(shown)) < 4 / np.sqrt(len(shown))
    outside = np.mean(np.abs(shown) > 2)
    assert outside == pytest.approx(0.0455, abs=4 * np.sqrt(0.0455 / len(shown)))


def test_residuals_only_where_theory_expects_something(dataset):
    def panels(data):
        return len(made("thermodynamics", data)[0].axes)

    theory = [
        name for name in dataset.data_vars if name.startswith(("enskog", "compressibility_rate"))
    ]
    assert panels(dataset) == 6
    assert panels(dataset.drop_vars(theory)) == 3


def test_correlation_ends_where_its_band_reaches_zero(dataset, as_it_is):
    low = as_it_is["velocity_autocorrelation"][1][2]
    case = dataset.sel(scene="hot", particles=20, engine="exact")
    end = low.lines[0].get_xdata()[-1]
    least = case.velocity_autocorrelation_low
    assert (least.sel(time=slice(0, end)) > 0).all()
    assert least.values[case.time.values > end][0] <= 0


def test_a_correlation_resolved_at_a_single_time_is_said_not_to_be(hot):
    is_resolved = hot.time < 1.5 * hot.time[1]
    low = hot.velocity_autocorrelation_low.where(is_resolved, -1.0)
    tracer = hot.assign(velocity_autocorrelation_low=low).drop_vars("bath_velocity_autocorrelation")
    _, panels = made("velocity_autocorrelation", tracer)
    (remark,) = panels[1].texts
    assert remark.get_text() == "not resolved from 0"


def test_uncertain_bins_are_pooled_for_drawing_alone(dataset):
    """The number of pairs stays, and so does the chance of the interval: errors add in squares."""
    case = dataset.sel(scene="hot", particles=20, engine="exact", species_pair=PAIRS[1])
    case = case.isel(distance=case.distance.values > CONTACT[1])
    for relative, number in (
        (0.03, 3),
        (0.019, 1),
        (0.5, 4),
    ):  # 0.03/sqrt(3) < 0.02; at most a tenth of the smallest contact, which is 40 bins
        error = (relative * case.pair_distribution).rename()
        noisy = case.assign(pair_distribution_standard_error=error)
        assert pair_distribution._bins_pooled(noisy) == number
        pooled = pair_distribution._pooled(noisy, number)
        r = case.distance.values
        g = case.pair_distribution.values
        value = pooled.pair_distribution.values
        whole = number * value.size
        ring = r[:whole].reshape(-1, number).sum(axis=1)
        assert whole > r.size - number
        assert value @ ring == pytest.approx(g[:whole] @ r[:whole])
        if number > 1:
            down = value - pooled.pair_distribution_low.values
            up = pooled.pair_distribution_high.values - value
            single = 1.96 * error.values[:whole].reshape(-1, number).mean(axis=1)
            assert down == pytest.approx(up)
            assert up == pytest.approx(single / np.sqrt(number), rel=0.05)


def test_depletion_of_large_disks_among_small_ones_survives_pooling():
    """Ten diameters of small disks make one of the large ones: the well and the barrier, each some
    half a small diameter wide, are there however uncertain single bins are.
    """
    small = 0.3
    large = 3.0
    distance = (np.arange(800) + 0.5) * small / 40
    gap = (distance - large) / small
    g = np.select([gap < 0, gap < 0.5, gap < 1.1], [0.0, 3.1, 0.45], 1.0)
    mean = {
        "pair_distribution": ("distance", g),
        "pair_distribution_standard_error": ("distance", 0.7 * g),
        "contact_value": 3.2,
        "contact_value_standard_error": 0.9,
        "contact_value_low": 1.4,
        "contact_value_high": 5.0,
        "contact_distance": large,
        "runs": 40,
    }
    pair = xarray.Dataset(mean, {"distance": distance, "species_pair": "large:large"})
    pair = pair.assign_coords({"scene": "s", "particles": 9, "engine": "exact"})
    axes = style.grid(1, 1, 4, 3)[1]
    pair_distribution.draw_pair_distributions(axes[0, 0], [pair])
    (line,) = [line for line in axes[0, 0].lines if "bins of 0.03" in line.get_label()]
    r, drawn = line.get_data()
    in_well = (r > large) & (r < large + 0.45 * small)
    in_barrier = (r > large + 0.55 * small) & (r < large + 1.05 * small)
    assert in_well.sum() >= 4 and drawn[in_well] == pytest.approx(3.1)
    assert in_barrier.sum() >= 4 and drawn[in_barrier] == pytest.approx(0.45)


# -- what a reader sees ----------------------------------------------------------------------------


def words(figure):
    """Every text that is to be read, with its box [pixel]."""
    texts = []
    for axes in (axes for axes in figure.axes if axes.get_visible() and axes.axison):
        for axis in (axes.xaxis, axes.yaxis):
            place = axis.get_transform().transform
            low, high = sorted(place(axis.get_view_interval()))
            near = 1e-9 * (high - low)
            ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
            texts += [
                tick.label1 for tick in ticks if low - near <= place(tick.get_loc()) <= high + near
            ]  # others stay hidden
            texts.append(axis.label)
        texts += [*axes.texts, *([title(axes)] if title(axes) else [])]
        texts += axes.get_legend().get_texts() if axes.get_legend() else []
    texts = [text for text in texts if text.get_visible() and text.get_text().strip()]
    return [(text.get_text(), Text.get_window_extent(text)) for text in texts]


def leaves(box, whole):
    """Whether a box reaches beyond the figure's, which begins at 0."""
    return box.x0 < 0 or box.y0 < 0 or box.x1 > whole.x1 or box.y1 > whole.y1


def touching(figure):
    """Pairs of texts that cover each other, and texts that leave the figure."""
    texts = words(figure)
    pairs = [
        (text, earlier)
        for (earlier, before), (text, box) in combinations(texts, 2)
        if box.overlaps(before)
    ]
    cut = [text for text, box in texts if leaves(box, figure.bbox)]
    return pairs + cut


def covering(figure):
    """Titles, legends and names of axes that cover a panel, where data are."""
    above = [title(axes) for axes in figure.axes if title(axes)]
    above += [axes.get_legend() for axes in figure.axes if axes.get_legend()]
    above += [axes.xaxis.label for axes in figure.axes if axes.get_xlabel()]
    assert above
    panels = [axes.get_window_extent() for axes in panels_of(figure)]
    return [
        text for text, panel in product(above, panels) if text.get_window_extent().overlaps(panel)
    ]


def scenes(dataset, count):
    """The dataset with its two scenes over and over; every second name, as that of the last in a
    row, is long.
    """
    names = [f"scene-{k}" for k in range(count)]
    for k in range(1, count, 2):
        names[k] = f"a-scene_with.a-name-of-42-characters-at-N{k}0"
    repeated = dataset.isel(scene=[k % 2 for k in range(count)])
    return repeated.assign_coords(scene=names)


TIMES = {
    "few decades": np.linspace(0, 2.5e-4, 21),
    "large": np.linspace(0, 250000, 21),
    "many decades": [0, *np.geomspace(1e-7, 1e3, 20)],
    "within a decade": [0, *np.linspace(3.1e-5, 3.9e-5, 20)],
}


IN_TWO_ROWS = [(name, True) for name in ("msd", "diffusion", "velocity_autocorrelation", "energy")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "apart"), [*((name, False) for name in NAMES if name != "health"), *IN_TWO_ROWS]
)
def test_words_cover_no_data_and_no_words(dataset, name, apart, monkeypatch):
    """Of two scenes in one panel, and of three in panels of their own, in two rows; every second
    name is long.
    """
    monkeypatch.setattr(style, "MOST_COLUMNS", 2)
    data = scenes(dataset, 3 if apart else 2)
    data = at_times(data, (0.5, 1.0)) if name == "displacement_distribution" else data
    figure = draw_figure(data, name, panel=["scene"] if apart else [])
    with style.drawing():
        lay_out(figure)
    assert not touching(figure)
    assert not covering(figure)
    if apart:
        with_title = [axes for axes in panels_of(figure) if title(axes)]
        heights = [axes.get_position().height * figure.get_figheight() for axes in with_title]
        assert len(heights) == 3
        assert max(heights) - min(heights) < 0.3


COLUMN = 3.4  # width of a column of a journal, of which some have two [inch]


@pytest.mark.slow
@pytest.mark.parametrize("width", [COLUMN, 7.0])
@pytest.mark.parametrize("name", [name for name in NAMES if name != "health"])
def test_figures_fit_into_a_column_of_a_journal(dataset, name, width):
    """Of three scenes, whose names are long; in a figure that is high enough for all panels."""
    data = scenes(dataset, 3)
    with matplotlib.rc_context({"font.size": 8, "figure.figsize": (width, 30.0)}):
        rows = draw_figure(data, name).axes[0].get_subplotspec().get_gridspec().nrows
    with matplotlib.rc_context({"font.size": 8, "figure.figsize": (width, 2.8 * rows)}):
        figure = draw_figure(data, name)
        lay_out(figure)
    assert figure.get_figwidth() == width
    assert not touching(figure)
    assert not covering(figure)
    sizes = [text.get_fontsize() for axes in figure.axes for text in axes.findobj(Text)]
    assert min(sizes) >= 7
    places = [axes.get_position() for axes in panels_of(figure)]
    assert min(place.width for place in places) * width > 1.5
    assert min(place.height for place in places) * figure.get_figheight() > 0.5


@pytest.mark.slow
def test_boxes_of_health_checks_fit_onto_a_page(dataset):
    with matplotlib.rc_context({"font.size": 8, "figure.figsize": (7.0, 4.0)}):
        figure = draw_figure(scenes(dataset, 2), "health")
        lay_out(figure)
    assert not touching(figure)
    assert not covering(figure)


def test_settings_of_the_user_hold_in_python(hot):
    """Of the rest, titles and legends go with the size of her text, and files are brownpipe's."""

    def looks(figure):
        axes = figure.axes[0]
        texts = (axes.xaxis.label, axes.get_legend().get_texts()[0], title(axes))
        bath = next(line for line in axes.lines if line.get_label().startswith("bath"))
        sizes = [text.get_fontsize() for text in texts]
        return sizes, bath.get_linewidth(), [*figure.get_size_inches()]

    assert looks(draw_figure(hot, "energy")) == ([10, 8.8, 11], 1.8, [4.8, 4.4])
    own = {"font.size": 5.0, "lines.linewidth": 0.7, "figure.figsize": (3.4, 2.5)}
    with matplotlib.rc_context(own):
        sizes, width, inches = looks(draw_figure(hot, "energy"))
        assert sizes == pytest.approx([5, 4.4, 5.5])
        assert (width, inches) == (0.7, [3.4, 2.5])
    with matplotlib.rc_context(own | {"legend.fontsize": 7, "font.family": "serif"}):
        figure = draw_figure(hot, "energy")
        assert looks(figure)[0] == pytest.approx([5, 7, 5.5])
        assert title(figure.axes[0]).get_fontfamily() == ["serif"]


def test_a_legend_stays_in_the_figure_without_its_title(hot):
    figure, (axes,) = made("energy", hot)
    with_title = title(axes)
    axes.set_title("", loc="left")
    lay_out(figure)
    assert with_title.get_text() == ""
    assert not leaves(axes.get_legend().get_window_extent(), figure.bbox)
    assert not covering(figure)


def test_texts_are_broken_between_words_only_where_they_are_too_long():
    """Intervals, formulas and numbers with their errors are words; a name without spaces is broken
    within.
    """
    text = "hot: D over [0.1, 1] = 0.97 ± 0.02 °, as $D = \\frac{a}{b}$"
    assert style.broken_into_lines(text, 9.0, "legend.fontsize") == text
    at_words = style.broken_into_lines(text, 1.3, "legend.fontsize").split("\n")
    assert at_words == ["hot: D over", "[0.1, 1]", "= 0.97 ± 0.02 °,", "as $D = \\frac{a}{b}$"]
    name = "a-scene_with.a-name-of-42-characters-at-N1"
    parts = style.broken_into_lines(name, 1.0, "legend.fontsize").split("\n")
    assert "".join(parts) == name
    assert max(map(len, parts)) < len(name) / 2


@pytest.mark.parametrize("length", [20, 45])
def test_titles_stand_right_above_legends_broken_or_not(length):
    """Long lines of a legend are broken; at most a line is free above it."""
    with style.drawing():
        figure, axes = style.grid(1, 1, style.WIDTH, 6)
        for k in range(6):
            axes[0, 0].plot([0, 1], [0, k], label="m" * length)
        style.put_titles_and_legends(axes[0], ["title"])
        lay_out(figure)
    title = axes[0, 0].title.get_window_extent()
    legend = axes[0, 0].legend_.get_window_extent()
    gap = (title.y0 - legend.y1) * 72 / figure.dpi  # [point]
    assert 0 <= gap < 13.5


@pytest.mark.slow
@pytest.mark.parametrize("times", TIMES)
def test_tick_labels_stand_clear_of_each_other(hot, times):
    figure, _ = made("msd", hot.assign_coords(time=TIMES[times]))
    with style.drawing():
        lay_out(figure)
    assert not touching(figure)


def test_no_diffusion_is_claimed_of_a_tracer_that_still_flies(hot):
    """Where the first window, or every one, begins with an MSD of more than half the ballistic
    one.
    """

    def claimed(data):
        (case,) = cases_shown(data, names=["msd"])["msd"]
        msd, label = msd_figure._diffusion(case, case.time.values)
        assert (
            np.isfinite(msd).all()
            == bool(label)
            == msd_figure.table_of_msd([case]).diffusion.notna().all()
        )
        return label

    free = hot.drop_vars("accessible_half_width")
    flying = {"initial_square_speed": (hot.msd / hot.time**2).isel(time=10)}
    assert claimed(hot).startswith("diffusion between walls") and claimed(free).startswith(
        "free diffusion"
    )
    assert claimed(hot.assign(diffusion_mark=1 + 0 * hot.diffusion_mark)).endswith(" °")
    assert claimed(hot.assign(flying)) == claimed(free.assign(flying)) == ""
    walls = {
        "accessible_half_width": hot.accessible_half_width * 0 + 0.5
    }  # that have stopped it, says the MSD
    assert claimed(hot.assign(flying | walls)) == ""
    half_width = hot.accessible_half_width * 0 + 1.3
    late = hot.assign(accessible_half_width=half_width)  # D of the last MSD below 1.3^2/3
    beyond = np.flatnonzero(hot.msd.sel(particles=20) > 1.3**2 / 3)
    last = float(hot.time[beyond[0] - 1])
    assert claimed(late).startswith(f"diffusion between walls: D from MSD({last:.3g}) = ")


# -- several cases in a panel ----------------------------------------------------------------------

OVERLAID = (
    "msd",
    "diffusion",
    "first_passage",
    "velocity_autocorrelation",
    "pair_distribution",
    "energy",
    "density_profile",
)


def in_densities(dataset, count):
    """The dataset of one scene with so many values of a varied key."""
    one = dataset.sel(scene=["hot"], particles=[20]).assign_attrs(varied="tracer_mass")
    return one.expand_dims(tracer_mass=np.arange(1.0, count + 1), axis=1)


@pytest.mark.parametrize("name", OVERLAID)
def test_cases_share_a_panel_with_colours_and_words_that_tell_them_apart(dataset, name):
    of_species = {"energy": 2, "density_profile": 2, "pair_distribution": 2}.get(name, 1)
    data = in_densities(dataset, 3)
    panels = [axes for axes in draw_figure(data, name).axes if title(axes)]
    assert len(panels) == of_species
    first = data.isel(scene=0, tracer_mass=0, particles=0, engine=0)
    for k, axes in enumerate(panels):
        lines = [line for line in axes.lines if str(line.get_label()).startswith("tracer_mass = ")]
        contact = f"g(contact) = {estimate(first, 'contact_value', species_pair=k + 1)}"
        assert name != "pair_distribution" or contact in lines[0].get_label()
        assert [line.get_label()[:15] for line in lines] == [
            f"tracer_mass = {k}" for k in (1, 2, 3)
        ]
        assert len({tuple(line.get_color()) for line in lines}) == 3
        assert "hot, N = 20" in title(axes).get_text()
    shown = cases_shown(data, names=[name])[name]
    part = RECORDS[name].component
    variable = RECORDS[name].variables[0]
    apart = cases.panels_of(shown, ["tracer_mass"], part, variable)
    assert len(apart) == (6 if name == "pair_distribution" else 3)


def test_a_correlation_at_rest_has_no_initial_slope_and_cases_without_a_common_label_no_title(hot):
    axes = (figure := matplotlib.figure.Figure(layout="constrained")).add_subplot()
    axes.plot([1, 2], label="its legend")
    style.put_titles_and_legends([axes], [""])
    assert (
        style.image_bytes(figure, "png")
        and axes.get_legend().get_window_extent().y1 < figure.bbox.y1
    )
    draw_figure(
        hot.assign(velocity_autocorrelation=0 * hot.velocity_autocorrelation),
        "velocity_autocorrelation",
    )


def test_the_tail_of_theory_is_drawn_in_place_of_a_slope(dataset):
    case = dataset.sel(scene=["thermal"], particles=[20], engine=["exact"])
    curve = case.velocity_autocorrelation
    theory_of_tail = (0.1 / case.time).where(case.time > 0.5) + 0 * curve
    data = case.assign(vacf_tail=theory_of_tail)
    for of_case, label, other in (
        (data, "mode coupling, $a/t$ (lower panel)", "decay as $1/t$ (lower panel)"),
        (case, "decay as $1/t$ (lower panel)", "mode coupling, $a/t$ (lower panel)"),
    ):
        upper, lower = draw_figure(of_case, "velocity_autocorrelation").axes
        labels = [line.get_label() for line in upper.lines]
        assert label in labels and other not in labels
        if of_case is data:
            later = case.time.values[case.time.values > 0.5]
            drawn = [line for line in lower.lines if len(line.get_xdata()) == len(later)]
            first = float(curve.isel(time=0).squeeze())
            np.testing.assert_allclose(drawn[-1].get_xdata(), later)
            np.testing.assert_allclose(drawn[-1].get_ydata(), 0.1 / later / first)


def test_of_many_cases_some_are_drawn_unless_the_figure_is_that_of_a_scan(dataset):
    of_three = replace(RECORDS["msd"], most_cases=3)
    some, scan = (draw_figure(in_densities(dataset, 5), name) for name in (of_three, "scan"))
    drawn = [
        line.get_label()[:15] for line in some.axes[0].lines if "tracer_mass" in line.get_label()
    ]
    assert drawn == [f"tracer_mass = {k}" for k in (1, 3, 5)]
    assert (some.get_suptitle()[:12], scan.get_suptitle()) == ("3 of 5 cases", "")


def test_at_most_six_cases_share_a_panel(dataset):
    def groups(data, keys=()):
        return [len(group) for group in cases.panels_of(cases.cases_of(data), keys)]

    masses = in_densities(dataset, 4)
    both = masses.isel(scene=[0, 0]).assign_coords(scene=["hot", "b"])
    assert groups(masses) == [4] and groups(both) == [4, 4]
    assert groups(in_densities(dataset, 7)) == [1] * 7
    assert groups(both, ["tracer_mass"]) == [2] * 4
    assert groups(dataset) == [4] and groups(dataset, ["scene", "particles"]) == [1] * 4
    longer = dataset.assign(duration=dataset.duration.where(dataset.scene == "hot", 11.0))
    assert groups(longer) == [2, 2], "one time axis cannot show both"
    with pytest.raises(
        FigureError, match="panel: must be of scene, tracer_mass, particles, engine, not 'phi'"
    ):
        groups(masses, ["phi"])
    own = draw_figure(both, "own_observables")
    marks = [bar.lines[0] for bar in own.axes[-1].containers]
    looks = [(mark.get_color(), mark.get_marker()) for mark in marks]
    assert len({*looks}) == len(looks) == 8
    assert own.get_figheight() > 3.7 * len(own.axes)


@pytest.mark.parametrize("name", [*OVERLAID, "orientational_order"])
def test_the_main_panel_is_drawn_into_axes_of_ones_own(hot, name):
    with matplotlib.rc_context({"lines.linewidth": 7.0}):
        axes = matplotlib.figure.Figure().add_subplot()
        for k, label in enumerate(("first", "second")):
            assert draw_into(axes, hot, name, color=f"C{k}", label=label) is axes
    labels = axes.get_legend_handles_labels()[1]
    of_lines = [label for label in labels if label in ("first", "second")]
    assert of_lines[:: len(labels) // 2] == ["first", "second"]
    assert axes.get_xlabel() and axes.get_ylabel() and not axes.get_title()
    assert any(line.get_linewidth() == 7.0 for line in axes.lines), "in the style of the caller"


def test_looks_replace_those_of_points_by_their_long_or_short_names(hot):
    axes = matplotlib.figure.Figure().add_subplot()
    draw_into(axes, hot, "orientational_order", markersize=9, c="red", mfc="blue")
    (mark,) = (bar.lines[0] for bar in axes.containers)
    looks = (mark.get_markersize(), mark.get_color(), mark.get_markerfacecolor())
    assert looks == (9, "red", "blue")


def test_theory_is_beside_the_pair_distribution(hot):
    """The contact value of a tracer and its bath; the first order in the density where equal disks
    are dilute.
    """

    def legends(data):
        return [
            axes.get_legend_handles_labels()[1]
            for axes in draw_figure(data, "pair_distribution").axes
        ]

    each = 0 * hot.packing_fraction
    mixture = hot.assign(enskog_contact_value=each + 1.4, packing_fraction=each + 0.1)
    equal = mixture.assign(
        pair_distribution=mixture.pair_distribution.where(mixture.species_pair == PAIRS[2])
    )
    assert ["theory at contact: 1.4" in words for words in legends(mixture)] == [True, False]
    assert {"theory at contact: 1.4", "first order in the density"} <= {*legends(equal)[0]}
    assert "first order in the density" not in legends(equal.assign(packing_fraction=each + 0.3))[0]
    three = mixture.assign(pair_distribution=mixture.pair_distribution.fillna(0.0))
    assert not any("theory at contact" in line for words in legends(three) for line in words)


@pytest.mark.parametrize(
    ("key", "label"), [(None, "packing fraction $\\phi$"), ("tracer_mass", "tracer mass")]
)
def test_order_is_drawn_against_what_is_varied(dataset, key, label):
    drawn = dataset if key is None else in_densities(dataset, 3)
    (axes,) = draw_figure(drawn, "orientational_order").axes
    assert axes.get_xlabel() == label
    if key is not None:
        (bar,) = axes.containers
        assert bar.lines[0].get_xdata().tolist() == [1.0, 2.0, 3.0]


# -- what is drawn ---------------------------------------------------------------------------------


def points_of(bar):
    """The places and values of points, and both ends of their intervals."""
    ends = np.array(bar.lines[2][0].get_segments())[..., 1]
    return [bar.lines[0].get_xdata(), bar.lines[0].get_ydata(), *ends.T]


def values_of(case, name):
    return np.array([case[f"{name}{part}"] for part in ("", "_low", "_high")])


@pytest.mark.parametrize("name", ["scan", "thermodynamics"])
def test_points_are_the_values_with_their_intervals_beside_theory(dataset, as_it_is, name):
    """Theory: dashed lines of the scan, deviations in a second row, of the rate at the scene's
    temperature if known.
    """
    end = dataset.isel(time=-1, window=0, engine=0)
    panels = as_it_is[name][1]
    assert name != "scan" or title(panels[1]).get_text() == "diffusion coefficient over [0.1, 1] °"
    for k, variable in enumerate({"scan": scan, "thermodynamics": thermodynamics}[name].PANELS):
        dashed = [line.get_ydata() for line in panels[k].lines if line.get_linestyle() == "--"]
        expected = f"enskog_{'diffusion' if variable == 'diffusion_coefficient' else variable}"
        for j, case in enumerate(end.sel(scene=scene) for scene in ("hot", "thermal")):
            x = case["particles" if name == "scan" else "packing_fraction"]
            at = f"{variable}_at_temperature"
            drawn = points_of(panels[k].containers[j])
            assert np.allclose(drawn, [x, *values_of(case, variable)], rtol=1e-12)
            if name == "thermodynamics":
                compared = at if at in case else variable
                off = 100 * (values_of(case, compared) / case[expected].values - 1)
                drawn = points_of(panels[k + 3].containers[j])
                assert np.allclose(drawn, [x, *off], rtol=1e-9)
            elif expected in case:
                assert np.array_equal(dashed[j], case[expected])


def test_lines_are_those_of_the_dataset_and_their_legend_has_its_numbers(dataset, as_it_is):
    """Of the second scene, each line by words of its label; bands end where the intervals do."""
    case = dataset.sel(scene="thermal", particles=20, engine="exact").isel(
        displacement_time=0, r=slice(24)
    )
    of = {name: case[name].values for name in case.variables}
    said = partial(estimate, case)
    vacf = of["velocity_autocorrelation"]
    bath = of["bath_velocity_autocorrelation"]
    d = of["diffusion_coefficient"]
    gamma = -of["vacf_initial_slope_expected"] / vacf[0]
    line = of["intercept"][0] + of["slope"][0] * np.array([0.1, 1])
    counts = of["expected_counts"]
    models = of["model_diffusion_coefficient"]
    p = goodness.p_value_in_words(of["p_value_joint"][0])
    rate = abs(of["vacf_initial_slope"]) / vacf[0]
    rate_error = abs(of["vacf_initial_slope_standard_error"]) / vacf[0]
    decay = cases.plus_minus(rate, rate_error)
    walled = theory.reflecting_square_msd(np.linspace(0, 1, 201), d[1], 2.7)
    panels = {name: panels[1] for name, (_, panels) in as_it_is.items() if len(panels) > 1}
    for name, words, values in [
        ("msd", f"MSD(1) = {said('msd', time=-1)}", of["msd"]),
        ("msd", f"over [0.1, 1]: slope {said('slope', window=0)}", line),
        (
            "msd",
            f"between walls: D over [0.5, 1] = {said('diffusion_coefficient', window=1)}",
            walled,
        ),
        ("diffusion", "/d$t$ / 4", of["diffusion_running"][1:]),
        ("diffusion", "/ 4$t$", of["msd_over_4t"][1:]),
        ("diffusion", "Green-Kubo", of["green_kubo"][1:]),
        ("diffusion", f"D over [0.1, 1] = {said('diffusion_coefficient', window=0)}", [d[0]] * 2),
        ("diffusion", "Enskog's theory: D = 0.21", [0.21] * 2),
        ("velocity_autocorrelation", f"$\\gamma$ = {decay}", vacf / vacf[0]),
        ("velocity_autocorrelation", "bath", bath / bath[0]),
        (
            "velocity_autocorrelation",
            f"{gamma:.3g} from the collision rate",
            1 - np.linspace(0, 1, 200),
        ),
        (
            "energy",
            f"tracer: {said('species_energy', time=-1, species=0)} at",
            of["species_energy"][:, 0],
        ),
        (
            "energy",
            f"bath: {said('species_energy', time=-1, species=1)} at",
            of["species_energy"][:, 1],
        ),
        ("energy", "equipartition", [of["kinetic_temperature"]] * 2),
        (
            "density_profile",
            f"tracer: n(wall) = {said('contact_density', species=0)}",
            of["density_profile"][0],
        ),
        (
            "density_profile",
            f"bath: n(wall) = {said('contact_density', species=1)}",
            of["density_profile"][1],
        ),
        ("displacement_distribution", "58 runs", of["displacement_counts"]),
        ("displacement_distribution", f"MSD/4$t$ = {models[0]:.3g}: 0 beyond; {p}", counts[0]),
        ("displacement_distribution", f"slope/4 = {models[1]:.3g}", counts[1]),
    ]:
        (shown,) = [one.get_ydata() for one in panels[name].lines if words in one.get_label()]
        np.testing.assert_allclose(shown, values, rtol=1e-9, err_msg=f"{name}, {words}")
    for name, variable in (("msd", "msd"), ("diffusion", "diffusion_running")):
        edges = panels[name].collections[0].get_paths()[0].vertices[:, 1]
        assert edges.min() == np.nanmin(of[f"{variable}_low"])
        assert edges.max() == np.nanmax(of[f"{variable}_high"])
    errors = np.sqrt(np.maximum(counts[1] * (1 - counts[1] / 58), 1e-4))
    residuals = as_it_is["displacement_distribution"][1][3].lines[2].get_ydata()
    assert np.allclose(residuals, (of["displacement_counts"] - counts[1]) / errors, rtol=1e-9)
    from_wall = of["wall_distance"]
    bulk = of["density_profile"][1][from_wall > 0.75 * from_wall[-1]].mean()
    assert panels["density_profile"].lines[-1].get_ydata() == pytest.approx([bulk] * 2)
    legend = as_it_is["pair_distribution"][1][3].get_legend_handles_labels()[1]
    ways = {"by extrapolation": "contact_value", "from the collision rate": "contact_value_rate"}
    for words, name in ways.items():
        assert f"at contact, {words}: {said(name, species_pair=2)}" in legend
    assert len({*legend}) > len(ways)


# -- tables and the summary ------------------------------------------------------------------------


DATASET_TABLES = {
    name: record.table for name, record in RECORDS.items() if isinstance(record.table, Columns)
}


@pytest.mark.slow
@pytest.mark.parametrize("name", DATASET_TABLES)
def test_table_of_a_measure_is_the_dataset(dataset, folder, name):
    along = DATASET_TABLES[name].dims
    variables = DATASET_TABLES[name].variables
    table = rows(folder / f"{name}.csv")
    numbers = {"particles", *(dim for dim in along if dataset[dim].dtype.kind == "f")}
    some_rows = table[:: 1 + len(table) // 30]
    for variable in (variable for variable in variables if f"{variable}_low" in table[0]):
        names = [f"{variable}{suffix}" for suffix in cases.SUFFIXES]
        estimates = [name for name in names if name in dataset]  # some have an interval alone
        with_errors = dataset[estimates]
        for row in (row for row in some_rows if row[f"{variable}_low"]):
            at = {dim: row[dim] for dim in (*CASE_DIMS, *along)}
            at |= {dim: float(row[dim]) for dim in numbers}
            case = with_errors.sel(at)
            for column in estimates:
                assert float(row[column]) == case[column].item()
        expected = dataset[variable]
        if not RECORDS[name].every_count:
            expected = expected.sel(particles=20)
        assert sum(bool(row[variable]) for row in table) == np.isfinite(expected).sum()


@pytest.mark.slow
def test_other_tables_have_the_numbers_of_the_dataset(dataset, folder):
    case = dataset.sel(scene="hot", particles=20, engine="exact")

    def hot_rows(name):
        return [row for row in rows(folder / f"{name}.csv") if row["scene"] == "hot"]

    of_hot = {name: hot_rows(name) for name in NAMES}
    ballistic = [float(row["ballistic"]) for row in of_hot["msd"]]
    assert ballistic == (8 * case.time**2).values.tolist()
    fit = np.array([float(row["fit over [0.1, 1]"] or "nan") for row in of_hot["msd"]])
    assert np.isnan(fit[:2]).all()
    assert np.allclose(np.diff(fit[2:]) / 0.05, case.slope.values[0])
    rings = of_hot["displacement_distribution"]
    assert len(rings) == 25
    assert rings[-1]["r_outer"] == "inf"
    assert sum(float(row["runs"]) for row in rings) == 58
    for end in ("", "_low", "_high"):
        counts = case[f"displacement_counts{end}"].values.ravel()[:24]
        assert [float(row[f"runs{end}"]) for row in rings[:-1]] == counts.tolist()
    assert sum(float(row["expected, msd"]) for row in rings) == pytest.approx(58)
    for row in of_hot["scan"]:
        window = [0.1, 0.5].index(float(row["window_start"]))
        fitted = dataset.sel(scene="hot", particles=int(row["particles"]), engine="exact").isel(
            window=window
        )
        for name in ("diffusion_coefficient", "not_diffusive_before"):
            assert float(row[name]) == fitted[name].item()
        assert row["mark"] == diffusive.mark_in_words(fitted.diffusion_mark.item())
    drifts = [row for row in of_hot["health"] if row["measure"] == "energy_drift"]
    worst = next(row for row in drifts if row["particles"] == "20")
    for share, column in ((0.05, "5 %"), (0.95, "95 %"), (1.0, "greatest")):
        assert float(worst[column]) == abs(case.energy_drift).quantile(share).item()
        assert worst["failed_runs"] == "2"
    for of, mean_square in (("velocity", 1), ("speed", 2)):
        of_species = [
            row for row in of_hot["velocity_distribution"] if row["species"] == SPECIES[1]
        ]
        mine = [row for row in of_species if row["of"] == of]
        value = np.array([float(row["value"]) for row in mine])
        maxwell = np.array([float(row["maxwell"]) for row in mine])
        assert maxwell.sum() * 0.1 == pytest.approx(1, abs=1e-12)
        assert (maxwell * value**2).sum() * 0.1 == pytest.approx(
            mean_square, rel=2e-3
        )  # width^2/12 and the like
    assert (
        float(rows(folder / "summary.csv")[2]["contact_value, bath-bath"])
        == case.contact_value.values[2]
    )


def test_every_number_of_the_summary_table_is_that_of_the_dataset(dataset):
    """At the end and, of the displacements, at the last of two times."""
    twice = at_times(dataset, (0.5, 1.0))
    for name in (*SHAPE, *TESTED):
        twice[name] = twice[name] * twice.displacement_time
    table = summary_table(twice)
    end = twice.isel(displacement_time=-1, time=-1)
    assert len(table) == 8 and {*FIT, *SHAPE, "msd", "species_energy, bath", "p_value, msd"} <= {
        *table
    }
    for k, row in table.iterrows():
        case = end.sel(scene=row.scene, particles=row.particles, engine=row.engine).isel(
            window=k % 2
        )
        labels = ["scene", "particles", "engine", "drifts", "mark"]
        times = [column for column in table if column.endswith("_time")]
        for column in table.drop(columns=[*labels, *times]):
            name, _, label = column.removesuffix("_standard_error").partition(", ")
            value = case[name + "_standard_error" * column.endswith("_standard_error")]
            labelled = value.sel({value.dims[0]: label}) if label else value
            np.testing.assert_equal(row[column], labelled.item())


@pytest.mark.slow
def test_scenes_share_no_pair(dataset, tmp_path, run_through):
    """Pairs, species and times that one scene lacks leave gaps, not errors."""
    hot = dataset.scene == "hot"
    of_species = [name for name in dataset.data_vars if "species" in dataset[name].dims]
    gaps = {name: dataset[name].where(hot) for name in of_species}
    measured = hot | (dataset.time < 0.6)
    for name in ("msd", "msd_low", "msd_high"):
        gaps[name] = dataset[name].where(measured)
    pair = dataset.pair_distribution.where(dataset.species_pair != PAIRS[1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert render(
            dataset.assign(gaps | {"pair_distribution": pair}), tmp_path, list(OF_OBSERVABLES)
        )


def test_rows_of_every_table_name_their_case_with_its_varied_keys(dataset):
    shown = cases_shown(in_densities(dataset, 2))
    for name, of_name in shown.items():
        frame = RECORDS[name].table(of_name)
        assert [*frame.columns[:4]] == ["scene", "tracer_mass", "particles", "engine"]
        assert {*frame.tracer_mass} == {1.0, 2.0}
    assert {*shown} == {*NAMES}


def columns(dataset, *chosen):
    """The headings of the answer, and the cells of its last case."""
    return {heading: cells[-1] for heading, *cells in answer(dataset, chosen).columns}


def estimate(case, name, **at):
    return cases.plus_minus(*(case[f"{name}{part}"].isel(at) for part in ("", "_standard_error")))


def test_the_answer_begins_with_what_the_study_measured(dataset):
    found = columns(dataset)
    case = dataset.sel(scene="thermal", particles=20, engine="exact")
    energy = [f"energy, {name}" for name in SPECIES]
    contact = [f"g(contact), {name}" for name in PAIRS[1:]]
    of_walls = [f"n(wall), {name}" for name in SPECIES]
    names = ["scene", "N", "runs", *energy, "Z", *contact, "|psi_6|", *of_walls]
    names += ["first passage", "D (Green-Kubo)", "turned", "MSD(t = 1)", "D"]
    assert [*found] == names
    assert (
        found["Z"]
        == f"{estimate(case, 'compressibility')} ({float(case.enskog_compressibility):#.4g})"
    )
    assert found[energy[1]] == estimate(case.isel(time=-1, species=1), "species_energy")
    assert found[contact[1]] == estimate(case.isel(species_pair=2), "contact_value")
    assert found["MSD(t = 1)"] == estimate(case.isel(time=-1), "msd")
    assert found["D"].startswith(estimate(case.isel(window=0), "diffusion_coefficient"))
    assert max(map(len, summary(dataset).splitlines())) <= 120


def test_msd_and_d_are_in_the_answer_if_they_were_asked_for_and_an_observable_of_ones_own(
    plain, dataset
):
    """By an option of the analysis or a figure; and beside all else that was measured if nothing is
    asked for.
    """
    by_default = dataset.assign_attrs(options="{}").drop_vars(
        [
            name
            for name in dataset.data_vars
            if name.startswith(("diffusion_running", "species_energy"))
        ]
    )
    assert "D" not in columns(by_default) and "Z" in columns(by_default)
    assert "D" in columns(by_default, "msd") and "D" in columns(
        by_default.assign_attrs(options=plain.options)
    )
    assert [*columns(plain.assign_attrs(options="{}"))][3:] == ["collision rate", "MSD(t = 1)", "D"]
    assert [*columns(plain.assign_attrs(options="{}"), "thermodynamics", "health")][3:] == [
        "collision rate"
    ]
    meaning = {"observable": "my_module:chirality", "long_name": "chirality of the fluid"}
    one = (0 * plain.duration + 0.25).assign_attrs(meaning)
    found = plain.assign(chirality=one, chirality_standard_error=0.01 * one / 0.25)
    assert [*columns(found)][3:] == ["chirality", "MSD(t = 1)", "D"]
    assert columns(found)["chirality"] == "0.250 ± 0.010"
    assert "chirality: chirality of the fluid (my_module:chirality)." in summary(found)


def test_the_verdict_on_eq_18_is_given_where_rings_were_asked_for(tmp_path):
    """Of two scenes, normal displacements in one and displacements of nearly one length in the
    other.
    """
    normal = make_runs(make_scene("normal"), range(400))
    ring = make_runs(make_scene("ring"), range(400))
    on_circles = np.exp(1j * np.arange(400.0)) * np.linspace(0.9, 1.1, 400)
    direction = on_circles.view(float).reshape(400, 2)
    radius = np.sqrt(4 * ring.ensemble.times[5:])
    ring.ensemble.tracer.position[5:] = radius[:, None, None] * direction
    files = [write(tmp_path, normal), write(tmp_path, ring)]
    assert "rejected" not in summary(aggregate(files))
    twice = aggregate(files, displacement_times=[0.2, 1.0])  # the last one counts
    text = summary(twice, title="Rings and walks")
    lines = text.splitlines()
    first = [line for line in lines if line.startswith("normal")][-1]
    second = [line for line in lines if line.startswith("ring")][-1]
    assert re.search(r"  not rejected, p = [0-9.]+ +not rejected, p = [0-9.]+$", first)
    assert second.endswith("  rejected, p < 1e-06     rejected, p < 1e-06")
    head = text.splitlines()
    assert head[0] == "Rings and walks" and head[1].endswith(
        "eq. (18), D = MSD/4t    eq. (18), fitted D"
    )
    assert "Eq. (18): x and y at t = 1 are normal, of variance 2Dt;" in text
    assert "rejected at a family-wise level of 5% for the 4 tests of this table (Holm)." in text
    assert max(map(len, head)) <= 100
    p = (
        twice.p_value_joint.copy()
    )  # of both models in turn: 0.02 is no rejection in a family of four
    p[..., 1, :2] = np.reshape([[0.02, 1e-9], [0.5, 0.3]], p[..., 1, :2].shape)
    found = [cells[1:] for cells in answer(twice.assign(p_value_joint=p)).columns[-2:]]
    assert found[0] == ("not rejected, p = 0.020", "not rejected, p = 0.50")
    assert found[1] == ("rejected, p < 1e-06", "not rejected, p = 0.30")


def test_summary_names_missing_seeds_and_engines(tmp_path):
    full = make_runs(make_scene(), range(20))
    partial = make_runs(make_scene(), [*range(5), *range(9, 20)])
    coarse = partial._replace(
        engine=engine_of_request("timestep", {"time_step": 0.01, "collisions": "late"})
    )
    text = summary(aggregate([write(tmp_path, full), write(tmp_path, coarse)]))
    assert "plain, N = 20, timestep-0.01-collisions=late: missing: 4 of 20 seeds (5-8)" in text
    assert "engine" in text.splitlines()[0]
    fewer = full._replace(ensemble=make_runs(make_scene(), range(12)).ensemble)
    dataset = aggregate([write(tmp_path, fewer), write(tmp_path, coarse)])
    assert "missing: 4 of 20" in summary(dataset)
    assert "missing: 8" not in summary(dataset), "an engine may have fewer seeds than another"


@pytest.mark.slow
def test_one_run_a_disk_at_rest_and_no_disk_are_drawn_without_a_warning(tmp_path, run_through):
    made = make_runs(make_scene(), range(12))
    rest = made._replace(
        ensemble=made.ensemble._replace(tracer=Track(0 * made.ensemble.tracer.position))
    )
    nothing = made._replace(ensemble=made.ensemble._replace(tracer=None))
    one_run = make_runs(make_scene(), [0])
    cases_drawn = ((nothing, 2), (rest, len(OF_TRAJECTORIES)), (one_run, len(OF_TRAJECTORIES)))
    for runs, shown in cases_drawn:
        run_through.clear()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            dataset = aggregate([write(tmp_path, runs)])
            assert len(render(dataset, tmp_path)) == len(OF_ALL) + 3 * shown
        assert "plain" in summary(dataset)
    legends = [axes.get_legend() for figure in run_through for axes in figure.axes]
    assert not any(
        "nan" in text.get_text() for legend in legends if legend for text in legend.get_texts()
    )


def test_numbers_are_written_to_their_error():
    assert cases.plus_minus(0.97364, 0.0249) == "0.974 ± 0.025"
    assert cases.plus_minus(123.4, 12.0) == "123 ± 12"
    assert cases.plus_minus(0.5, np.nan) == "0.5"
    assert cases.plus_minus(np.nan, np.nan) == "-"


@pytest.mark.slow
def test_distributions_in_rings_of_different_widths_keep_their_own_axes(tmp_path):
    """Scenes of very different sizes, in rings from the data; and walls that leave rings without
    runs.
    """
    paths = []
    for name, size in (("large", 1.0), ("small", 0.1), ("wide", 8.0)):
        trajectories = make_runs(make_scene(name, boundary="periodic"), range(40))
        trajectories.ensemble.tracer.position[...] *= size
        paths.append(write(tmp_path, trajectories))
    shown = cases.cases_of(aggregate(paths, displacement_times=(0.2, 1.0)))
    figure = displacement_distribution.draw_distributions(shown)
    mains = figure.axes[:4] + figure.axes[8:10]
    lows = figure.axes[4:8] + figure.axes[10:]  # of the two rows
    for main, low, one in zip(mains, lows, cases.distributions_of(shown), strict=True):
        edge = one.r_outer.values[-1]
        assert 0.9 * edge < main.get_xlim()[1] < 1.5 * edge
        assert main.get_xlim() == low.get_xlim()
        assert any(
            f"beyond $r$ = {edge:g}" in words for words in main.get_legend_handles_labels()[1]
        )
    saturated = make_runs(make_scene("saturated"), range(100), diffusion=4.0)
    assert displacement_distribution.draw_distributions(
        cases.cases_of(aggregate([write(tmp_path, saturated)]))
    )


def test_the_summary_of_averages_has_no_distribution():
    """Averages over time origins or disks have an MSD and no displacement of single runs."""
    scene = make_scene("averaged", boundary="periodic")
    runs = make_runs(scene, range(20))
    squared = np.arange(20.0)[:, None] * scene.times
    measured = runs.ensemble.observables | {"square_displacement": squared}
    ensemble = runs.ensemble._replace(tracer=None, observables=measured, average="disks")
    averages = aggregate([runs._replace(ensemble=ensemble)])
    text = summary(averages).splitlines()
    assert text[0].split() == ["scene", "N", "runs", "collision", "rate", "MSD(t", "=", "1)", "D"]
    assert np.isnan(averages.displacement_counts).all() and not any(
        "rejected" in line for line in text
    )


def test_curves_on_a_logarithmic_axis_begin_at_their_first_time():
    """Not at the edge of the panel, at the height of the first sample after t = 0."""
    figure = matplotlib.figure.Figure()
    axes = figure.add_subplot()
    axes.plot([0, 1, 10], [1.0, 0.2, 0.1])
    style.log_axis(axes, "x", 0.01, 10)
    start, first, _ = axes.lines[0].get_transform().transform(axes.lines[0].get_xydata())
    assert not np.isfinite(start[0]) and np.isfinite(first).all()
    axes.plot([1, 10], [1.0, -0.2])
    style.log_axis(axes, "y", 0.01, 10)
    assert np.isfinite(axes.transData.transform((10, -0.2))).all()
