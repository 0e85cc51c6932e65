"""What the documents name is there."""

import pkgutil
import re
from pathlib import Path

import pytest

import galton

ROOT = Path(__file__).parents[1]
SOURCE = Path(galton.__file__).parent
ROWS = [line.split("|")[1:4] for line in (ROOT / "docs" / "paper.md").read_text().splitlines() if line.count("|") == 4]
EQUATIONS = [row for row in ROWS if row[0].strip()[:2] in ("§2", "§4", "§5", "eq", "Ap")]
LINKS = [
    (document, target)
    for document in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", document.read_text())
]


def check_is_there(name):
    """Find the module or function of a dotted name, or the file of a path."""
    if "/" in name:
        assert (SOURCE / name).exists() or (ROOT / name).exists(), f"{name} does not exist"
    else:
        pkgutil.resolve_name(f"galton.{name.removeprefix('galton.')}")


@pytest.mark.parametrize(("equation", "functions", "tests"), EQUATIONS)
def test_an_equation_is_where_the_page_says(equation, functions, tests):
    names = re.findall(r"`([\w./]+)`", functions) + re.findall(r"`(tests/[\w./]+)`", tests)
    assert len(names) >= 2
    for name in names:
        check_is_there(name)


def test_the_page_of_equations_is_read():
    assert len(EQUATIONS) > 15


@pytest.mark.parametrize(
    ("document", "target"), LINKS, ids=lambda value: value if isinstance(value, str) else value.stem
)
def test_a_link_between_documents_leads_somewhere(document, target):
    assert (document.parent / target).exists()
