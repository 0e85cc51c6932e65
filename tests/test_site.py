"""The documentation site: it leaves out no public name, no registry's entry and no example, and it builds."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from galton.algorithms import ALGORITHMS
from galton.critics import CRITICS
from galton.losses import LOSSES
from galton.networks import NETWORKS
from galton.optimizers import OPTIMIZERS
from galton.parts import settings
from galton.policies import POLICIES

from .test_public import ROOT as SOURCE
from .test_public import STUBS, names

DOCS = Path(__file__).parents[1] / "docs"
REFERENCE = "\n".join(path.read_text() for path in sorted((DOCS / "api").glob("*.md")))
PAGES = "\n".join(path.read_text() for path in sorted(DOCS.rglob("*.md")))
FORM = ["When to use it", "The equation", "An example", "Measured results", "How to reproduce them", "Every parameter"]
SECTIONS = [("losses", loss) for loss in LOSSES.values()] + [("policies", policy) for policy in POLICIES.values()]
IN_LOSSES = (POLICIES["gaussian"], POLICIES["histogram"])
"""The policies whose likelihood is the equation of a loss's section."""
REGISTRIES = {
    "losses": [LOSSES],
    "policies": [POLICIES],
    "parts": [CRITICS, NETWORKS, OPTIMIZERS],
}
"""The pages that list every setting of the entries of registries."""
EXAMPLES = sorted((DOCS.parent / "examples").glob("*.py"))


def public():
    """Every public name by its dotted path, and what it is."""
    for stub in STUBS:
        module = ".".join(stub.parent.relative_to(SOURCE.parent).parts)
        for name in names(stub):
            yield f"{module}.{name}", getattr(importlib.import_module(module), name)


PUBLIC = dict(public())


def members():
    """The functions and classes of the public modules that have no stub, which are documented as a whole."""
    for module in filter(inspect.ismodule, PUBLIC.values()):
        for name, thing in vars(module).items():
            if not name.startswith("_") and getattr(thing, "__module__", None) == module.__name__:
                yield f"{module.__name__}.{name}", thing


DESCRIBED = {name: thing for name, thing in (PUBLIC | dict(members())).items() if not isinstance(thing, dict)}


def undocumented(thing):
    """The public functions, methods and properties of ours in a class or module that have no docstring."""
    for name, member in vars(thing).items():
        of_ours = isinstance(member, classmethod | property)
        of_ours = of_ours or (inspect.isfunction(member) and member.__name__ == name)  # and no field's default
        if of_ours and not name.startswith("_") and not inspect.getdoc(member):
            yield name


def bare_fields(record):
    """The fields that are annotated in the body of a class and have no string below them, there or in a base."""
    above = {name for base in record.__mro__[1:] for name in inspect.get_annotations(base)}
    body = ast.parse(textwrap.dedent(inspect.getsource(record))).body[0].body
    for node, following in zip(body, [*body[1:], None], strict=True):
        is_described = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
        if isinstance(node, ast.AnnAssign) and not is_described and node.target.id not in above:
            yield node.target.id


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_is_in_the_reference(name):
    kind = "automodule|`" if inspect.ismodule(PUBLIC[name]) else r"auto\w+|py:data"
    assert re.search(rf"({kind})(:: |){re.escape(name)}\b", REFERENCE), f"docs/api has no {name}"


@pytest.mark.parametrize("name", DESCRIBED)
def test_a_public_name_and_its_methods_are_described(name):
    thing = DESCRIBED[name]
    assert inspect.getdoc(thing)
    assert not inspect.isclass(thing) or not list(undocumented(thing))


@pytest.mark.parametrize("name", [name for name, thing in DESCRIBED.items() if inspect.isclass(thing)])
def test_every_field_of_a_public_record_is_described(name):
    assert list(bare_fields(DESCRIBED[name])) == []


@pytest.mark.parametrize("name", ALGORITHMS)
def test_the_page_of_an_algorithm_has_the_one_form(name):
    assert re.findall(r"^## (.+)$", (DOCS / f"{name}.md").read_text(), re.M) == FORM


@pytest.mark.parametrize(("page", "part"), SECTIONS, ids=lambda value: getattr(value, "__name__", value))
def test_a_loss_or_a_policy_has_a_section_with_its_equation_and_its_class(page, part):
    title = part.label.partition(" (")[0]
    sections = (DOCS / f"{page}.md").read_text().split("\n## ")
    (text,) = [section for section in sections if section.partition("\n")[0].lower() == title.lower()]
    assert f"`galton.{page}.{part.__name__}`" in text
    assert "$$\n" in text or part in IN_LOSSES


@pytest.mark.parametrize("page", REGISTRIES)
def test_every_setting_of_an_entry_is_on_the_page_of_its_kind(page):
    listed = set(" ".join(re.findall(r"^```{parameters} (.+)$", (DOCS / f"{page}.md").read_text(), re.M)).split())
    for registry in REGISTRIES[page]:
        for part in registry.values():
            assert set(settings(part)) <= listed, part


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_shown_on_a_page(example):
    assert f"examples/{example.name}\n:language: python" in PAGES


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_asks_for_nothing_from_elsewhere(tmp_path):
    pytest.importorskip("furo")
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "-q", "-b", "html"]
    done = subprocess.run([*command, "-d", tmp_path / "trees", DOCS, tmp_path / "site"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for page in (tmp_path / "site").rglob("*.html"):
        if "_downloads" not in page.parts:
            assert not re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="(?:https?:)?//', page.read_text()), page
