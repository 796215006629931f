"""Figures of a user's own: passed to `plot` as objects, drawn like those of brownpipe."""

import re
from pathlib import Path

import matplotlib.figure
import numpy as np
import pytest

import brownpipe as bp
from brownpipe.analysis import aggregate
from brownpipe.errors import FigureError
from ensembles import make_runs, make_scene

GUIDE = Path(__file__).parents[1] / "docs" / "guide.md"
SECTION = GUIDE.read_text().partition("A figure of your own")[2]
EXAMPLE = re.search(r"```python\n(.*?)```", SECTION, re.DOTALL)[1]


@pytest.fixture(scope="module")
def growth():
    """The figure of the guide's example."""
    names = {}
    exec(EXAMPLE, names)  # as importing my_figure.py does
    return names["GROWTH"]


@pytest.fixture(scope="module")
def result():
    """An analysis of two particle counts."""
    runs = [make_runs(make_scene(particles=number), range(20)) for number in (10, 20)]
    return aggregate(runs)


def test_the_example_of_the_guide_draws_the_largest_count_or_the_one_asked_for(growth, result):
    (axes,) = bp.plot(result, growth).axes
    (line,) = axes.lines
    case = result.sel(particles=20).isel(scene=0, engine=0)
    later = case.isel(time=slice(1, None))
    assert np.array_equal(line.get_xdata(), later.time)
    assert np.array_equal(line.get_ydata(), later.msd / later.time)
    assert axes.get_ylabel() == "MSD / t"
    (smaller,) = bp.plot(result, growth, particles=10).axes
    assert smaller.lines[0].get_label() == "N = 10"


def test_a_figure_draws_into_axes_with_looks(growth, result):
    axes = matplotlib.figure.Figure().add_subplot()
    assert bp.plot(result, growth, ax=axes, color="red", label="mine") is axes
    (line,) = axes.lines
    assert (line.get_color(), line.get_label()) == ("red", "mine")


def test_a_figure_of_all_cases_may_draw_the_whole_picture(result):
    def draw(cases):
        picture = matplotlib.figure.Figure(layout="constrained")
        counts = [int(case.particles) for case in cases]
        picture.add_subplot().plot(counts, [float(case.msd[-1]) for case in cases])
        return picture

    picture = bp.plot(result, bp.Figure(draw=draw, variables=["msd"], every_count=True))
    assert picture.axes[0].lines[0].get_xdata().tolist() == [10, 20]


def draw_nothing(axes, cases, **looks):
    pass


@pytest.mark.parametrize(("keys", "message"), [
    ({}, "curves: must be given, or draw in its place; not both"),
    ({"curves": draw_nothing}, "labels: must be one or two, of the rows of panels"),
    ({"curves": draw_nothing, "labels": "MSD"}, "labels: must be a list of texts, not one"),
    ({"curves": draw_nothing, "labels": ["a", "b"]}, "below: must go with a second one of labels"),
    ({"curves": draw_nothing, "labels": ["a"], "component": "colour"}, "component: must be "),
])  # fmt: skip
def test_a_figure_that_cannot_be_drawn_is_refused_when_it_is_made(keys, message):
    with pytest.raises(FigureError, match=f"^{re.escape(message)}"):
        bp.Figure(**keys)


def test_a_figure_of_variables_that_the_analysis_lacks_names_them(result):
    figure = bp.Figure(curves=draw_nothing, labels=["a"], variables=["msd", "temper"])
    with pytest.raises(FigureError, match=r"^figure: needs temper, which this dataset does not"):
        bp.plot(result, figure)
