"""Modules that a command imports, and who named them.

The current folder is searched for what the command line names, and for nothing else: what a file names, such as the
plan of a sweep, may be a stranger's. Such a module must be installed, lie on PYTHONPATH, or be typed as well.
"""

import sys
from collections.abc import Sequence
from typing import Annotated

import tyro

from galton.extras import import_all

Imports = Annotated[
    tuple[str, ...],
    tyro.conf.arg(help="Modules to import first, where losses, policies and other parts of your own are registered."),
]
"""The option of the commands that need what a user has registered."""


def search_here() -> None:
    """Have this process and its workers search the current folder, behind all that is installed."""
    if "" not in sys.path:
        sys.path.append("")


def import_typed(modules: Sequence[str]) -> None:
    """Import modules that the command line names; UsageError for one that can't be."""
    if modules:
        search_here()
        import_all(modules)
