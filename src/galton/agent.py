"""One run with the habits of Stable-Baselines3: learn, predict, save, load."""

import functools
import math
import time
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from rich.progress import Progress

from galton import normalization, sb3
from galton.algorithms import a2c
from galton.callbacks import Callback
from galton.envs.base import Environment, HostTask
from galton.envs.find import find
from galton.envs.spaces import ActionBox, Observations, from_json, to_json
from galton.errors import CheckpointError, DivergenceError, require, require_integer
from galton.policies import Policy
from galton.saving import checkpoint
from galton.saving import model_file as saved
from galton.training.evaluate import deterministic_action, evaluate, play
from galton.training.populate import populate
from galton.training.population import Population
from galton.training.train import check_seed
from galton.types import Config, Hypers, Learner, check_hypers

LAYOUT = 100
"""Updates for which programs are laid out: always the same, so that a run which is resumed keeps its bits."""

Deterministic = Literal["mode", "mean", "median"]


class InexactResume(UserWarning):
    """A loaded run goes on from the start of new episodes, because its environments can't tell their states."""


class A2C:
    """Advantage actor-critic on one environment.

    The algorithm is `galton.algorithms.a2c`, the same code that trains populations.

    Args:
        env: a Gymnasium id (`module:Id` imports the module first), a Gymnasium `Env` or `VectorEnv`, an SB3 `VecEnv`,
            a function that makes an environment, a name in `galton.envs.ENVS`, or a record of your own in pure JAX.
        loss: a key of LOSSES.
        learning_rate: Adam's step size.
        n_bins: bins per action dimension, k (§4.1); the Gaussian has none.
        eta: HL-Gauss's width σ / bin width (§4.2).
        n_steps: steps per environment and update.
        n_envs: copies of the environment; None for one, or for as many as a vector environment has.
        gamma: discount.
        gae_lambda: λ of GAE; 1 gives n-step returns.
        ent_coef: weight of the entropy bonus.
        vf_coef: weight of the critic's loss.
        max_grad_norm: the gradient is scaled down to this norm.
        net_arch: units of the hidden tanh layers, the same for actor and critic.
        normalize_observation: standardise observations by running statistics.
        normalize_reward: divide rewards by the standard deviation of the discounted return.
        normalize_advantage: standardise the advantages of each batch.
        initial_policy: how a softmax policy starts, "uniform" or "gaussian" (§5.2.3).
        exploration: what a softmax policy samples from, "softmax" or "gaussian" (§5.2.3).
        bin_sample: which action of a bin is taken, "center" (§4.1) or "uniform" (footnote 3).
        deterministic_action: of a softmax policy, "mode", "mean" or "median".
        seed: of everything random; the same seed gives the same run.
        env_kwargs: keyword arguments for an id or a name.

    Raises:
        UsageError: an argument out of range, or an environment that can't be used, with what to do about it.
        BrokenEnvironmentError: an environment that breaks in its first reset.
    """

    def __init__(
        self,
        env: Any,
        loss: str = "hl-gauss",
        *,
        learning_rate: float = 7e-4,
        n_bins: int = 100,
        eta: float = 0.25,
        n_steps: int = 20,
        n_envs: int | None = None,
        gamma: float = 0.99,
        gae_lambda: float = 1.0,
        ent_coef: float = 0.0,
        vf_coef: float = 0.5,
        max_grad_norm: float = 0.5,
        net_arch: Iterable[int] = (64, 64),
        normalize_observation: bool = False,
        normalize_reward: bool = False,
        normalize_advantage: bool = False,
        initial_policy: Literal["uniform", "gaussian"] = "uniform",
        exploration: Literal["softmax", "gaussian"] = "softmax",
        bin_sample: Literal["center", "uniform"] = "center",
        deterministic_action: Deterministic = "mode",
        seed: int = 0,
        env_kwargs: dict[str, Any] | None = None,
    ) -> None:
        require(isinstance(loss, str), f"loss is {loss!r}; it must be a key of LOSSES")
        require(isinstance(net_arch, Iterable), f"net_arch is {net_arch!r}; give numbers of units, such as (64, 64)")
        task = find(env, **(env_kwargs or {}))
        given = None if isinstance(task, Environment) else task.given
        config = Config(
            loss=loss,
            n_bins=n_bins,
            n_steps=n_steps,
            n_envs=(given or 1) if n_envs is None else n_envs,
            net_arch=tuple(net_arch),
            initial_policy=initial_policy,
            exploration=exploration,
            bin_sample=bin_sample,
            deterministic_action=deterministic_action,
            normalize_advantage=normalize_advantage,
            normalize_observation=normalize_observation,
            normalize_reward=normalize_reward,
        )
        hypers = Hypers(learning_rate, eta, gamma, gae_lambda, vf_coef, ent_coef, max_grad_norm)
        require(
            given is None or config.n_envs == given,
            f"n_envs is {config.n_envs}, but {'one environment was' if given == 1 else f'{given} were'} given; "
            "leave n_envs out, or give an id or a function that makes the environment",
        )
        self._describe(config, hypers, seed, *_spaces(task))
        self._connect(task)

    def _describe(
        self, config: Config, hypers: Hypers, seed: int, actions: ActionBox, observations: Observations
    ) -> None:
        """All but the environment."""
        for name, value in hypers._asdict().items():
            require(np.ndim(value) == 0, f"{name} is {value}; A2C is one run: give one number (train takes many)")
            require(np.asarray(value).dtype.kind in "fiu", f"{name} is {value!r}; it must be a number")
        check_hypers(hypers)
        check_seed(seed)
        self.config, self.hypers, self.seed = config, hypers, seed
        self._actions, self._observations = actions, observations
        self._policy = a2c.make_policy(config, actions.low, actions.high)
        self._population: Population | None = None
        self._env: Environment | HostTask | None = None
        self._learner: Learner | None = None
        self._n_predictions = 0
        self._interval = LAYOUT
        self._steps_at_load = 0

    def _connect(self, task: Environment | HostTask) -> None:
        self._env = task
        hypers = Hypers._make(np.full(1, value, np.float32) for value in self.hypers)
        self._population = populate(task, self.config, hypers, [self.seed], LAYOUT)

    @property
    def env(self) -> Environment | HostTask | None:
        """The environment; None for a model that was loaded without one."""
        return self._env

    @property
    def action_space(self) -> gymnasium.spaces.Box:
        """Gymnasium's."""
        space: gymnasium.spaces.Box = self._actions.space
        return space

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """Gymnasium's."""
        return self._observations.space

    @property
    def num_timesteps(self) -> int:
        """Environment steps so far, of all copies together."""
        return self._population.step if self._population else self._steps_at_load

    @property
    def log_interval(self) -> int:
        """Environment steps between log points."""
        return self._interval * self.config.n_steps * self.config.n_envs

    @property
    def learner(self) -> Learner:
        """What was learnt: parameters, Adam's moments and the statistics that normalise."""
        if self._learner is None:
            assert self._population
            self._learner = jax.tree.map(lambda x: jnp.asarray(x[0]), self._population.learner)
        return self._learner

    def learn(
        self,
        total_timesteps: int,
        callback: Callback | Any | Iterable[Callback | Any] | None = None,
        progress_bar: bool = True,
        log_interval: int = 100,
    ) -> "A2C":
        """Train for that many more steps, rounded up to whole updates.

        Every `log_interval` updates, counted from the start of the run, the callbacks are called with the model and
        the log. The logs do not depend on how training is cut into calls of `learn`.

        Args:
            total_timesteps: steps of the environment, all copies together.
            callback: from `galton.callbacks`, a function `(model, log) -> bool | None` of your own (False stops), an
                SB3 callback, or several of them.
            progress_bar: show one.
            log_interval: updates between log points; a run that is resumed keeps the logs only if it stays the same.

        Raises:
            UsageError: a number out of range, or a model without an environment.
            BrokenEnvironmentError: an environment broke; the model keeps what it learnt up to the last update.
            DivergenceError: a gradient was not finite; the model keeps the parameters before it.
        """
        require_integer("total_timesteps", total_timesteps, 1)
        require_integer("log_interval", log_interval, 1)
        population = self._connected()
        self._interval = log_interval
        size = self.config.n_steps * self.config.n_envs
        first, last = population.step, population.step + math.ceil(total_timesteps / size) * size
        require(last < 2**31, f"total_timesteps is {total_timesteps}; one run counts up to 2³¹ − 1 steps")
        given: list[Any] = (
            [] if callback is None else list(callback) if isinstance(callback, list | tuple) else [callback]
        )
        theirs = sb3.Callbacks(self, [one for one in given if sb3.is_callback(one)], last - first)
        ours = [one for one in given if not sb3.is_callback(one)]
        for one in ours:
            require(callable(one), f"callback is {one!r}; it must be callable as callback(model, log)")

        start, going = time.perf_counter(), theirs.start()
        with Progress(disable=not progress_bar, transient=True) as progress:
            bar = progress.add_task(f"{self.config.loss}", total=last - first)
            while going and population.step < last:
                to_log = log_interval - population.step // size % log_interval
                n = min(to_log, (last - population.step) // size, 1 if theirs else to_log)
                self._learner = None
                population.advance(n)
                self._check_divergence(population)
                going = theirs.after_update()
                if n == to_log:
                    seconds = time.perf_counter() - start
                    log = self._log(population, seconds, (population.step - first) / seconds)
                    verdicts = [one(self, log) for one in ours]
                    going = going and all(verdict is not False for verdict in verdicts)
                progress.update(bar, completed=population.step - first)
        theirs.end()
        return self

    def _log(self, population: Population, seconds: float, speed: float) -> dict[str, float]:
        """The log under SB3's names, where it has one."""
        log = {name: float(value[0]) for name, value in population.log()._asdict().items()}
        return {
            "rollout/ep_rew_mean": log.pop("training_return"),
            "rollout/ep_len_mean": log.pop("episode_length"),
            "rollout/n_episodes": log.pop("n_episodes"),
            "time/total_timesteps": population.step,
            "time/time_elapsed": seconds,
            "time/fps": speed,
        } | {f"train/{name}": value for name, value in log.items() if name != "evaluation_return"}

    @staticmethod
    def _check_divergence(population: Population) -> None:
        step = int(population.diverged_at[0])
        if step >= 0:
            raise DivergenceError(
                f"the gradient was not finite at step {step:,}; the model keeps the parameters before it. Lower "
                "learning_rate, or set normalize_reward or normalize_observation"
            )

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, Any]:
        """The action for one observation, or the actions for a batch of them, within the bounds of the action space.

        `state` and `episode_start` are for the interface: the policy has no memory, and state comes back as it went in.

        Raises:
            UsageError: an observation that the space can't hold.
        """
        del episode_start
        rows, single = self._observations.rows(observation)
        learner = self.learner
        if deterministic:
            action = _exploit(self._policy, learner, rows)
        else:
            key = jax.random.fold_in(jax.random.key(self.seed), self._n_predictions)
            self._n_predictions += 1
            action = _explore(self._policy, learner, rows, key)
        actions = self._actions.to_env(np.asarray(action))
        return (actions[0, ...] if single else actions), state

    def evaluate(self, n_episodes: int = 10, env: Any = None) -> Float[np.ndarray, " n_episodes"]:
        """Undiscounted returns of whole episodes without exploration; training is not touched by it.

        Args:
            n_episodes: how many, side by side on copies of the environment.
            env: another environment to play them on, as in the constructor.

        Raises:
            UsageError: an environment of which only one copy was given.
        """
        require_integer("n_episodes", n_episodes, 1)
        if env is None:
            returns: np.ndarray = self._connected().evaluate(n_episodes)[0]
            return returns
        task = find(env)
        self._check_spaces(task)
        if isinstance(task, Environment):
            key = jax.random.fold_in(jax.random.key(self.seed), self.num_timesteps)
            return np.asarray(evaluate(key, task, self._policy, self.learner, n_episodes))
        envs = task.make(n_episodes)
        try:
            seeds = np.random.SeedSequence((self.seed, 1, self.num_timesteps)).generate_state(n_episodes)
            return play(task.name, envs, seeds, lambda rows: np.asarray(_exploit(self._policy, self.learner, rows)))
        finally:
            envs.close()

    def save(self, path: str | Path) -> Path:
        """Write the model to one file and return its path; `.safetensors` is added to a name without a suffix.

        It holds all that `load` needs to go on exactly. Loading it runs no code.
        """
        snapshot = self._connected().snapshot()
        settings = {
            "class": "A2C",
            "env": self._env_name(),
            "config": {name: type(like)(getattr(self.config, name)) for name, like in saved.EXAMPLE["config"].items()}
            | {"net_arch": [int(units) for units in self.config.net_arch]},
            "hypers": {name: float(value) for name, value in self.hypers._asdict().items()},
            "seed": int(self.seed),
            "step": self.num_timesteps,
            "log_interval": self._interval,
            "n_predictions": self._n_predictions,
            "action_space": to_json(self._actions.space),
            "observation_space": to_json(self._observations.space),
        }
        path = Path(path)
        path = path if path.suffix else path.with_suffix(".safetensors")
        checkpoint.write(path, settings, checkpoint.flatten(snapshot))
        return path

    @classmethod
    def load(cls, path: str | Path, env: Any = None, env_kwargs: dict[str, Any] | None = None) -> "A2C":
        """The model of a file. Without an environment it predicts; with the one that it was trained on it goes on.

        Raises:
            UsageError: no such file, or an environment with other spaces.
            CheckpointError: a file that is damaged or not a model.

        Warns:
            InexactResume: the file has no states of the environments, so their episodes start anew.
        """
        path = Path(path)
        if not path.exists() and path.with_suffix(".safetensors").exists():
            path = path.with_suffix(".safetensors")
        settings, arrays = checkpoint.read(path)
        model = cls.__new__(cls)
        try:
            saved.check(settings, arrays)
            actions = ActionBox("the checkpoint", from_json(settings["action_space"]))
            observations = Observations("the checkpoint", from_json(settings["observation_space"]))
            config = Config(**settings["config"] | {"net_arch": tuple(settings["config"]["net_arch"])})
            hypers = Hypers(**settings["hypers"])
            model._describe(config, hypers, settings["seed"], actions, observations)
            model._steps_at_load, model._interval = settings["step"], settings["log_interval"]
            model._n_predictions = settings["n_predictions"]
            one = jax.eval_shape(lambda key: a2c.init(key, config, model._policy, observations.size), jax.random.key(0))
            like = {"run": {"learner": jax.tree.map(lambda x: jax.ShapeDtypeStruct((1, *x.shape), x.dtype), one)}}
            # NamedTuples and dictionaries have the same names in a checkpoint.
            learner = checkpoint.unflatten(arrays, like)["run"]["learner"]
            model._learner = jax.tree.map(lambda rows: jnp.asarray(rows[0]), learner)
        except saved.MALFORMED as error:
            raise saved.unusable(path, error) from None
        if env is None:
            require(not env_kwargs, f"env_kwargs is {env_kwargs}; give env with it")
            return model
        cause = model._resume(find(env, **(env_kwargs or {})), path, arrays)
        if cause:
            message = f"{model._env_name()} goes on from the start of new episodes: {cause}"
            warnings.warn(message, InexactResume, stacklevel=2)
        return model

    def _resume(self, task: Environment | HostTask, path: Path, arrays: dict[str, np.ndarray]) -> str:
        """Go on from there; why not exactly, if so."""
        self._check_spaces(task)
        self._connect(task)
        population = self._connected()
        like, cause = population.snapshot(), ""
        try:
            snapshot = checkpoint.unflatten(arrays, {"run": like["run"]})
            if "environments" not in like:
                cause = "its environments can't be put into a state"
            else:
                try:
                    snapshot |= checkpoint.unflatten(arrays, {"environments": like["environments"]})
                except CheckpointError as error:
                    snapshot["environments"] = like["environments"]
                    cause = f"the checkpoint has no state for its environments ({error})"
            population.restore(snapshot)
        except saved.MALFORMED as error:
            self.close()
            raise saved.unusable(path, error) from None
        self._learner = None
        return cause

    def close(self) -> None:
        """Let go of the environments that the model made."""
        if self._population:
            self._population.close()

    def _connected(self) -> Population:
        require(
            self._population is not None,
            "the model was loaded without an environment; give it one: A2C.load(path, env=...)",
        )
        assert self._population
        return self._population

    def _check_spaces(self, task: Environment | HostTask) -> None:
        actions, observations = _spaces(task)
        for kind, own, other in (
            ("actions", self._actions, actions),
            ("observations", self._observations, observations),
        ):
            same = to_json(own.space) == to_json(other.space)  # the order of a Dict's keys matters too
            require(same, f"env has {kind} {other.space}; the model's are {own.space}")

    def _env_name(self) -> str | None:
        env = self._env
        return getattr(env, "name", None) or type(env).__name__


def _spaces(task: Environment | HostTask) -> tuple[ActionBox, Observations]:
    if isinstance(task, Environment):
        name = type(task).__name__
        return (
            ActionBox(name, gymnasium.spaces.Box(task.action_low, task.action_high)),
            Observations(name, gymnasium.spaces.Box(task.observation_low, task.observation_high)),
        )
    return ActionBox(task.name, task.action_space), Observations(task.name, task.observation_space)


_exploit = jax.jit(deterministic_action, static_argnums=0)


@functools.partial(jax.jit, static_argnums=0)
def _explore(policy: Policy, learner: Learner, rows: Array, key: Array) -> Array:
    normalised = normalization.observation(learner.normalizer, rows)
    return a2c.act(policy, learner.params, normalised, policy.noise(key, rows.shape[:1]))
