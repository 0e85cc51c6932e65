"""Where tables and progress are drawn."""

from rich.console import Console


def plain_console() -> Console:
    """A console that prints what it is given, letter by letter: a path may hold what rich takes for markup."""
    return Console(markup=False, emoji=False, highlight=False)
