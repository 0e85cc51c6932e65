"""The report: an answer, claims, figures and how they were made, as one HTML file that needs nothing else."""

import base64
import dataclasses
import hashlib
import re
import urllib.parse
from collections.abc import Mapping, Sequence
from importlib import resources

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from galton.errors import require
from galton_experiments.analysis.plots import svg
from galton_experiments.analysis.verdicts import WORDS

VERDICTS = ("holds", "holds in part", "does not hold", "not decidable here")
MARKS = {"✓": "as the paper says", "✗": "clearly the contrary", "≈": WORDS["≈"], "∅": "null task", "?": WORDS["?"]}
"""The outcome for one unit of a claim (a task, a loss), by the mark that its line begins with."""
_COLORS = {"✓": 0, "✗": 2}
"""The verdict whose colour a mark has; the others are grey."""


@dataclasses.dataclass(frozen=True)
class Claim:
    """A sentence of the paper, and what became of it."""

    source: str
    """The place where the paper says it, such as "§5.2, Figure 3"."""
    words: str
    """The sentence that is judged."""
    test: str
    """The comparison that was made, in words."""
    number: str
    """The finding, as text that may have several lines: one for each unit, which begins with its mark."""
    verdict: str
    """The verdict on the claim: one of VERDICTS."""
    why: str
    """The grounds of the verdict, as text that may have several lines."""
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
    """The name of each column."""
    rows: Sequence[Sequence[str]]
    """As many cells as headings in each."""

    def __post_init__(self) -> None:
        for row in self.rows:
            fits = len(row) == len(self.headings)
            require(
                fits, f"rows has one of {len(row)} cells, {list(row)}; it must be {len(self.headings)}, as headings"
            )

    def is_numeric(self, column: int) -> bool:
        """Say whether a column's cells are numbers, to be set flush right; blanks and dashes are none, but allowed."""
        return all(re.match(r"[-−+±<>≤≥~≈ ]*\.?\d|[-—–]?$", row[column]) for row in self.rows)


@dataclasses.dataclass(frozen=True)
class Cell:
    """A cell of a matrix: what it says, and in which colour."""

    text: str
    """The words of the cell."""
    verdict: str | None = None
    """One of VERDICTS, whose sign and colour it has; None for neither."""

    def __post_init__(self) -> None:
        known = self.verdict is None or self.verdict in VERDICTS
        require(known, f"verdict is {self.verdict!r}; it must be None or one of {', '.join(VERDICTS)}")


@dataclasses.dataclass(frozen=True)
class Matrix:
    """A table of verdicts: each row and column has a name; a narrow screen has a card for each row, unless `narrow`."""

    corner: str
    """The heading of the column that names the rows."""
    columns: Sequence[str]
    """The name of each column."""
    rows: Mapping[str, Sequence[Cell]]
    """The cells of each row, by its name."""
    narrow: bool = False
    """True if it is a table on narrow screens too, since its cells are short."""
    heads: Mapping[str, tuple[str, str]] = dataclasses.field(default_factory=dict)
    """Title and text of a group of rows, by the name of its first row, above which they stand."""

    def __post_init__(self) -> None:
        for name, row in self.rows.items():
            fits = len(row) == len(self.columns)
            require(fits, f"rows has {name!r} with {len(row)} cells; it must be {len(self.columns)}, as columns")
        for name in self.heads:
            require(name in self.rows, f"heads has {name!r}; each must be one of rows, {', '.join(self.rows)}")


@dataclasses.dataclass(frozen=True)
class Answer:
    """The answer heads the page, for a reader who has a minute."""

    sentences: Sequence[str]
    """The first is the answer; the others follow in smaller type."""
    matrix: Matrix | None = None
    """The table beside them."""
    note: str = ""
    """The words below the matrix, which say what it shows."""
    figure: Figure | None = None
    """The figure below them."""
    caption: str = ""
    """The words below the figure, which say what it shows."""


@dataclasses.dataclass(frozen=True)
class Section:
    """A figure and all that belongs to it; everything but name and title may be left out."""

    name: str
    """The section's anchor: lower-case letters, digits and hyphens, a letter first."""
    title: str
    """The heading above the figure."""
    caption: str = ""
    """The words below the figure, which say what it shows."""
    figure: Figure | None = None
    """The figure, as matplotlib drew it."""
    table: Table | Matrix | None = None
    """The numbers below the figure."""
    paragraphs: Sequence[str] = ()
    """Sentences above the table."""
    is_first: bool = False
    """True if it stands before the claims."""

    def __post_init__(self) -> None:
        fits = re.fullmatch("[a-z][a-z0-9-]*", self.name) is not None
        require(
            fits, f"name is {self.name!r}; a section's must be lower-case letters, digits and hyphens, a letter first"
        )


def render(
    title: str,
    introduction: Sequence[str],
    claims: Sequence[Claim],
    sections: Sequence[Section],
    answer: Answer | None = None,
) -> str:
    """The page as HTML: the same for the same input.

    Args:
        title: the heading.
        introduction: paragraphs on how to read the claims.
        claims: what the paper says, with its verdicts.
        sections: those that stand before the claims, and those that stand after them.
        answer: the head of the page.

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
    figures = {section.name: section.figure for section in sections} | {ANSWER: answer.figure if answer else None}
    images = {name: _address(svg(figure)) for name, figure in figures.items() if figure is not None}
    style = _file("page.css")
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    environment.filters["together"] = _together
    return environment.from_string(_file("page.html.jinja")).render(
        title=title,
        introduction=introduction,
        answer=answer,
        answer_name=ANSWER,
        claims=claims,
        verdicts={verdict: sum(claim.verdict == verdict for claim in claims) for verdict in VERDICTS},
        order={verdict: i for i, verdict in enumerate(VERDICTS)},
        marks=MARKS,
        mark_colors={mark: _COLORS.get(mark, len(VERDICTS) - 1) for mark in MARKS},
        first=[section for section in sections if section.is_first],
        sections=[section for section in sections if not section.is_first],
        titles=titles,
        images=images,
        policy=f"default-src 'none'; img-src data:; style-src {_hash(style)}; base-uri 'none'; form-action 'none'",
        style=Markup(style),
    )


def _together(line: str) -> str:
    """The line with what belongs to a number kept on its line: "p = 0.01", "−1 ± 2"."""
    return re.sub(r" ([=<±]) ", "\u00a0\\1\u00a0", line)


ANSWER = "page.answer"
"""The id of the page's head, which no section can have."""


def _address(image: bytes) -> str:
    """An SVG as an address that holds it; letter for letter it is shorter than in base64."""
    return "data:image/svg+xml," + urllib.parse.quote(image, safe=" !$&'()*+,-./:;=?@_~")


def _file(name: str) -> str:
    return resources.files("galton_experiments.page").joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
