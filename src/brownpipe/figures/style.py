"""The one style of all figures: print-ready, colours of Okabe and Ito (colour-blind safe), nothing that varies."""

import io

import numpy as np

PANEL = (4.8, 5.4)  # width and height of one scene's panel [inch]
DATA, FIT, FREE, START = "#0072B2", "#D55E00", "#009E73", "#6B6B6B"
INK = "#222222"
DASHED, DOTTED, DASH_DOT = (0, (5, 2.5)), (0, (1, 1.2)), (0, (4, 1.5, 1, 1.5))
KINDS = ((DATA, "-", "o"), (FIT, DASHED, "s"), (FREE, DASH_DOT, "^"), ("#8A4F7D", DOTTED, "D"))  # of disks, of scenes
MOST_COLUMNS = 4  # side by side; further ones begin a new row
MOST_TICKS = 7  # labels of a logarithmic axis
BETWEEN = 0.09  # on each side of a panel [inch]
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


def _figure(width, height):
    """An empty figure [inch], laid out with room between the tick labels of neighbouring panels."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), layout="constrained")
    figure.get_layout_engine().set(w_pad=BETWEEN)
    return figure


def tall_and_low(columns, rows=1, ratio=2.6, sharex="col", sharey="row", height=PANEL[1]):
    """A figure of `rows` pairs of a tall and a low panel for each column: (figure, axes (2 rows, columns))."""
    figure = _figure(PANEL[0] * columns, height * rows)
    axes = figure.subplots(
        2 * rows, columns, sharex=sharex, sharey=sharey, squeeze=False, height_ratios=(ratio, 1) * rows
    )
    return figure, axes


def time_axis(axes, times):
    """Name the time axis and set its ends: logarithmic if the samples after t = 0 are not spread evenly."""
    later = times[times > 0]
    steps = np.diff(later)
    logarithmic = len(steps) > 1 and steps.max() > 10 * steps[:-1].min()
    if logarithmic:
        log_axis(axes, "x", later[0], later[-1])
    else:
        axes.set_xlim(0, later[-1])
    axes.set_xlabel("time $t$")


def log_axis(axes, name, low, high):
    """Make the axis `name`, x or y, logarithmic from `low` to `high`, with few enough labels to stand apart."""
    from matplotlib.ticker import FixedFormatter, FixedLocator, LogLocator, NullFormatter

    if low == high:
        low, high = low / 2, high * 2
    axes.set(**{f"{name}scale": "log", f"{name}lim": (low, high)})
    axis, places = getattr(axes, f"{name}axis"), log_ticks(low, high)
    axis.set_major_locator(FixedLocator(places))
    axis.set_major_formatter(FixedFormatter(_log_labels(places)))
    axis.set_minor_locator(LogLocator(subs=range(1, 10), numticks=99))
    axis.set_minor_formatter(NullFormatter())


def log_ticks(low, high):
    """Where a logarithmic axis is labelled: powers of ten, every so many, or 2 to 7 round numbers of a short axis."""
    from matplotlib.ticker import MaxNLocator

    first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
    ten = 10.0 ** np.arange(first, last + 1)
    for digits in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        places = np.outer(ten, digits).ravel()
        places = places[(places >= low * (1 - 1e-9)) & (places <= high * (1 + 1e-9))]
        if len(places) > 1:
            return places[:: -(-len(places) // MOST_TICKS)]
    places = MaxNLocator(4).tick_values(low, high)
    return places[(places >= low) & (places <= high)]


def _log_labels(places):
    """Plain numbers from 0.001 to 9999, digits and a power of ten beyond."""
    if all(1e-3 <= place < 1e4 for place in places):
        return [f"{place:.10g}" for place in places]
    labels = []
    for place in places:
        exponent = int(np.floor(np.log10(place) + 1e-9))
        digits = f"{place / 10.0**exponent:.4g}"
        labels.append(f"$10^{{{exponent}}}$" if digits == "1" else f"${digits} \\times 10^{{{exponent}}}$")
    return labels


def apart(places, least, low, high):
    """The places of labels, moved as little as possible (least squares) until they lie `least` apart in [low, high].

    Their order stays. Where there is no room for all they share it evenly.
    """
    places, count = np.asarray(places, float), len(places)
    order = np.argsort(places, kind="stable")
    steps = min(least, (high - low) / max(1, count - 1)) * np.arange(count)
    blocks = []  # (mean, labels) of labels that touch: the isotonic regression of places - steps
    for place in places[order] - steps:
        blocks.append((place, 1))
        while len(blocks) > 1 and blocks[-2][0] >= blocks[-1][0]:
            (a, m), (b, n) = blocks[-2:]
            blocks[-2:] = [((m * a + n * b) / (m + n), m + n)]
    moved = np.empty(count)
    moved[order] = np.clip(np.repeat(*zip(*blocks, strict=True)), low, high - steps[-1]) + steps
    return moved


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
    figure = _figure(width * columns, height * rows)
    return figure, figure.subplots(rows, columns, squeeze=False, **sharing)


def columns(labels, count, heights, sharey=True):
    """`count` stacks of panels, at most MOST_COLUMNS side by side: (figure, axes (panels of a stack, count)).

    `labels` name the vertical axes of the panels of a stack, `heights` [inch] are theirs. With `sharey` the panels at
    the same place of all stacks have one axis, with numbers at the left of each row alone.
    """
    wide = min(count, MOST_COLUMNS)
    rows, panels = -(-count // wide), len(heights)
    figure = _figure(PANEL[0] * wide, sum(heights) * rows)
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
