"""How Sphinx makes the site of the Markdown in this folder: `make docs`. Nothing in it needs a network."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]
os.environ.setdefault("JAX_PLATFORMS", "cpu")

from galton.version import __version__  # noqa: E402, after the platform of JAX is chosen

project = "Galton"
author = "The Galton developers"
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "docstrings", "from_code", "mathml"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
exclude_patterns = ["_ext"]
default_role = "py:obj"  # `names` in docstrings

add_module_names = False
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80
toc_object_entries = False

highlight_language = "none"
html_theme = "furo"
html_title = f"Galton {version}"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["galton.css"]
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
pygments_style, pygments_dark_style = "friendly", "github-dark"
