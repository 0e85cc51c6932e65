"""galton check: what Galton makes of an environment."""

import dataclasses
import sys
from collections.abc import Sequence
from typing import Annotated

import tyro

from galton.cli._options import EnvName
from galton.cli._reading import read_options, search_here
from galton.envs.registry import read_constants
from galton.training.check import check_env


@dataclasses.dataclass(frozen=True)
class Options:
    """Play on an environment for a few seconds and say what Galton makes of it, and what to do about what is amiss.

    The exit code is 0 if it can be trained on, and else 1.
    """

    env: EnvName
    env_kwargs: Annotated[str, tyro.conf.arg(metavar="JSON")] = "{}"
    """Keyword arguments of the environment, such as '{"noise_std": 0.5}'."""


def main(arguments: Sequence[str]) -> None:
    """Print the findings, each with its remedy."""
    options = read_options(Options, "check", arguments)
    if ":" in options.env:
        search_here()
    check = check_env(options.env, read_constants(options.env_kwargs))
    print(check)
    print("it can be trained on" if check.ok else "it can't be trained on as it is")
    sys.exit(0 if check.ok else 1)
