"""The one style of all figures: print-ready, colours of Okabe and Ito (colour-blind safe), nothing that varies."""

import io

import numpy as np

PANEL = (4.8, 5.4)  # width and height of one scene's panel [inch]
DATA, FIT, FREE, START = "#0072B2", "#D55E00", "#009E73", "#6B6B6B"
INK = "#222222"
DASHED, DOTTED, DASH_DOT = (0, (5, 2.5)), (0, (1, 1.2)), (0, (4, 1.5, 1, 1.5))
KINDS = ((DATA, "-", "o"), (FIT, DASHED, "s"), (FREE, DASH_DOT, "^"), ("#8A4F7D", DOTTED, "D"))  # of disks, of scenes
MOST_COLUMNS = 4  # side by side; further ones begin a new row
TITLE = 45  # characters of a title that a panel has room for; longer ones are set smaller
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


def image_bytes(figure, kind):
    """The figure as the bytes of a PNG or SVG file, without date or version. It is laid out the first time."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, **SAVE[kind])
    figure.set_layout_engine("none")
    return buffer.getvalue()


def tall_and_low(columns, rows=1, ratio=2.6, sharex="col", sharey="row", height=PANEL[1]):
    """A figure of `rows` pairs of a tall and a low panel for each column: (figure, axes (2 rows, columns))."""
    from matplotlib.figure import Figure

    figure = Figure((PANEL[0] * columns, height * rows), layout="constrained")
    axes = figure.subplots(
        2 * rows, columns, sharex=sharex, sharey=sharey, squeeze=False, height_ratios=(ratio, 1) * rows
    )
    return figure, axes


def time_axis(axes, times):
    """Name the time axis and set its ends: logarithmic if the samples after t = 0 are not spread evenly."""
    later = times[times > 0]
    steps = np.diff(later)
    logarithmic = len(steps) > 1 and steps.max() > 10 * steps[:-1].min()
    axes.set_xlim(later[0] if logarithmic else 0, later[-1])
    axes.set_xscale("log" if logarithmic else "linear")
    axes.set_xlabel(f"time $t$ (reduced units{', logarithmic' if logarithmic else ''})")


def band(axes, x, case, name, colour, **line):
    """The curve `name` of a case over x, with its 95 % band if it has one; `line` as for `axes.plot`."""
    if f"{name}_low" in case:
        axes.fill_between(x, case[f"{name}_low"], case[f"{name}_high"], color=colour, alpha=FILL, linewidth=0)
    axes.plot(x, case[name], color=colour, **line)


def bars(cases, name):
    """How far the 95 % intervals of `name` reach down and up (2, cases), for `axes.errorbar`."""
    return np.abs([[float(case[f"{name}_{end}"] - case[name]) for case in cases] for end in ("low", "high")])


def say(axes, text, at, offset, **words):
    """A text beside the point `at`, `offset` points away, that may stand outside the panel."""
    axes.annotate(text, at, offset, textcoords="offset points", annotation_clip=False, **words)


def grid(rows, columns, width, height, **sharing):
    """A figure of equal panels: (figure, axes (rows, columns))."""
    from matplotlib.figure import Figure

    figure = Figure((width * columns, height * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **sharing)


def columns(labels, count, heights, sharey=True):
    """`count` stacks of panels, at most MOST_COLUMNS side by side: (figure, axes (panels of a stack, count)).

    `labels` name the vertical axes of the panels of a stack, `heights` [inch] are theirs. With `sharey` the panels at
    the same place of all stacks have one axis, with numbers at the left of each row alone.
    """
    from matplotlib.figure import Figure

    wide = min(count, MOST_COLUMNS)
    rows, panels = -(-count // wide), len(heights)
    figure = Figure((PANEL[0] * wide, sum(heights) * rows), layout="constrained")
    axes = figure.subplots(panels * rows, wide, squeeze=False, height_ratios=tuple(heights) * rows)
    stacks = axes.reshape(rows, panels, wide).swapaxes(0, 1).reshape(panels, rows * wide)
    for panel in stacks[:, count:].flat:
        panel.remove()
    for label, row in zip(labels, stacks[:, :count], strict=True):
        for k, panel in enumerate(row):
            if k % wide == 0:
                panel.set_ylabel(label)
            if sharey and k > 0:
                panel.sharey(row[0])
                panel.tick_params(labelleft=k % wide == 0)
    return figure, stacks[:, :count]


def heads(panels, titles):
    """Titles and legends above panels, where they cover no data; all titles as high as the longest legend needs."""
    from matplotlib.transforms import ScaledTranslation

    room = 9 + 13.5 * max(len(axes.get_legend_handles_labels()[1]) for axes in panels)
    for axes, title in zip(panels, titles, strict=True):
        axes.set_title(title, pad=room, fontsize=11 * min(1, TITLE / len(title)))
        if axes.get_legend_handles_labels()[1]:
            above = axes.transAxes + ScaledTranslation(0, (room - 5) / 72, axes.figure.dpi_scale_trans)
            place = {"loc": "upper left", "bbox_to_anchor": (-0.02, 1.0), "bbox_transform": above, "borderaxespad": 0}
            axes.legend(**place, labelspacing=0.35).set_in_layout(False)


def shades(count):
    """`count` colours from dark to light that stay in order for every kind of sight and in grey."""
    import matplotlib

    return [matplotlib.colormaps["viridis"](x) for x in np.linspace(0.02, 0.7, count)]
