"""Matplotlib's SVG, tidied for a page: text stays text, ink follows the reader's theme, ids are unique."""

import io
import itertools
import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from markupsafe import Markup
from matplotlib.artist import Artist
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font

_INKS = {
    "#000000": "currentColor",
    "#e6e6e6": "var(--grid)",
    "#e69f00": "var(--orange)",
    "#0072b2": "var(--blue)",
    "#009e73": "var(--green)",
}
"""Colours of figures for which page.css has a value for light and one for dark."""
_LUMINANCE = 0.16, 0.29
"""The least at night and the most by day: contrasts of 3.6 and 3.1 with page.css's paper."""
Box = Float[np.ndarray, " 4"]
"""A rectangle: its left, top, right and bottom in points."""


def svg(figure: Figure, name: str, tags: Mapping[Artist, str], hidden: Sequence[Artist]) -> ET.Element:
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
    root = ET.fromstring(file.getvalue())  # noqa: S314  matplotlib wrote it just now
    _tidy(root, name, tags.values())
    return root


def _tidy(root: ET.Element, name: str, tags: Iterable[str]) -> None:
    """Give the SVG attributes for styles, inks that follow the theme, short numbers, ids that no other figure has."""
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
    """A colour for either theme: greys lie between ink and paper, others are made light or dark enough to be seen."""
    rgb = np.array(to_rgb(color))
    if color in _INKS:
        return _INKS[color]
    if np.ptp(rgb) == 0:
        return f"color-mix(in srgb, currentColor {100 * (1 - rgb[0]):.0f}%, var(--paper))"
    least, most = _LUMINANCE
    shares = np.linspace(0, 1, 21)
    night = next(mix for mix in (rgb + (1 - rgb) * white for white in shares) if _luminance(mix) > least)
    day = next(mix for mix in (rgb * (1 - black) for black in shares) if _luminance(mix) < most)
    return color if to_hex(night) == to_hex(day) else f"light-dark({to_hex(day)}, {to_hex(night)})"


def _luminance(rgb: Float[np.ndarray, " 3"]) -> float:
    return float(rgb**2.2 @ (0.2126, 0.7152, 0.0722))


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


def look(element: ET.Element) -> dict[str, str]:
    """The attributes that say how an element is painted."""
    return {key: value for key, value in element.attrib.items() if re.match("fill|stroke|opacity", key)}


def color(swatch: ET.Element) -> str:
    """The first colour that a swatch is painted with."""
    looks = [value for element in swatch for key, value in element.attrib.items() if key in ("fill", "stroke")]
    return next((value for value in looks if value != "none"), "currentColor")


def bounds(box: Box) -> list[float]:
    """The left, top, width and height of a box, for an SVG's viewBox."""
    return [round(float(x), 2) for x in (*box[:2], *(box[2:] - box[:2]))]


def canvas(box: Box, content: Sequence[ET.Element], scale: float) -> ET.Element:
    """These elements as an SVG of that part of the figure."""
    left, top, width, height = bounds(box)
    size = {"width": f"{width * scale:.2f}", "height": f"{height * scale:.2f}"}
    canvas = ET.Element("svg", size | {"viewBox": f"{left} {top} {width} {height}"})
    canvas.extend(content)
    return canvas


def markup(element: ET.Element) -> Markup:
    """The element as text that needs no escaping in HTML."""
    return Markup(ET.tostring(element, encoding="unicode"))
