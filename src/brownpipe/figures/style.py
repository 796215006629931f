"""The one style of all figures: print-ready, colours of Okabe and Ito (colour-blind safe), nothing that varies."""

import io

import numpy as np

PANEL = (4.8, 5.4)  # width and height of one scene's panel [inch]
DATA, FIT, FREE, START = "#0072B2", "#D55E00", "#009E73", "#6B6B6B"
INK = "#222222"
DASHED, DOTTED = (0, (5, 2.5)), (0, (1, 1.2))
FILL = 0.22  # opacity of a band
SAVE = {"png": {"dpi": 160, "metadata": {"Software": None}}, "svg": {"metadata": {"Date": None, "Creator": None}}}

_STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "mathtext.fontset": "dejavusans",
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#555555",
    "axes.linewidth": 0.8,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E8E8E8",
    "grid.linewidth": 0.7,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.8,
    "lines.linewidth": 1.8,
    "svg.hashsalt": "brownpipe",
    "svg.fonttype": "path",
    "figure.facecolor": "white",
}


def drawing():
    """Context in which figures are drawn and saved: matplotlib's defaults and `_STYLE`, whatever the user has set."""
    import matplotlib

    defaults = {key: value for key, value in matplotlib.rcParamsDefault.items() if not key.startswith("backend")}
    return matplotlib.rc_context(defaults | _STYLE)


def tall_and_low(columns):
    """A figure with a tall and a low panel above each other for each column: (figure, axes (2, columns))."""
    from matplotlib.figure import Figure

    figure = Figure((PANEL[0] * columns, PANEL[1]), layout="constrained")
    axes = figure.subplots(2, columns, sharex="col", sharey="row", squeeze=False, height_ratios=(2.6, 1))
    return figure, axes


def grid(rows, columns, width, height, **sharing):
    """A figure of equal panels: (figure, axes (rows, columns))."""
    from matplotlib.figure import Figure

    figure = Figure((width * columns, height * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **sharing)


def head(axes, title):
    """Title and legend above the panel, where they cover no data."""
    legend = axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), borderaxespad=0.2, labelspacing=0.35)
    legend.set_in_layout(False)
    axes.set_title(title, pad=9 + 13.5 * len(legend.get_texts()))


def shades(count):
    """`count` colours from dark to light that stay in order for every kind of sight and in grey."""
    import matplotlib

    return [matplotlib.colormaps["viridis"](x) for x in np.linspace(0.02, 0.7, count)]


def image(figure, kind):
    """The figure as the bytes of a PNG or SVG file, without date or version."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, **SAVE[kind])
    return buffer.getvalue()
