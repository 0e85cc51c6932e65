"""Docstrings in Google's style for autodoc.

This is napoleon, but that it takes what stands before a colon in the docstring of a field for the field's type.
"""

from collections.abc import Mapping

from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config, GoogleDocstring

STYLE = Config(napoleon_use_rtype=False)
FIELDS = ("attribute", "data", "property")


def process(app: Sphinx, what: str, name: str, thing: object, options: Mapping[str, object], lines: list[str]) -> None:
    """Turn the lines of a docstring into reStructuredText, in place."""
    what = "" if what in FIELDS else what
    lines[:] = GoogleDocstring(lines, STYLE, app, what, name, thing, options).lines()


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen to autodoc."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", process)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
