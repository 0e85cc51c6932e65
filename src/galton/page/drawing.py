"""A matplotlib figure for the page: inline SVG, a drawing per panel, so that narrow screens can stack them.

The numbers behind its series go along as JSON, for tooltips and the download.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeGuard

import numpy as np
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.category import StrCategoryFormatter
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import StepPatch
from matplotlib.ticker import FixedFormatter, FuncFormatter
from matplotlib.transforms import BboxBase

from galton.analysis.plots import RUN
from galton.page import svg
from galton.page.svg import Box

_SCALE = (1.1, 1.25)
"""How many CSS pixels a point has, at least and at most."""
_WIDTH = 1180
"""CSS pixels for panels side by side: what page.css leaves between the page's margins, and a little less."""
_MARGIN = 4.0
"""How many points are left free around a panel."""
_KNOTS = 101
"""Between how many values a scale is taken to be linear, less one."""
Curve = Line2D | PathCollection | StepPatch


class Drawing(NamedTuple):
    """A figure as page.html.jinja takes it."""

    title: str
    panels: list[Markup]
    """The SVGs of the panels, or one SVG with the whole figure where it can't be divided."""
    width: int | None
    """How many CSS pixels the panels take side by side; None where the figure can't be divided."""
    legend: list[tuple[str, Markup]]
    """The name of each series, and an SVG of how it looks."""
    has_runs: bool
    data: Markup
    """The names and numbers of all series, as the JSON that page.js reads."""


def draw(name: str, figure: Figure) -> Drawing:
    """The figure inline, its ids beginning with the section's name."""
    shown = [axes for axes in figure.axes if axes.get_visible()]
    artists = [artist for axes in shown for artist in _named(axes)]
    ordered = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    drawn = dict.fromkeys(map(_series, artists))
    names = list(dict.fromkeys([*(name for name in ordered if name in drawn), *drawn]))
    tags: dict[Artist, str] = {axes: f"{name}.axes-{i}" for i, axes in enumerate(shown)}
    for i, artist in enumerate(artists):
        tags[artist] = f"{name}.{'run' if _is_run(artist) else 'mark'}-{names.index(_series(artist))}-{i}"
    legends = [legend for legend in figure.legends if {text.get_text() for text in legend.get_texts()} <= {*names}]

    root = svg.svg(figure, name, tags, legends)
    groups = {group.get("id"): group for group in root.iter("g")}
    swatches = {artist: _swatch(groups[tags[artist]], artist) for artist in artists}
    frames = [_points(figure, axes.bbox) for axes in shown]
    parts = _panels(figure, shown, frames, legends)
    boxes = [box for _, box in parts] or [_whole(figure, shown, legends)]
    contents = [[groups[tags[axes]] for axes in members] for members, _ in parts] or [[*root]]
    contents[0][:0] = root.findall("defs") if parts else []
    wide = len({round(left) for left, *_ in boxes}) * (boxes[0][2] - boxes[0][0])
    scale = float(np.clip(_WIDTH / wide, *_SCALE))
    panels = [
        _panel(axes, names, swatches) | {"id": tags[axes], "box": svg.bounds(frame)}
        for axes, frame in zip(shown, frames, strict=True)
    ]
    return Drawing(
        title=figure.get_suptitle() if parts else "",
        panels=[svg.markup(svg.canvas(box, content, scale)) for box, content in zip(boxes, contents, strict=True)],
        width=math.ceil(wide * scale) + 2 if parts else None,
        legend=[
            (series, _shared([artist for artist in artists if _series(artist) == series], swatches)) for series in names
        ],
        has_runs=any(map(_is_run, artists)),
        data=htmlsafe_json_dumps({"names": names, "panels": panels}, separators=(",", ":"), allow_nan=False),
    )


def _named(axes: Axes) -> list[Artist]:
    """The visible artists of these axes that belong to a series, which their gid names."""
    return [artist for artist in axes.get_children() if artist.get_gid() is not None and artist.get_visible()]


def _is_run(artist: Artist) -> bool:
    return str(artist.get_gid()).startswith(RUN)


def _is_curve(artist: Artist) -> TypeGuard[Curve]:
    """Whether it has values, a y for each x: areas and upright lines have none."""
    if isinstance(artist, Line2D) and artist.axes is not None:
        return artist.get_transform().contains_branch_seperately(artist.axes.transData)[1]
    return isinstance(artist, PathCollection) or (isinstance(artist, StepPatch) and not artist.get_fill())


def _series(artist: Artist) -> str:
    return str(artist.get_gid()).removeprefix(RUN)


def _panel(axes: Axes, names: Sequence[str], swatches: Mapping[Artist, ET.Element]) -> dict[str, object]:
    """What is drawn in it: each axis, and the values of each series with its band."""
    areas = [artist for artist in _named(axes) if isinstance(artist, PolyCollection | LineCollection)]
    grids: list[list[float]] = []
    series = []
    for artist in _named(axes):
        if _is_curve(artist) and not _is_run(artist):
            x, y = _values(artist, axes)
            grids += [x] if x not in grids else []
            entry = {"name": names.index(_series(artist)), "color": svg.color(swatches[artist])}
            entry |= {"x": grids.index(x), "mean": _short(y)}
            area = next((area for area in areas if _series(area) == _series(artist)), None)
            if area is not None:
                areas.remove(area)
                entry |= _band(area, x, y)
            series.append(entry)
    titles = [axes.get_title(loc) for loc in ("center", "left", "right")]
    return {
        "title": next(filter(None, titles), "").replace("\n", ", "),
        "x": {"label": axes.get_xlabel(), "ticks": _ticks(axes)} | _scale(axes.xaxis, axes.get_xlim()),
        "y": _scale(axes.yaxis, axes.get_ylim()),
        "grids": [_short(grid) for grid in grids],
        "series": series,
    }


def _scale(axis: Axis, limits: tuple[float, float]) -> dict[str, object]:
    """Where values lie on an axis: its limits, and its scale or, of one that is neither linear nor logarithmic, knots.

    Knots are values at equal distances from the first limit to the second.
    """
    name = axis.get_scale()
    if name in ("linear", "log"):
        return {"limits": limits, "scale": name}
    transform = axis.get_transform()
    low, high = transform.transform(np.array(limits))
    knots = transform.inverted().transform(np.linspace(low, high, _KNOTS))
    return {"limits": limits, "scale": "knots", "knots": [float(f"{knot:.7g}") for knot in knots]}


def _values(artist: Curve, axes: Axes) -> tuple[list[float], list[float]]:
    """The x and y of a curve; no x where it is a level, the same all along the axis."""
    if isinstance(artist, StepPatch):
        heights, edges, _ = artist.get_data()
        return ((edges[1:] + edges[:-1]) / 2).tolist(), heights.astype(float).tolist()
    points = np.asanyarray(artist.get_xydata() if isinstance(artist, Line2D) else artist.get_offsets())
    if artist.get_transform().contains_branch_seperately(axes.transData) == (False, True):
        return [], [float(points[0, 1])]
    x, y = np.ma.filled(points, np.nan)[np.isfinite(points[:, 0])].T.tolist()
    return x, y


def _band(
    area: PolyCollection | LineCollection, x: Sequence[float], y: Sequence[float]
) -> dict[str, list[int | float | None]]:
    """Where it, or the bar there, ends at each x, lowest and highest; nothing where it is the area under the curve."""
    ends: dict[float, tuple[float, float]] = {}
    for path in area.get_paths():
        for at, end in np.asarray(path.vertices).tolist():
            low, high = ends.get(at, (end, end))
            ends[at] = min(low, end), max(high, end)
    if not x:
        return {}
    low, high = zip(*(ends.get(at, (math.nan, math.nan)) for at in x), strict=True)
    is_band = ([*low] == y) == ([*high] == y)
    return {"low": _short(low), "high": _short(high)} if is_band else {}


def _short(values: Sequence[float]) -> list[int | float | None]:
    """The values to five digits, whole numbers in full; None where one is not finite, since JSON knows no NaN."""
    return [
        None if not math.isfinite(x) else int(x) if x == int(x) and abs(x) < 1e15 else float(f"{x:.5g}") for x in values
    ]


def _ticks(axes: Axes) -> list[tuple[float, str]]:
    """The words that the x axis has in the place of numbers, and where; none if it has numbers."""
    if not isinstance(axes.xaxis.get_major_formatter(), FixedFormatter | FuncFormatter | StrCategoryFormatter):
        return []
    return [(float(x), label.get_text()) for x, label in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)]


def _points(figure: Figure, box: BboxBase) -> Box:
    """A box of the canvas in points, y downwards, as in the SVG."""
    x0, y0, x1, y1 = np.asarray(box.extents) * 72 / figure.dpi
    height = figure.get_figheight() * 72
    return np.array([x0, height - y1, x1, height - y0])


def _panels(
    figure: Figure, shown: Sequence[Axes], frames: Sequence[Box], legends: Sequence[Legend]
) -> list[tuple[list[Axes], Box]]:
    """The figure in parts of one size, each with its axes (two where they share a place); none if it must stay whole.

    It must where something belongs to no panel, or where a panel lacks tick labels that another has.
    """
    headings = [text for text in figure.texts if text.get_text() == figure.get_suptitle()]
    strangers = {*figure.get_children()} - {figure.patch, *shown, *legends, *headings}
    members: dict[SubplotSpec | None, list[int]] = {}
    for i, axes in enumerate(shown):
        members.setdefault(axes.get_subplotspec(), []).append(i)
    if strangers or None in members or len({(_has_labels(axes.xaxis), _has_labels(axes.yaxis)) for axes in shown}) != 1:
        return []
    outwards = np.array([-1, -1, 1, 1])
    outer = [_points(figure, axes.get_tightbbox() or axes.bbox) for axes in shown]
    margins = _MARGIN + np.max([(far - near) * outwards for far, near in zip(outer, frames, strict=True)], axis=0)
    return [([shown[i] for i in some], frames[some[0]] + margins * outwards) for some in members.values()]


def _whole(figure: Figure, shown: Sequence[Axes], legends: Sequence[Legend]) -> Box:
    """The whole figure, but for the room below its axes that legends had which are not shown."""
    width, height = figure.get_size_inches() * 72
    ends = [_points(figure, axes.get_tightbbox() or axes.bbox)[3] + _MARGIN for axes in shown]
    return np.array([0, 0, width, min(height, max(ends)) if legends else height])


def _has_labels(axis: Axis) -> bool:
    return any(label.get_text() and label.get_visible() for label in axis.get_ticklabels())


def _swatch(group: ET.Element, artist: Artist) -> ET.Element:
    """A small SVG of how a series looks, for the legend."""
    swatch = ET.Element("svg", {"class": "swatch", "viewBox": "0 0 28 12", "aria-hidden": "true"})
    path, marker = group.find("path"), group.find("g/use")
    if _is_curve(artist):
        if path is not None:
            ET.SubElement(swatch, "path", svg.look(path) | {"d": "M1 6H27"})
        if marker is not None:
            ET.SubElement(swatch, "use", svg.look(marker) | {"href": marker.get("href", ""), "x": "14", "y": "6"})
    elif (area := path if path is not None else marker) is not None:
        ET.SubElement(swatch, "rect", svg.look(area) | {"x": "4", "y": "0", "width": "20", "height": "12"})
    return swatch


def _shared(artists: Sequence[Artist], swatches: Mapping[Artist, ET.Element]) -> Markup:
    """A series' swatch; none if its colour differs from panel to panel."""
    shown = [swatches[artist] for artist in artists if _is_curve(artist) and not _is_run(artist)]
    shown = shown or [swatches[artist] for artist in artists]
    clearest = max(shown, key=lambda swatch: swatch.find("path") is not None)
    return svg.markup(clearest) if len({*map(svg.color, shown)}) == 1 else Markup()
