"""galton sweep: a grid of settings × trials, planned on disk and carried out by workers that may die."""

from collections.abc import Sequence

from galton.cli._words import run_command

SMALLER = ("status", "results", "shard", "rerun")
"""The commands that work on a sweep which was planned; like `run`, each is a module here."""


def main(arguments: Sequence[str]) -> None:
    """Plan a sweep and train it, or do what one of the smaller commands does."""
    smaller = bool(arguments) and arguments[0] in SMALLER
    name, rest = (arguments[0], arguments[1:]) if smaller else ("run", arguments)
    run_command(f"{__name__}.{name}", rest)
