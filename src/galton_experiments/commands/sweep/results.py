"""galton sweep results: the table of all runs that are done, and the best settings."""

from collections.abc import Sequence

from galton.cli._reading import read_options
from galton_experiments.commands.sweep._folder import Folder as Options
from galton_experiments.commands.sweep._folder import conclude, load
from galton_experiments.sweep.store import Store


def main(arguments: Sequence[str]) -> None:
    """Write results.parquet from the shards that are there, and show the best settings."""
    options = read_options(Options, "sweep results", arguments)
    store = Store(options.out)
    conclude(store, load(store, options.imports))
