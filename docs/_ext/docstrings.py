"""Docstrings in Google's style for autodoc, and types as their source has them.

Napoleon alone would take what stands before a colon in the docstring of a field for the field's type.
"""

import inspect
import re
import typing
from collections.abc import Mapping

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config, GoogleDocstring

from galton.fields import annotations
from galton.parts import Part
from galton_experiments import sweep

STYLE = Config(napoleon_use_rtype=False)
FIELDS = ("attribute", "data", "property")


def process(app: Sphinx, what: str, name: str, thing: object, options: Mapping[str, object], lines: list[str]) -> None:
    """Turn the lines of a docstring into reStructuredText, in place."""
    what = "" if what in FIELDS else what
    lines[:] = GoogleDocstring(lines, STYLE, app, what, name, thing, options).lines()


def drop_bounds(records: list[type]) -> None:
    """Let the fields of records show their types without the bounds that are checked, which the tables tell."""
    for record in records:
        annotations(record)  # which checking goes on to use
    for record in records:
        plain = typing.get_type_hints(record)
        record.__annotations__ = {name: plain[name] for name in inspect.get_annotations(record)}
        constructor = record.__init__ if "__init__" in vars(record) else record.__new__
        constructor.__annotations__ = plain


def kinds(part: type) -> list[type]:
    """All that inherit from a class, as far as they have been imported."""
    return [kind for own in part.__subclasses__() for kind in (own, *kinds(own))]


def shorten(app: Sphinx, doctree: nodes.document) -> None:
    """Call JAX's arrays by their public name."""
    del app
    for signature in doctree.findall(addnodes.desc_signature):
        for text in list(signature.findall(nodes.Text)):
            short = re.sub(r"jaxlib\._jax\.|~(?=\w)", "", str(text))
            if short != str(text):
                text.parent.replace(text, nodes.Text(short))


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen to autodoc."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", process)
    app.connect("doctree-read", shorten)
    drop_bounds([sweep.Study, *kinds(Part)])
    return {"parallel_read_safe": True, "parallel_write_safe": True}
