"""One run with the habits of Stable-Baselines3: learn, predict, evaluate, save, load."""

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, Unpack

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from galton.algorithms import Agent, find_algorithm, resolve
from galton.envs.base import Environment
from galton.envs.find import find
from galton.envs.host.action_box import ActionBox
from galton.envs.host.base import HostTask, Space
from galton.envs.host.observations import Observations
from galton.errors import require, require_integer
from galton.models import file
from galton.models.acting import exploit, explore, returns_on
from galton.models.environment import check_copies, check_same_spaces, spaces_of, usual_copies
from galton.models.learning import check_divergence, learn
from galton.models.settings import Settings, check_one_run, split
from galton.training.population import Population, populate
from galton.training.train import check_seed
from galton.types import Config, Hypers, Learner

ModelT = TypeVar("ModelT", bound="Model")


class Model:
    """An actor-critic on one environment; A2C and PPO are this class with their algorithm.

    What trains here is the same code that trains populations.

    Args:
        env: a Gymnasium id (`module:Id` imports the module first), a Gymnasium `Env` or `VectorEnv`, an SB3 `VecEnv`,
            a function that makes an environment, a name in `galton.envs.ENVS`, or a record of your own in pure JAX.
        loss: a key of LOSSES.
        algorithm: a key of ALGORITHMS.
        n_envs: copies of the environment; None for one, or for as many as a vector environment has.
        seed: of everything random; the same seed gives the same run.
        env_kwargs: keyword arguments for an id or a name.
        settings: the other fields of `Config` and `Hypers`, which describe them. Their defaults are the algorithm's,
            and for a task of the paper that is called by its name, those of App. C.2, as on the command line: "bandit"
            has a linear network and, for A2C, 5 steps an update and a learning rate of 0.05.

    Raises:
        UsageError: an argument out of range, or an environment that can't be used, with what to do about it.
        BrokenEnvironmentError: an environment that breaks in its first reset.
    """

    def __init__(
        self,
        env: object,
        loss: str = "hl-gauss",
        *,
        algorithm: str = "a2c",
        n_envs: int | None = None,
        seed: int = 0,
        env_kwargs: Mapping[str, object] | None = None,
        **settings: Unpack[Settings],
    ) -> None:
        task = find(env, **(env_kwargs or {}))
        n_copies = usual_copies(task) if n_envs is None else n_envs
        self._begin(task, *split(find_algorithm(algorithm), loss, n_copies, dict(settings), env), seed)

    @classmethod
    def of(cls: type[ModelT], env: object, config: Config, hypers: Hypers, seed: int = 0) -> ModelT:
        """A model with these records in the place of keyword arguments; it raises what the constructor does."""
        model = cls.__new__(cls)
        model._begin(find(env), config, hypers, seed)
        return model

    def _begin(self, task: Environment | HostTask, config: Config, hypers: Hypers, seed: int) -> None:
        check_copies(task, config.n_envs)
        self._describe(config, hypers, seed, *spaces_of(task))
        self._connect(task)

    def _describe(
        self, config: Config, hypers: Hypers, seed: int, actions: ActionBox, observations: Observations
    ) -> None:
        """Become the model of these settings, without an environment yet."""
        check_seed(seed)
        check_one_run(hypers)
        self.config, self.hypers, self.seed = config, hypers, seed
        self.agent: Agent = resolve(config, actions.low, actions.high)
        self.actions, self.observations = actions, observations
        self._n_predictions = 0  # each batch of sampled actions has a key of its own
        self._population: Population | None = None
        self._env: Environment | HostTask | None = None
        self._learner: Learner | None = None
        self._interval, self._steps_at_load = self.agent.algorithm.log_interval, 0

    def _connect(self, task: Environment | HostTask) -> None:
        """Begin a run of this model on an environment."""
        self._env = task
        hypers = Hypers._make(np.full(1, value, np.float32) for value in self.hypers)
        self._population = populate(task, self.config, hypers, [self.seed])

    @property
    def env(self) -> Environment | HostTask | None:
        """The environment; None for a model that was loaded without one."""
        return self._env

    @property
    def env_name(self) -> str:
        """What messages and files call the environment."""
        return str(getattr(self._env, "name", None) or type(self._env).__name__)

    @property
    def action_space(self) -> gymnasium.spaces.Box:
        """The actions as Gymnasium describes them."""
        return self.actions.space

    @property
    def observation_space(self) -> Space:
        """The observations as Gymnasium describes them."""
        return self.observations.space

    @property
    def num_timesteps(self) -> int:
        """How many environment steps the run has taken, all copies together."""
        return self._population.step if self._population else self._steps_at_load

    @property
    def log_interval(self) -> int:
        """How many environment steps lie between two log points, all copies together."""
        return self.updates_per_log * self.config.n_steps * self.config.n_envs

    @property
    def updates_per_log(self) -> int:
        """How many updates lie between two log points, as `learn` was last told."""
        return self._interval

    @property
    def learner(self) -> Learner:
        """What was learnt: parameters, Adam's moments and the statistics that normalise."""
        if self._learner is None:
            self._learner = jax.tree.map(lambda x: jnp.asarray(x[0]), self.population.learner)
        return self._learner

    @property
    def population(self) -> Population:
        """The one run, as training sees it; UsageError for a model without an environment."""
        require(
            self._population is not None,
            f"the model was loaded without an environment; give it one: {type(self).__name__}.load(path, env=...)",
        )
        assert self._population
        return self._population

    def learn(
        self: ModelT,
        total_timesteps: int,
        callback: object = None,
        progress_bar: bool = True,
        log_interval: int | None = None,
    ) -> ModelT:
        """Train for that many more steps, rounded up to whole updates.

        Every `log_interval` updates, counted from the start of the run, the callbacks are called with the model and
        the log. The logs do not depend on how training is cut into calls of `learn`.

        Args:
            total_timesteps: steps of the environment, all copies together.
            callback: from `galton.callbacks`, a function `(model, log) -> bool | None` of your own (False stops), an
                SB3 callback, or several of them.
            progress_bar: show how far training is.
            log_interval: updates between log points, by default 100 for A2C and 1 for PPO, as in SB3; a run that is
                resumed keeps the logs only if it stays the same.

        Raises:
            UsageError: a number out of range, or a model without an environment.
            BrokenEnvironmentError: an environment broke; the model keeps what it learnt up to the last update.
            DivergenceError: a gradient was not finite; the model keeps the parameters before it.
        """
        log_interval = self.agent.algorithm.log_interval if log_interval is None else log_interval
        require_integer("total_timesteps", total_timesteps, 1)
        require_integer("log_interval", log_interval, 1)
        n_updates = math.ceil(total_timesteps / (size := self.config.n_steps * self.config.n_envs))
        first = self.population.step
        require(first + n_updates * size < 2**31, f"total_timesteps is {total_timesteps}; one run counts to 2³¹ − 1")
        self._interval = log_interval
        learn(self, n_updates, callback, progress_bar)
        return self

    def advance(self, n_updates: int) -> None:
        """Train for so many updates; no callback is called and nothing is logged.

        Raises:
            BrokenEnvironmentError, DivergenceError: as `learn`.
        """
        self._learner = None
        self.population.advance(n_updates)
        check_divergence(self.population)

    def predict(
        self, observation: object, state: object = None, episode_start: object = None, deterministic: bool = False
    ) -> tuple[np.ndarray, Any]:
        """The action for one observation, or the actions for a batch of them, within the bounds of the action space.

        `state` and `episode_start` are for the interface: the policy has no memory, and state comes back as it went in.

        Raises:
            UsageError: an observation that the space can't hold.
        """
        del episode_start
        rows, single = self.observations.rows(observation)
        if deterministic:
            action = exploit(self.agent, self.learner, self.hypers, rows)
        else:
            action = explore(self.agent, self.learner, self.hypers, rows, self.seed, self._n_predictions)
            self._n_predictions += 1
        actions = self.actions.to_env(action)
        return (actions[0, ...] if single else actions), state

    def evaluate(self, n_episodes: int = 10, env: object = None) -> Float[np.ndarray, " n_episodes"]:
        """Undiscounted returns of whole episodes without exploration; training is not touched by it.

        Args:
            n_episodes: how many, side by side on copies of the environment.
            env: another environment to play them on, as in the constructor.

        Raises:
            UsageError: an environment of which only one copy was given.
        """
        require_integer("n_episodes", n_episodes, 1)
        if env is None:
            return self.population.evaluate(n_episodes)[0]
        task = find(env)
        check_same_spaces(task, self.actions, self.observations)
        return returns_on(task, self.agent, self.learner, self.hypers, n_episodes, self.seed, self.num_timesteps)

    def save(self, path: str | Path) -> Path:
        """Write the model to one file and return its path; `.safetensors` is added to a name without a suffix.

        It holds all that `load` needs to go on exactly. Loading it runs no code.
        """
        model = file.ModelFile(
            self.env_name,
            self.config,
            self.hypers,
            self.seed,
            self.num_timesteps,
            self.updates_per_log,
            self._n_predictions,
            self.actions,
            self.observations,
        )
        return file.save(Path(path), model, self.population.snapshot())

    @classmethod
    def load(
        cls: type[ModelT], path: str | Path, env: object = None, env_kwargs: Mapping[str, object] | None = None
    ) -> ModelT:
        """The model of a file. Without an environment it predicts; with the one that it was trained on it goes on.

        Raises:
            UsageError: no such file, a model of another algorithm, or an environment with other spaces.
            CheckpointError: a file that is damaged or not a model.

        Warns:
            InexactResume: the file has no states of the environments, so their episodes start anew.
        """
        path = file.existing(Path(path))
        found, arrays = file.read(path)
        fits = cls.__name__ in ("Model", found.label)
        require(fits, f"path is {path}, which holds a model of {found.label}; load it with galton.{found.label}.load")
        model = cls.__new__(cls)
        model._describe(found.config, found.hypers, found.seed, found.actions, found.observations)
        model._learner = file.learner_of(path, model.agent, found, arrays)
        model._steps_at_load, model._interval = found.step, found.log_interval
        model._n_predictions = found.n_predictions
        if env is None:
            require(not env_kwargs, f"env_kwargs is {env_kwargs}; give env with it")
            return model
        task = find(env, **(env_kwargs or {}))
        check_same_spaces(task, model.actions, model.observations)
        model._connect(task)
        try:
            cause = file.resume(path, model.population, arrays)
        except BaseException:
            model.close()
            raise
        model._learner = None
        if cause:
            message = f"{model.env_name} goes on from the start of new episodes: {cause}"
            warnings.warn(message, file.InexactResume, stacklevel=2)
        return model

    def close(self) -> None:
        """Let go of the environments that the model made."""
        if self._population:
            self._population.close()
