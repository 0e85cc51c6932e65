"""The report: claims, figures and how they were made, as one HTML file that needs nothing else.

A figure becomes inline SVG, a drawing per panel, so that narrow screens can stack them; text stays text and ink follows
the reader's theme. The numbers behind its series go along as JSON, for tooltips and the download.
"""

import base64
import dataclasses
import hashlib
import io
import itertools
import math
import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any, NamedTuple, TypeGuard

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from jinja2 import Environment, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.category import StrCategoryFormatter
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import StepPatch
from matplotlib.ticker import FixedFormatter, FuncFormatter
from matplotlib.transforms import BboxBase

from galton.analysis.plots import RUN
from galton.errors import require

VERDICTS = ("holds", "holds in part", "does not hold", "not decidable here")

_INKS = {
    "#000000": "currentColor",
    "#e6e6e6": "var(--grid)",
    "#e69f00": "var(--orange)",
    "#0072b2": "var(--blue)",
    "#009e73": "var(--green)",
}
"""Colours of figures for which page.css has a value for light and one for dark."""
_DARKEST = 0.16
"""The least luminance at night: a contrast of 3.6 with page.css's paper."""
_SCALE = (1.1, 1.25)
"""CSS pixels per point, at least and at most."""
_WIDTH = 1180
"""CSS pixels for panels side by side: what page.css leaves between the page's margins, and a little less."""
_MARGIN = 4.0
"""Points around a panel."""
Curve = Line2D | PathCollection | StepPatch
Box = Float[np.ndarray, " 4"]
"""Left, top, right and bottom in points."""


@dataclasses.dataclass(frozen=True)
class Claim:
    """A sentence of the paper, and what became of it."""

    source: str
    """Where it stands: "§5.2, Figure 3"."""
    words: str
    test: str
    """What was compared with what."""
    number: str
    verdict: str
    """One of VERDICTS."""
    why: str
    section: str | None = None
    """The name of the section it rests on."""

    def __post_init__(self) -> None:
        require(self.verdict in VERDICTS, f"verdict is {self.verdict!r}; it must be one of {', '.join(VERDICTS)}")


@dataclasses.dataclass(frozen=True)
class Table:
    """Cells as they are shown."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]

    def __post_init__(self) -> None:
        for row in self.rows:
            fits = len(row) == len(self.headings)
            require(
                fits, f"rows has one of {len(row)} cells, {list(row)}; it must be {len(self.headings)}, as headings"
            )

    def is_numeric(self, column: int) -> bool:
        """Whether its cells are numbers, to be set flush right; blanks and dashes are none, but allowed."""
        return all(re.match(r"[-−+±<>≤≥~≈ ]*\.?\d|[-—–]?$", row[column]) for row in self.rows)


@dataclasses.dataclass(frozen=True)
class Section:
    """A figure and all that belongs to it; everything but name and title may be left out."""

    name: str
    """The anchor: lower-case letters, digits and hyphens, a letter first."""
    title: str
    caption: str = ""
    figure: Figure | None = None
    facts: Sequence[tuple[str, str]] = ()
    """How it was made, label and text: settings, versions, machines, command."""
    table: Table | None = None
    paragraphs: Sequence[str] = ()

    def __post_init__(self) -> None:
        fits = re.fullmatch("[a-z][a-z0-9-]*", self.name) is not None
        require(
            fits, f"name is {self.name!r}; a section's must be lower-case letters, digits and hyphens, a letter first"
        )


class _Drawing(NamedTuple):
    """A figure as the template takes it."""

    title: str
    panels: list[Markup]
    """SVG, each with one of the axes; or one with the whole figure."""
    width: int | None
    """CSS pixels of the panels side by side; None where the figure can't be divided."""
    legend: list[tuple[str, Markup]]
    """Name and SVG of each series."""
    has_runs: bool
    data: Markup
    """What page.js reads, as JSON."""


def render(title: str, introduction: Sequence[str], claims: Sequence[Claim], sections: Sequence[Section]) -> str:
    """The page as HTML: the same for the same input.

    Raises:
        UsageError: two sections have one name, or a claim rests on none of them.
    """
    titles: dict[str, str] = {}
    for section in sections:
        require(section.name not in titles, f"sections has {section.name!r} twice; each must have a name of its own")
        titles[section.name] = section.title
    for claim in claims:
        known = claim.section is None or claim.section in titles
        require(known, f"section is {claim.section!r} in the claim {claim.words!r}; it must be one of {list(titles)}")
    drawings = {section.name: _draw(section.name, section.figure) for section in sections if section.figure is not None}
    widths = (
        f"#{name} .panels {{ max-width: {drawing.width}px }}" for name, drawing in drawings.items() if drawing.width
    )
    style, script = "\n".join([_file("page.css"), *widths]), _file("page.js")
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    return environment.from_string(_file("page.html.jinja")).render(
        title=title,
        introduction=introduction,
        claims=claims,
        verdicts={verdict: sum(claim.verdict == verdict for claim in claims) for verdict in VERDICTS},
        order={verdict: i for i, verdict in enumerate(VERDICTS)},
        sections=sections,
        titles=titles,
        drawings=drawings,
        policy=f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {_hash(script)}; "
        "base-uri 'none'; form-action 'none'",
        style=Markup(style),
        script=Markup(script),
    )


def _file(name: str) -> str:
    return resources.files("galton.analysis").joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _draw(name: str, figure: Figure) -> _Drawing:
    """The figure inline, its ids beginning with the section's name."""
    shown = [axes for axes in figure.axes if axes.get_visible()]
    artists = [artist for axes in shown for artist in _named(axes)]
    names = list(dict.fromkeys(map(_series, artists)))
    tags: dict[Artist, str] = {axes: f"{name}.axes-{i}" for i, axes in enumerate(shown)}
    for i, artist in enumerate(artists):
        tags[artist] = f"{name}.{'run' if _is_run(artist) else 'mark'}-{names.index(_series(artist))}-{i}"
    legends = [legend for legend in figure.legends if {text.get_text() for text in legend.get_texts()} <= {*names}]

    root = _svg(figure, name, tags, legends)
    groups = {group.get("id"): group for group in root.iter("g")}
    swatches = {artist: _swatch(groups[tags[artist]], artist) for artist in artists}
    frames = [_points(figure, axes.bbox) for axes in shown]
    parts = _panels(figure, shown, frames, legends)
    boxes = [box for _, box in parts] or [np.array([0, 0, *figure.get_size_inches() * 72])]
    contents = [[groups[tags[axes]] for axes in members] for members, _ in parts] or [[*root]]
    contents[0][:0] = root.findall("defs") if parts else []
    wide = len({round(left) for left, *_ in boxes}) * (boxes[0][2] - boxes[0][0])
    scale = float(np.clip(_WIDTH / wide, *_SCALE))
    panels = [
        _panel(axes, names, swatches) | {"id": tags[axes], "box": _bounds(frame)}
        for axes, frame in zip(shown, frames, strict=True)
    ]
    return _Drawing(
        title=figure.get_suptitle() if parts else "",
        panels=[_markup(_canvas(box, content, scale)) for box, content in zip(boxes, contents, strict=True)],
        width=math.ceil(wide * scale) + 2 if parts else None,
        legend=[
            (series, _shared([artist for artist in artists if _series(artist) == series], swatches)) for series in names
        ],
        has_runs=any(map(_is_run, artists)),
        data=htmlsafe_json_dumps({"names": names, "panels": panels}, separators=(",", ":"), allow_nan=False),
    )


def _named(axes: Axes) -> list[Artist]:
    """What belongs to a series."""
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


def _panel(axes: Axes, names: Sequence[str], swatches: Mapping[Artist, ET.Element]) -> dict[str, Any]:
    """What is drawn in it: each axis, and the values of each series with its band."""
    areas = [artist for artist in _named(axes) if isinstance(artist, PolyCollection)]
    grids: list[list[float]] = []
    series = []
    for artist in _named(axes):
        if _is_curve(artist) and not _is_run(artist):
            x, y = _values(artist, axes)
            grids += [x] if x not in grids else []
            entry = {"name": names.index(_series(artist)), "color": _color(swatches[artist])}
            entry |= {"x": grids.index(x), "mean": _short(y)}
            area = next((area for area in areas if _series(area) == _series(artist)), None)
            if area is not None:
                areas.remove(area)
                entry |= _band(area, x, y)
            series.append(entry)
    titles = [axes.get_title(loc) for loc in ("center", "left", "right")]
    return {
        "title": next(filter(None, titles), ""),
        "x": {"label": axes.get_xlabel(), "limits": axes.get_xlim(), "scale": axes.get_xscale(), "ticks": _ticks(axes)},
        "y": {"limits": axes.get_ylim(), "scale": axes.get_yscale()},
        "grids": [_short(grid) for grid in grids],
        "series": series,
    }


def _values(artist: Curve, axes: Axes) -> tuple[list[float], list[float]]:
    """Its x and y; no x where it is a level, the same all along the axis."""
    if isinstance(artist, StepPatch):
        heights, edges, _ = artist.get_data()
        return ((edges[1:] + edges[:-1]) / 2).tolist(), heights.astype(float).tolist()
    points: Any = artist.get_xydata() if isinstance(artist, Line2D) else artist.get_offsets()
    if artist.get_transform().contains_branch_seperately(axes.transData) == (False, True):
        return [], [float(points[0, 1])]
    x, y = np.ma.filled(points, np.nan)[np.isfinite(points[:, 0])].T.tolist()
    return x, y


def _band(area: PolyCollection, x: Sequence[float], y: Sequence[float]) -> dict[str, list[int | float | None]]:
    """Where it ends at each x, lowest and highest; nothing where it is the area under the curve."""
    ends: dict[float, tuple[float, float]] = {}
    for path in area.get_paths():
        for at, end in np.asarray(path.vertices).tolist():
            low, high = ends.get(at, (end, end))
            ends[at] = min(low, end), max(high, end)
    low, high = zip(*(ends.get(at, (math.nan, math.nan)) for at in x), strict=True)
    is_band = ([*low] == y) == ([*high] == y)
    return {"low": _short(low), "high": _short(high)} if is_band else {}


def _short(values: Sequence[float]) -> list[int | float | None]:
    """To five digits, whole numbers in full; None where it is not finite, since JSON knows no NaN."""
    return [
        None if not math.isfinite(x) else int(x) if x == int(x) and abs(x) < 1e15 else float(f"{x:.5g}") for x in values
    ]


def _ticks(axes: Axes) -> list[tuple[float, str]]:
    """Where the x axis has words for numbers: those."""
    if not isinstance(axes.xaxis.get_major_formatter(), FixedFormatter | FuncFormatter | StrCategoryFormatter):
        return []
    return [(float(x), label.get_text()) for x, label in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)]


def _points(figure: Figure, box: BboxBase) -> Box:
    """A box of the canvas in points, y downwards, as in the SVG."""
    x0, y0, x1, y1 = np.asarray(box.extents) * 72 / figure.dpi
    height = figure.get_figheight() * 72
    return np.array([x0, height - y1, x1, height - y0])


def _bounds(box: Box) -> list[float]:
    """Left, top, width, height."""
    return [round(float(x), 2) for x in (*box[:2], *(box[2:] - box[:2]))]


def _panels(
    figure: Figure, shown: Sequence[Axes], frames: Sequence[Box], legends: Sequence[Legend]
) -> list[tuple[list[Axes], Box]]:
    """The figure in parts of one size, each with its axes (two where they share a place); none if it must stay whole.

    It must where something belongs to no panel, or where a panel lacks tick labels that another has.
    """
    headings = [text for text in figure.texts if text.get_text() == figure.get_suptitle()]
    strangers = {*figure.get_children()} - {figure.patch, *shown, *legends, *headings}
    members: dict[Any, list[int]] = {}
    for i, axes in enumerate(shown):
        members.setdefault(axes.get_subplotspec(), []).append(i)
    if strangers or None in members or len({(_has_labels(axes.xaxis), _has_labels(axes.yaxis)) for axes in shown}) != 1:
        return []
    outwards = np.array([-1, -1, 1, 1])
    outer = [_points(figure, axes.get_tightbbox() or axes.bbox) for axes in shown]
    margins = _MARGIN + np.max([(far - near) * outwards for far, near in zip(outer, frames, strict=True)], axis=0)
    return [([shown[i] for i in some], frames[some[0]] + margins * outwards) for some in members.values()]


def _has_labels(axis: Axis) -> bool:
    return any(label.get_text() and label.get_visible() for label in axis.get_ticklabels())


def _svg(figure: Figure, name: str, tags: Mapping[Artist, str], hidden: Sequence[Artist]) -> ET.Element:
    """The figure's SVG, tidied, without the hidden artists; of its groups those with a tag have it for an id."""
    gids = {artist: artist.get_gid() for artist in tags}
    try:
        for artist, tag in tags.items():
            artist.set_gid(tag)
        for artist in hidden:
            artist.set_visible(False)
        file = io.BytesIO()
        with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "galton"}):
            figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    finally:
        for artist, gid in gids.items():
            artist.set_gid(gid)
        for artist in hidden:
            artist.set_visible(True)
    root = ET.fromstring(file.getvalue())
    _tidy(root, name, tags.values())
    return root


def _tidy(root: ET.Element, name: str, tags: Iterable[str]) -> None:
    """Attributes for styles, inks that follow the theme, short numbers, ids that no other figure has."""
    ids = defaultdict(map(f"{name}.{{}}".format, itertools.count()).__next__, {tag: tag for tag in tags})
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    at_end = {text for tick in root.iter("g") if tick.get("id", "").startswith("ytick_") for text in tick.iter("text")}
    for element in [*root.iter()]:
        element.tail = None
        if len(element) or element.tag not in {"text", "tspan"}:
            element.text = None
        for child in [*element.findall("metadata"), *element.findall("style")]:
            element.remove(child)
        _clean(element, ids)
    for text in root.iter("text"):
        if len(text):
            _flow(text, "end" if text in at_end else "middle")


def _clean(element: ET.Element, ids: defaultdict[str, str]) -> None:
    styles = dict(part.split(": ", 1) for part in element.attrib.pop("style", "").split("; ") if part)
    attributes = {key.rpartition("}")[2]: value for key, value in element.attrib.items()} | styles
    element.attrib.clear()
    for key, value in attributes.items():
        if key == "id":
            if element.tag not in ("g", "image") or value in ids:
                element.set("id", ids[value])
            if found := re.search(r"\.(mark|run)-(\d+)-", value):
                element.attrib |= {"class": found[1], "data-series": found[2]}
        elif key == "href":
            element.set("href", re.sub("(?<=^#).+", lambda old: ids[old[0]], value))
        elif key == "d" and not re.search("[^MLz]", re.sub(r"[-\d.\s]", "", value)):
            element.set("d", "".join(map(_steps, value.split("M")[1:])))
        elif key in ("d", "x", "y", "width", "height"):
            element.set(key, re.sub(r"\d+\.\d+", lambda number: f"{float(number[0]):.2f}", value).replace("\n", ""))
        elif key == "font":  # until matplotlib 3.10
            element.set("font-size", re.findall(r"[\d.]+px", value)[0])
        elif value.startswith("#"):
            element.set(key, _ink(value))
        elif key != "font-family" and not value.startswith("rotate(-0 "):
            element.set(key, re.sub(r"(?<=url\(#)[^)]+", lambda old: ids[old[0]], value))


def _ink(color: str) -> str:
    """A colour for either theme: greys lie between ink and paper, and what is too dark for the night is lightened."""
    rgb = np.array(to_rgb(color))
    if color in _INKS:
        return _INKS[color]
    if np.ptp(rgb) == 0:
        return f"color-mix(in srgb, currentColor {100 * (1 - rgb[0]):.0f}%, var(--paper))"
    lighter = (rgb + (1 - rgb) * white for white in np.linspace(0, 1, 21))
    night = to_hex(next(mix for mix in lighter if mix**2.2 @ (0.2126, 0.7152, 0.0722) > _DARKEST))
    return color if night == color else f"light-dark({color}, {night})"


def _steps(path: str) -> str:
    """Straight lines as SVG, from one to the next point, to a tenth of a point: half as long as from the origin."""
    tenths = np.rint(np.array(re.findall(r"[-\d.]+", path), float) * 10).astype(int).reshape(-1, 2)
    (x, y), *steps = [[f"{at / 10:g}" for at in point] for point in np.diff(tenths, axis=0, prepend=[[0, 0]])]
    line = " ".join(itertools.chain.from_iterable(steps)).replace(" -", "-")
    return f"M{x} {y}" + ("l" + line if line else "") + "z" * path.count("z")


def _flow(text: ET.Element, anchor: str) -> None:
    """Math as running text: matplotlib sets each glyph at its place in DejaVu Sans, which is wider than most fonts.

    A fraction, or what else has one glyph above another, stays as it is.
    """
    glyphs = sorted(
        (float(x), float(y), i, character)
        for i, span in enumerate(text)
        for x, y, character in zip(
            span.get("x", "").split(), itertools.cycle(span.get("y", "").split()), span.text or ""
        )
    )
    font = get_font(findfont("DejaVu Sans"))
    spans: list[ET.Element] = []
    end, level = glyphs[0][0], 0.0
    for x, y, i, character in glyphs:
        look = {key: value for key, value in text[i].attrib.items() if key not in ("x", "y")}
        size = float(look.get("font-size", "10px").removesuffix("px"))
        if x < end - 0.2 * size:
            return
        spans.append(ET.Element("tspan", look | ({"dy": f"{y - level:.2f}"} if y != level else {})))
        spans[-1].text = ("\u2009" if x > end + 0.1 * size else "") + character
        font.set_size(size, 72)
        end, level = x + font.load_char(ord(character)).linearHoriAdvance / 65536, y
    text[:] = spans
    text.attrib |= {"text-anchor": anchor, "x": f"{end if anchor == 'end' else (glyphs[0][0] + end) / 2:.2f}"}


def _swatch(group: ET.Element, artist: Artist) -> ET.Element:
    """How a series looks, for the legend."""
    swatch = ET.Element("svg", {"class": "swatch", "viewBox": "0 0 28 12", "aria-hidden": "true"})
    path, marker = group.find("path"), group.find("g/use")
    if _is_curve(artist):
        if path is not None:
            ET.SubElement(swatch, "path", _look(path) | {"d": "M1 6H27"})
        if marker is not None:
            ET.SubElement(swatch, "use", _look(marker) | {"href": marker.get("href", ""), "x": "14", "y": "6"})
    elif (area := path if path is not None else marker) is not None:
        ET.SubElement(swatch, "rect", _look(area) | {"x": "4", "y": "0", "width": "20", "height": "12"})
    return swatch


def _shared(artists: Sequence[Artist], swatches: Mapping[Artist, ET.Element]) -> Markup:
    """A series' swatch; none if its colour differs from panel to panel."""
    shown = [swatches[artist] for artist in artists if _is_curve(artist) and not _is_run(artist)]
    shown = shown or [swatches[artist] for artist in artists]
    return _markup(shown[0]) if len({*map(_color, shown)}) == 1 else Markup()


def _look(element: ET.Element) -> dict[str, str]:
    return {key: value for key, value in element.attrib.items() if re.match("fill|stroke|opacity", key)}


def _color(swatch: ET.Element) -> str:
    looks = [value for element in swatch for key, value in element.attrib.items() if key in ("fill", "stroke")]
    return next((value for value in looks if value != "none"), "currentColor")


def _canvas(box: Box, content: Sequence[ET.Element], scale: float) -> ET.Element:
    """These elements as an SVG of that part of the figure."""
    left, top, width, height = _bounds(box)
    size = {"width": f"{width * scale:.2f}", "height": f"{height * scale:.2f}"}
    canvas = ET.Element("svg", size | {"viewBox": f"{left} {top} {width} {height}"})
    canvas.extend(content)
    return canvas


def _markup(element: ET.Element) -> Markup:
    return Markup(ET.tostring(element, encoding="unicode"))
