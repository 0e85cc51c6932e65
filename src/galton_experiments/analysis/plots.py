"""Figures share a look, curves with bands, and pages of panels. The gid of an artist names its series."""

import io
import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Real
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import EngFormatter
from matplotlib.transforms import Affine2D
from matplotlib.typing import ColorType

from galton.losses import LOSSES
from galton.saving import files
from galton_experiments.analysis.statistics import Interval

_COLORS = ("#000000", "#E69F00", "#0072B2", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#F0E442")
"""Okabe and Ito's, told apart by readers of every colour vision: the losses' by their place in LOSSES."""
_MARKERS = "osD^vP*X"

LineStyle = str | tuple[float, tuple[float, ...]]
LEVELS: dict[str, LineStyle] = {"optimum": "--", "solved": (0.0, (8.0, 3.0)), "doing nothing": ":"}
"""The line styles of levels that panels of a task show."""
_DASH_DOT: LineStyle = (0.0, (5.0, 1.2, 1.2, 1.2))
"""Of what is not the paper's: gaps short enough to be followed where curves lie upon one another."""
_HANDLE, _LETTER = 0.07, 0.0088
"""The inches that a legend's entry takes, without its name and for each letter of it, by point of the font's size."""
_PLACES, _NUMBER = re.compile(rb'\b[dxy]="[^"]*"|\btranslate\([^)]*\)'), re.compile(rb"-?\d+\.\d+")
"""The attributes of an SVG that place something, and a number in them."""
_STYLE: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "font.size": 10,
    "legend.frameon": False,
    "svg.hashsalt": "galton",
}


def panels(
    n: int, columns: int = 4, height: float = 2.7, width: float = 3.1, size: float = 10.0
) -> tuple[Figure, list[Axes]]:
    """A figure of n panels in rows of so many columns; without panels it is empty.

    Args:
        n: how many.
        columns: how many in a row, at most.
        height: of a panel, in inches.
        width: of a panel, in inches.
        size: of its text, in points.
    """
    if not n:
        return Figure(), []
    columns = min(n, columns)
    rows = -(-n // columns)
    with mpl.rc_context(_STYLE | {"font.size": size}):
        figure = Figure(figsize=(width * columns + 0.4, height * rows + 0.5), layout=ConstrainedLayoutEngine())
        axes = list(np.ravel(figure.subplots(rows, columns)))
        for spare in axes[n:]:
            spare.remove()
    return figure, axes[:n]


def grid(rows: int, columns: int) -> tuple[Figure, list[Axes]]:
    """A figure of small panels that stay in their rows and columns, by rows; without panels it is empty."""
    if not rows or not columns:
        return Figure(), []
    with mpl.rc_context(_STYLE | {"font.size": 8}):
        figure = Figure(figsize=(1.65 * columns + 0.6, 1.75 * rows + 0.8), layout=ConstrainedLayoutEngine())
        axes = list(np.ravel(figure.subplots(rows, columns, sharex="col")))
    return figure, axes


def draw_series(
    axes: Axes,
    x: Real[np.ndarray, " L"] | Sequence[float],
    interval: Interval,
    name: str,
    color: ColorType,
    linestyle: str = "-",
    marker: str = "",
) -> None:
    """Draw a curve and its band, named."""
    dashes = _DASH_DOT if linestyle == "-." else linestyle
    axes.plot(x, interval.mean, label=name, gid=name, lw=1.6, color=color, ls=dashes, marker=marker, ms=4)
    axes.fill_between(x, interval.low, interval.high, gid=name, color=color, alpha=0.18, linewidth=0)


def draw_marks(
    axes: Axes,
    intervals: Sequence[Interval],
    name: str,
    color: ColorType,
    shift: float,
    marker: str = "o",
    hollow: bool = False,
    across: bool = False,
) -> None:
    """A mark with its interval at 0, 1, …, drawn so far to the right, so that series stand side by side.

    Across, intervals lie along the x axis, and the marks are at 0, 1, … of the y axis and moved along that.
    """
    mean, low, high = np.array(intervals).T
    place, lengths = np.arange(len(mean)), [mean - low, high - mean]
    line, _, bars = axes.errorbar(
        mean if across else place,
        place if across else mean,
        None if across else lengths,
        lengths if across else None,
        fmt=marker,
        ms=4,
        lw=0.8 if hollow else 1.2,
        color=color,
        mfc="none" if hollow else color,
        label=name,
        transform=Affine2D().translate(*((0, shift) if across else (shift, 0))) + axes.transData,
    )
    for artist in (line, *bars):
        artist.set_gid(name)


def marker_of(loss: str) -> str:
    """The shape of a loss's marks, which tells it from others without its colour."""
    return _MARKERS[[*LOSSES].index(loss) % len(_MARKERS)]


def draw_level(axes: Axes, value: float, name: str) -> None:
    """Draw one of LEVELS as a line all along the x axis."""
    axes.axhline(value, color="#777777", linestyle=LEVELS[name], linewidth=1, label=name, gid=name)


def color(i: int) -> str:
    """The colour of the i-th of several series that have no colour of their own; they repeat."""
    return _COLORS[i % len(_COLORS)]


def dashes(i: int) -> str:
    """The line style of the i-th of these series, another one each time that their colours repeat."""
    return ("-", "--", ":", "-.")[i // len(_COLORS) % 4]


def colors_of(losses: Sequence[str]) -> list[str]:
    """A colour for each series by its loss, the same in all figures; others of a loss have what no loss there has."""
    known = [*LOSSES]
    own = [_COLORS[(known.index(loss) if loss in known else i) % len(_COLORS)] for i, loss in enumerate(losses)]
    left = [shade for shade in (*_COLORS[len(known) :], *_COLORS[: len(known)]) if shade not in own] or [*_COLORS]
    others = itertools.cycle(left)
    return [shade if shade not in own[:i] else next(others) for i, shade in enumerate(own)]


def look_of(loss: str) -> tuple[str, str, str]:
    """Label, colour and line style: what is not the paper's is dash-dotted."""
    color = _COLORS[[*LOSSES].index(loss) % len(_COLORS)]
    return LOSSES[loss].label, color, "-" if LOSSES[loss].in_paper else "-."


def label_rows(axes: Sequence[Axes], words: str) -> None:
    """Name the y axis of each row's first panel."""
    for panel in axes:
        place = panel.get_subplotspec()
        if place is not None and place.is_first_col():
            panel.set_ylabel(words)


def finish(figure: Figure, axes: Sequence[Axes], order: Sequence[str] = ()) -> None:
    """One legend below all panels, of every name in them, in as many columns as fit; in this order, or as drawn."""
    found: dict[str, Artist] = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    if not found:
        return
    found = {label: found[label] for label in (*order, *found) if label in found}
    size = float(axes[0].xaxis.label.get_fontsize())
    columns = _columns([size * (_HANDLE + _LETTER * len(label)) for label in found], figure.get_figwidth())
    with mpl.rc_context(_STYLE):
        handles = list(found.values())
        figure.legend(handles, list(found), loc="outside lower center", ncols=columns, fontsize=size)


def _columns(widths: Sequence[float], room: float) -> int:
    """Into how many columns entries of these widths go, shared out among them in order, in so much room."""
    for n in range(len(widths), 1, -1):
        if sum(part.max() for part in np.array_split(widths, n)) <= room:
            return n
    return 1


def settle(figure: Figure) -> None:
    """Lay it out for good: every drawing of it is the same, and none has to do it again."""
    engine = figure.get_layout_engine()
    with mpl.rc_context(_STYLE | {"figure.autolayout": False, "figure.constrained_layout.use": False}):
        if engine is not None:
            engine.execute(figure)
        figure.set_layout_engine(None)  # with "none" each drawing would begin with one that nobody sees


def over_steps(axes: Axes, last: float) -> None:
    """The x axis of a learning curve."""
    axes.set_xlabel("environment steps")
    axes.set_xlim(0, last)
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))


def fit(axes: Axes, means: Sequence[np.ndarray | np.float64]) -> None:
    """The y axis by the means alone: a single run's crash must not flatten everybody's curve."""
    values = np.concatenate([np.ravel(mean) for mean in means])
    known = values[np.isfinite(values)]
    if len(known):
        margin = 0.05 * np.ptp(known) + 1e-9
        axes.set_ylim(known.min() - margin, known.max() + 2 * margin)


def save(figure: Figure, stem: Path) -> None:
    """Write the figure as stem.png and stem.svg."""
    for suffix, image in images(figure).items():
        files.write(stem.with_suffix(suffix), image)


def images(figure: Figure) -> dict[str, bytes]:
    """The figure's images by file suffix; the same bytes for the same figure."""
    file = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(file, format="png", dpi=160)
    return {".png": file.getvalue(), ".svg": svg(figure)}


def svg(figure: Figure) -> bytes:
    """The figure as an SVG, the same bytes for the same figure; places are in hundredths of a point."""
    file = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(file, format="svg", metadata={"Date": None})
    return _PLACES.sub(lambda place: _NUMBER.sub(_in_hundredths, place[0]), file.getvalue())


def _in_hundredths(number: re.Match[bytes]) -> bytes:
    return b"%.8g" % (round(float(number[0]), 2) + 0.0)
