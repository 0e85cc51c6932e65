"""Shapes and types are checked at every call of every galton function."""

from jaxtyping import install_import_hook

install_import_hook("galton", "beartype.beartype")

import galton  # noqa: E402

galton.use_all_cores()
