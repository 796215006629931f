"""The style of all figures: colours, panels, axes and legends. matplotlib is imported in functions,
as it takes long.

Its settings are in `style.mplstyle`; neither the user's settings nor the date affect what
`brownpipe figures` writes. In Python the user's settings go before those of the style.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Unpack

import numpy as np

from brownpipe.figures.cases import differing, drift_remark, labels_in_words
from brownpipe.figures.looks import NO_LOOKS, Looks, replaced

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties
    from matplotlib.typing import ColorType, LineStyleType
    from xarray import Dataset

SharedAxis = bool | Literal["none", "all", "row", "col"]  # as for `Figure.subplots`
# Colours by meaning: measured data, fits, models, reference lines, text and theory
DATA = "#0072B2"
FIT = "#D55E00"
MODEL = "#009E73"
GREY = "#6B6B6B"
INK = "#222222"
DASHED = (0, (5, 2.5))
DOTTED = (0, (1, 1.2))
# Colour, line and marker of the first, second, ... species, fit window or scene
SERIES: Sequence[tuple[str, LineStyleType, str]] = (
    (DATA, "-", "o"),
    (FIT, DASHED, "s"),
    (MODEL, (0, (4, 1.5, 1, 1.5)), "^"),
    ("#8A4F7D", DOTTED, "D"),
    ("#E69F00", (0, (9, 2)), "v"),
    ("#56B4E9", (0, (3, 1, 1, 1, 1, 1)), "P"),
)
# Of the points or curves of the first, second, ... series: every pair of colour and marker, or of
# colour and line
MARKS: list[Looks] = [
    {"color": SERIES[k % 6][0], "marker": SERIES[(k + k // 6) % 6][2]} for k in range(36)
]
LINES = [SERIES[(k + k // 6) % 6][1] for k in range(36)]
STYLE = Path(__file__).with_name("style.mplstyle")
# Matplotlib's settings of sizes of text; here those of titles and legends scale with font.size
Setting = Literal["axes.titlesize", "axes.labelsize", "legend.fontsize"]
TITLE_SIZE: Setting = "axes.titlesize"
LEGEND_SIZE: Setting = "legend.fontsize"
WIDTH = 4.8  # of the panel of a case [inch]
MOST_COLUMNS = 4  # panels side by side; further panels begin a new row
NARROWEST = 3.0  # width of a panel, with its labels, in a figure of the user's size [inch]
# Leading digits labelled on a logarithmic axis, by the decades below which they apply; (): labels
# of a linear axis
LABELLED = {0.4: (), 0.7: (1, 1.5, 2, 3, 5, 7), 1: (1, 2, 5), 2: (1, 3), np.inf: (1,)}
LINE_HEIGHT = 13.5 / 8.8  # of an entry of a legend, in sizes of its words
FURTHER_LINE = 1.3  # height of a further line of an entry, likewise
LABEL_WIDTH = 7.2  # width of the labels beside a panel, in sizes of all text
KEY_WIDTH = 2.8  # width of the key beside the words of a legend, in sizes of these
# Of a text that is broken into lines: a formula, an interval and a number with its error are words
WORD = re.compile(r"(?:\$[^$]*\$|\[[^\]]*\]|(?<=[±=]) | (?=[±°])|(?<!\]) (?==)|[^ $])+")


def drawing() -> AbstractContextManager[None]:
    """Return the context in which figures are drawn and saved: matplotlib's defaults and
    `style.mplstyle`.

    The settings of the user have no effect in it, and are restored after it.
    """
    from matplotlib import style

    return style.context(["default", STYLE])


def drawing_for_user() -> AbstractContextManager[None]:
    """Return the context in which figures are drawn for a user of Python: with the user's settings,
    but with those of `style.mplstyle` in place of each that equals matplotlib's default.
    """
    from matplotlib import rc_context, rc_params_from_file, rcParams, rcParamsDefault

    text_scale = rcParams["font.size"] / rcParamsDefault["font.size"]
    settings = {}
    for name, value in rc_params_from_file(STYLE, use_default_template=False).items():
        if rcParams[name] == rcParamsDefault[name]:
            settings[name] = value * text_scale if name in (TITLE_SIZE, LEGEND_SIZE) else value
    return rc_context(settings)


def image_bytes(figure: Figure, suffix: str, metadata: Mapping[str, str] | None = None) -> bytes:
    """Return the bytes of a PNG or SVG file with these metadata, without date. The first call
    computes the layout.
    """
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine(None)  # with an engine, `savefig` would draw the figure twice
    buffer = io.BytesIO()
    figure.savefig(buffer, format=suffix, metadata={"Date": None, **(metadata or {})})
    return buffer.getvalue()


def grid(
    rows: int,
    columns: int,
    width: float,
    height: float,
    *,
    sharex: SharedAxis = False,
    sharey: SharedAxis = False,
    height_ratios: Sequence[float] | None = None,
) -> tuple[Figure, np.ndarray]:
    """Return a figure of panels and its axes (rows, columns).

    `width` and `height` [inch] are those of a panel, on average over the rows, unless the user has
    set the size of a figure; the other arguments are those of `Figure.subplots`.
    """
    from matplotlib.figure import Figure

    size = _figure_size_of_user() or (width * columns, height * rows)
    figure = Figure(size, layout="constrained")
    axes = figure.subplots(
        rows, columns, sharex=sharex, sharey=sharey, squeeze=False, height_ratios=height_ratios
    )
    return figure, axes


def _figure_size_of_user() -> tuple[float, float] | None:
    """Return width and height of a figure [inch] as the user has set them; None as by default."""
    from matplotlib import rcParams, rcParamsDefault

    width, height = rcParams["figure.figsize"]
    is_default = [width, height] == [*rcParamsDefault["figure.figsize"]]
    return None if is_default else (width, height)


def columns_that_fit(count: int, most: int) -> int:
    """Return how many of `count` panels are side by side: `most` at most, and in a figure of the
    user's size as many as are NARROWEST wide or wider.
    """
    size = _figure_size_of_user()
    fitting = int(size[0] / NARROWEST) if size else most
    return min(count, most, max(fitting, 1))


def stacked_panels(
    labels: Sequence[str], count: int, heights: Sequence[float], sharey: bool
) -> tuple[Figure, np.ndarray]:
    """Return a figure of `count` stacks of panels, at most MOST_COLUMNS side by side, and its axes
    (panels, count).

    `labels` name the vertical axes of a stack's panels, `heights` [inch] are those of the panels.
    With `sharey` the panels at the same place of all stacks share their vertical axis, and only the
    leftmost of a row shows its numbers.
    """
    wide = columns_that_fit(count, MOST_COLUMNS)
    rows = -(-count // wide)
    panels = len(heights)
    mean_height = sum(heights) / panels
    ratios = tuple(heights) * rows
    figure, axes = grid(panels * rows, wide, WIDTH, mean_height, height_ratios=ratios)
    stacks = axes.reshape(rows, panels, wide).swapaxes(0, 1).reshape(panels, rows * wide)
    for panel in stacks[:, count:].flat:
        panel.remove()
    for label, row in zip(labels, stacks[:, :count], strict=True):
        for k, panel in enumerate(row):
            panel.set_ylabel("" if k % wide else label)
            if sharey and k > 0:
                panel.sharey(row[0])
                panel.tick_params(labelleft=k % wide == 0)
    return figure, stacks[:, :count]


def put_titles_and_legends(panels: Sequence[Axes] | np.ndarray, titles: Iterable[str]) -> None:
    """Put titles and legends above panels, where they cover no data; all titles at the height of
    the longest legend. Those that are wider than a panel are broken into lines.
    """
    width = panel_width(panels[0])
    size = _font(LEGEND_SIZE).get_size_in_points()
    label_width = width - KEY_WIDTH * size / 72
    legends = []
    heights = []
    for axes in panels:
        handles, names = axes.get_legend_handles_labels()
        labels = [broken_into_lines(name, label_width, LEGEND_SIZE) for name in names]
        further = sum(label.count("\n") for label in labels)
        legends.append((handles, labels))
        heights.append(size * (LINE_HEIGHT * len(labels) + FURTHER_LINE * further))
    pad = 9 + max(heights)  # [point]
    for axes, title, (handles, labels) in zip(panels, titles, legends, strict=True):
        lines = broken_into_lines(title, width, TITLE_SIZE)
        axes.set_title(lines or " ", pad=pad)  # "" makes no room
        if labels:
            axes.legend(
                handles,
                labels,
                loc="lower left",
                bbox_to_anchor=(-0.02, 1.0),
                borderaxespad=0.2,
                labelspacing=0.35,
            )


def text_size() -> float:
    """Return the size of all text that has none of its own [point]."""
    from matplotlib import rcParams

    return float(rcParams["font.size"])


def panel_width(axes: Axes) -> float:
    """Return the width of a panel, one of equal ones side by side, without its labels [inch]."""
    place = axes.get_subplotspec()
    columns = place.get_gridspec().ncols if place else 1
    figure_width = axes.figure.bbox.width / axes.figure.dpi
    return figure_width / columns - LABEL_WIDTH * text_size() / 72


def broken_into_lines(text: str, width: float, setting: Setting) -> str:
    """Return a text in lines of at most a width [inch] where that is possible, broken between
    words, and a longer word within; `setting` is that of matplotlib for the size of the text.
    """
    font = _font(setting)
    if _width(text, font) <= width:
        return text
    lines = [""]
    for word in WORD.findall(text):
        for part in _parts_of_word(word, width, font):
            line = f"{lines[-1]} {part}".lstrip()
            if lines[-1] and _width(line, font) > width:
                lines.append(part)
            else:
                lines[-1] = line
    return "\n".join(lines)


def _parts_of_word(word: str, width: float, font: FontProperties) -> list[str]:
    """Return the parts of a word that fit into a width [inch]; a formula is whole."""
    share = width / _width(word, font)
    if share >= 1 or "$" in word:
        return [word]
    return textwrap.wrap(word, max(int(share * len(word)), 1))


def _font(setting: Setting) -> FontProperties:
    """Return the font of a text by matplotlib's setting for its size."""
    from matplotlib import rcParams
    from matplotlib.font_manager import FontProperties

    weight = rcParams["axes.titleweight"] if setting == TITLE_SIZE else "normal"
    return FontProperties(size=rcParams[setting], weight=weight)


def _width(text: str, font: FontProperties) -> float:
    """Return the width of a text in a font [inch]."""
    from matplotlib.textpath import text_to_path

    width, _, _ = text_to_path.get_text_width_height_descent(text, font, "$" in text)
    return width / 72


def say_shown(figure: Figure, shown: int, number: int) -> None:
    """Write above a figure how many of its cases it shows."""
    text = f"{shown} of {number} cases, at equal steps; the table has all"
    figure.suptitle(text, x=0.01, ha="left")


def styled_cases(
    cases: list[Dataset],
    number: Callable[[Dataset], str] = lambda case: "",
    looks: Looks = NO_LOOKS,
) -> Iterator[tuple[Dataset, Looks]]:
    """Yield the cases, or parts of cases, of one panel, each with the looks of its line, as for
    `axes.plot`.

    The label says what distinguishes it from the others, and adds its `number`. Colours are ordered
    if only one number differs. `looks` replaces any of these.
    """
    names = differing(cases)
    ordered = len(names) == 1 and cases[0][names[0]].dtype.kind in "iuf"
    colours = shades(len(cases)) if ordered else [colour for colour, _, _ in SERIES]
    for case, colour, line in zip(cases, cycle(colours), cycle(LINES), strict=False):
        words = filter(None, (labels_in_words(case, names), number(case)))
        label = ": ".join(words) + drift_remark(case)
        own: Looks = {"color": colour, "linestyle": "-" if ordered else line, "label": label}
        yield case, replaced(own, looks)


def band(axes: Axes, case: Dataset, name: str, **line: Unpack[Looks]) -> None:
    """Draw a variable over its one dimension, with its 95 % band in the same colour if it has
    one.
    """
    x = case[case[name].dims[0]].values
    if f"{name}_low" in case:
        low = case[f"{name}_low"]
        high = case[f"{name}_high"]
        axes.fill_between(x, low, high, color=line["color"], alpha=0.22, linewidth=0)
    axes.plot(x, case[name], **line)


def points(
    axes: Axes, x: Sequence[float], cases: Sequence[Dataset], name: str, **looks: Unpack[Looks]
) -> None:
    """Draw a variable of each case at its x, with its 95 % interval; hollow, so that equal points
    show each other.
    """
    value = [float(case[name]) for case in cases]
    low = [float(case[f"{name}_low"]) for case in cases]
    high = [float(case[f"{name}_high"]) for case in cases]
    reach = np.abs(np.subtract([low, high], value))
    hollow: Looks = {"linestyle": "none", "markersize": 5, "markerfacecolor": "none"}
    axes.errorbar(x, value, reach, elinewidth=1.3, **replaced(hollow, looks))


def highest(cases: Sequence[Dataset], name: str) -> float:
    """Return the upper end of the 95 % bands of a variable, or of the variable where it has
    none.
    """
    return max(float(case[f"{name}_high"].fillna(case[name]).max()) for case in cases)


def residual_panel(axes: Axes) -> None:
    """Prepare a panel for residuals in standard errors: a line at zero, and a grey band from -2 to
    2.
    """
    axes.axhspan(-2, 2, color="#EFEFEF", linewidth=0)
    axes.axhline(0, color=GREY, linewidth=0.8)
    axes.locator_params(axis="y", nbins=5, steps=[1, 2, 5, 10], integer=True)


def shades(count: int) -> list[ColorType]:
    """Return colours from dark to light, whose order shows to the colour-blind and in greyscale,
    too.
    """
    import matplotlib

    return list(matplotlib.colormaps["viridis"](np.linspace(0.02, 0.7, count)))


def time_axis(axes: Axes, cases: Sequence[Dataset]) -> None:
    """Label the time axis and set its limits; longer curves that are there stay in the panel.

    It is logarithmic if the samples after t = 0 of a case are not equally spaced.
    """
    later = [case.time.values[case.time.values > 0] for case in cases]
    end = max(axes.dataLim.x1, *(times[-1] for times in later))
    steps = [np.diff(times) for times in later if len(times) > 2]
    if any(step.max() > 10 * step[:-1].min() for step in steps):
        log_axis(axes, "x", min(times[0] for times in later), end)
    else:
        axes.set_xlim(0, end)
    axes.set_xlabel("time $t$")


def log_axis(axes: Axes, name: str, low: float, high: float) -> None:
    """Make the axis `name`, x or y, logarithmic from `low` to `high`, with few enough labels to be
    legible.

    On a short axis these are not only at powers of ten, but at 1.5, 2, 3, 5, ... times them.
    """
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator, MaxNLocator, NullFormatter

    if low == high:
        low, high = low / 2, high * 2
    # Curves begin at their first time after t = 0, not at the edge of the panel; in y they go on to
    # the edge, such as bands that reach below 0
    nonpositive = "mask" if name == "x" else "clip"
    getattr(axes, f"set_{name}scale")("log", nonpositive=nonpositive)
    axes.set(**{f"{name}lim": (low, high)})
    axis = getattr(axes, f"{name}axis")
    decades = np.log10(high / low)
    labelled = next(digits for fewer, digits in LABELLED.items() if decades < fewer)
    axis.set_major_locator(LogLocator(subs=labelled, numticks=7) if labelled else MaxNLocator(2))
    plain = low >= 1e-4 and high <= 1e4
    axis.set_major_formatter(
        "{x:.4g}" if plain else LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf))
    )
    axis.set_minor_locator(LogLocator(subs=range(1, 10), numticks=99))
    axis.set_minor_formatter(NullFormatter())
