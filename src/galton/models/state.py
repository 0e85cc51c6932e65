"""A model stands in a run that can go on, or where the file left it that it was loaded from."""

import dataclasses
import warnings
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from galton.algorithms import Agent
from galton.envs.host.statistics import of_observations, statistics_in
from galton.envs.task import Task
from galton.errors import require
from galton.models import file
from galton.normalization import Moments
from galton.saving import checkpoint
from galton.training.population import Population, populate
from galton.training.programs import check_process
from galton.types import Learner, Params

Arrays = dict[str, np.ndarray]
"""The arrays that a file holds beside its settings, by path."""


def parameters_of(learner: Learner) -> Params:
    """The parameters, and under `normalizer` the statistics of a model that normalises; numpy arrays of their own."""
    told = learner.normalizer
    kept = {name: part._asdict() for name, part in told._asdict().items() if isinstance(part, Moments)}
    kept |= {"origin": told.origin} if told.observation else {}
    copies: Params = jax.tree.map(np.array, learner.params | ({"normalizer": kept} if kept else {}))
    return copies


@dataclasses.dataclass(frozen=True)
class Loaded:
    """A model that was loaded without an environment: it predicts, and is what its file was."""

    env_name: str
    step: int
    learner: Learner
    arrays: Arrays
    task: None = None

    @property
    def statistics(self) -> list[dict[str, Any]]:
        """The statistics by which wrappers normalised the observations of each copy, as far as the file has them."""
        return statistics_in(self.arrays)


class Run:
    """A model with an environment: a population of one, which raises what `populate` does."""

    def __init__(self, task: Task, agent: Agent, seed: int) -> None:
        self.task = task
        self.population: Population = populate(task, agent, [seed])
        self._learner: Learner | None = None

    @property
    def env_name(self) -> str:
        """The name that messages and files have for the environment."""
        return self.task.name

    @property
    def step(self) -> int:
        """The environment steps that the run has taken, all copies together."""
        return self.population.step

    @property
    def learner(self) -> Learner:
        """All that was learnt, without the axis of runs."""
        if self._learner is None:
            self._learner = jax.tree.map(lambda x: jnp.asarray(x[0]), self.population.learner)
        return self._learner

    @property
    def statistics(self) -> list[dict[str, Any]]:
        """The statistics by which wrappers normalise the observations of each copy; none in JAX."""
        envs = self.population.environments
        return [of_observations(layers) for layers in envs.layers] if envs else []

    @property
    def arrays(self) -> Arrays:
        """All that a file needs to go on exactly."""
        return checkpoint.flatten(self.population.snapshot())

    def advance(self, n_updates: int) -> None:
        """Train for so many updates; UsageError in a process that was forked from the one that made the run."""
        check_process()
        self._learner = None
        self.population.advance(n_updates)

    def resume(self, path: Path, arrays: Arrays) -> tuple[str, str]:
        """Go on where the arrays of a file are; what `file.resume` tells."""
        self._learner = None
        try:
            return file.resume(path, self.population, arrays)
        except BaseException:
            self.close()
            raise

    def set_parameters(self, parameters: Params) -> None:
        """Go on with other parameters; UsageError unless they are finite and have the names and shapes of these."""
        require(isinstance(parameters, dict), f"parameters is {parameters!r:.80}; give what get_parameters returns")
        whole = parameters_of(self.learner)
        if "normalizer" in whole and "normalizer" not in parameters:
            warnings.warn(
                "parameters has no normalizer, the statistics that its networks' inputs were normalised with, so the "
                "model keeps its own; give what get_parameters of the model they come from returns",
                stacklevel=3,
            )
            parameters = parameters | {"normalizer": whole["normalizer"]}
        own, given = (dict(jax.tree.leaves_with_path(tree)) for tree in (whole, parameters))
        differ = [jax.tree_util.keystr(path) for path in own.keys() ^ given.keys()]
        require(not differ, f"parameters differ from the model's own in {', '.join(sorted(differ))}")
        for path, array in own.items():
            other, name = np.asarray(given[path]), f"parameters{jax.tree_util.keystr(path)}"
            require(other.shape == array.shape, f"{name} has shape {other.shape}; it must be {array.shape}")
            with np.errstate(over="ignore"):
                finite = other.dtype.kind in "fiu" and bool(np.isfinite(other.astype(array.dtype)).all())
            require(finite, f"{name} is not all finite numbers of {array.dtype}")
            counts = name.startswith("parameters['normalizer']") and name.endswith(("['variance']", "['n']"))
            negative = counts and bool((other < 0).any())
            require(not negative, f"{name} is negative in part; it must be 0 or more")
        params = jax.tree.map(lambda array, other: np.asarray(other, array.dtype), whole, parameters)
        told = params.pop("normalizer", {}).items()
        statistics = {name: Moments(**part) if isinstance(part, dict) else part for name, part in told}
        learner = self.learner._replace(params=params, normalizer=self.learner.normalizer._replace(**statistics))
        self.population.put(jax.tree.map(lambda x: np.asarray(x)[None], learner))
        self._learner = None

    def close(self) -> None:
        """Let go of the environments that the model made."""
        self.population.close()
