"""The report: claims, figures and how they were made, as one HTML file that needs nothing else."""

import base64
import dataclasses
import hashlib
import re
from collections.abc import Sequence
from importlib import resources

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from galton.errors import require
from galton.page.drawing import draw

VERDICTS = ("holds", "holds in part", "does not hold", "not decidable here")
MARKS = {
    "✓": "as the paper says",
    "✗": "clearly the contrary",
    "≈": "no clear difference",
    "∅": "null task",
    "?": "too few runs",
}
"""What became of one unit of a claim (a task, a loss), by the mark that its line begins with."""


@dataclasses.dataclass(frozen=True)
class Claim:
    """A sentence of the paper, and what became of it."""

    source: str
    """Where the paper says it, such as "§5.2, Figure 3"."""
    words: str
    test: str
    """What was compared with what."""
    number: str
    """What was found, as text that may have several lines: one for each unit, which begins with its mark."""
    verdict: str
    """What became of the claim: one of VERDICTS."""
    why: str
    """What the verdict rests on, as text that may have several lines."""
    section: str | None = None
    """The name of the section whose figure it rests on."""
    count: tuple[int, int] | None = None
    """Of how many units that can be decided (tasks, losses) how many are as it says, (k, n); None where none can."""

    def __post_init__(self) -> None:
        require(self.verdict in VERDICTS, f"verdict is {self.verdict!r}; it must be one of {', '.join(VERDICTS)}")
        k, n = self.count or (0, 1)
        require(0 <= k <= n and n > 0, f"count is {self.count}; it must be k of n, with 0 ≤ k ≤ n and n at least 1")


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of texts, each cell as it is shown."""

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
    """The section's anchor: lower-case letters, digits and hyphens, a letter first."""
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
    drawings = {section.name: draw(section.name, section.figure) for section in sections if section.figure is not None}
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
    return resources.files("galton.page").joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
