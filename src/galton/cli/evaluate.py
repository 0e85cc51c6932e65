"""galton evaluate: what a trained policy earns."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from scipy import stats

from galton.cli._reading import Imports, import_typed, read_options
from galton.cli._runs import environment_of, model_of
from galton.decimals import fitting
from galton.errors import require_integer
from galton.models import Model


@dataclasses.dataclass(frozen=True)
class Options:
    """Play episodes of a trained policy without exploration, and print their returns, the mean and its 95% interval."""

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """A run folder of `galton train`, whose model.safetensors is taken, or the file of a model."""
    env: str | None = None
    """The environment to play on; by default the run's. An id with a module must be given, for it runs code."""
    env_kwargs: Annotated[str | None, tyro.conf.arg(metavar="JSON")] = None
    """Keyword arguments of the environment; by default the run's."""
    imports: Imports = ()
    episodes: int = 100
    """The number of episodes to play, side by side. The model's seed and its steps decide on them."""


def main(arguments: Sequence[str]) -> None:
    """Play the episodes and print what they returned."""
    options = read_options(Options, "evaluate", arguments)
    import_typed(options.imports)
    require_integer("episodes", options.episodes, 2)
    file = model_of(options.run)
    model = Model.load(file)
    returns = model.evaluate(options.episodes, *environment_of(file, options.env, options.env_kwargs))
    mean, error = returns.mean(), stats.sem(returns)
    low, high = mean + error * np.array(stats.t.interval(0.95, len(returns) - 1))
    form = fitting(*returns)
    print("returns", ", ".join(f"{value:{form}}" for value in returns))
    print(f"mean {mean:{form}}, 95% interval [{low:{form}}, {high:{form}}], standard deviation {returns.std():{form}}")
    print(f"{len(returns):,} episodes of {file}, without exploration")
