"""One run with the habits of Stable-Baselines3: learn, predict, evaluate, save, load."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from galton import sb3
from galton.agents import read
from galton.algorithms import Agent, Algorithm, find_algorithm
from galton.envs.find import find
from galton.envs.host import masks
from galton.envs.task import Task, check_copies, check_same_spaces
from galton.errors import require, require_integer
from galton.losses import Loss
from galton.models import file
from galton.models.acting import exploit, explore, returns_on
from galton.models.base import Base
from galton.models.hints import KEPT, of_class, refuse_policy, unexpected
from galton.models.learning import learn, updates_for
from galton.models.settings import all_words, told_of_few_steps, usual
from galton.models.state import Arrays, Loaded, Run
from galton.presets import find_preset
from galton.training.programs import check_process
from galton.training.train import check_one_run, check_seed
from galton.training.yardsticks import Yardsticks, yardsticks_on
from galton.words import refuse_idle, vocabulary

ModelT = TypeVar("ModelT", bound="Model")


class Model(Base):
    """An actor-critic on one environment; A2C and PPO are this class with their algorithm.

    Args:
        env: a Gymnasium id (`module:Id` imports the module first), `module:Class`, a Gymnasium `Env` or `VectorEnv`,
            an SB3 `VecEnv`, a function that makes an environment, a name in `galton.envs.ENVS`, or a record of your
            own in pure JAX.
        loss: a key of LOSSES, or a loss itself such as `HLGauss(eta=2.0)`; None for the preset's.
        preset: a key of PRESETS, what the other settings begin with. None is "paper" where a loss is named, and else
            the algorithm's usual one: "gaussian" for PPO, and "classification" for A2C (docs/which_policy.md).
        algorithm: a key of ALGORITHMS, or an algorithm itself such as `PPO(clip_range=0.1)`.
        n_envs: copies of the environment; None for the preset's number, or for as many as were given ready-made.
        seed: of everything random; the same seed gives the same run.
        env_kwargs: keyword arguments for an id or a name.
        verbose: 1 to print a line at each log point of `learn`, and one where compiling takes longer than a second.
        settings: those of the agent's parts, which describe them, as `galton.make_agent` takes them. Their defaults
            are the algorithm's, and for a task of the paper that is called by its name, those of App. C.2, as on the
            command line: "bandit" has a linear network and, for A2C, 5 steps an update and a learning rate of 0.05.

    Raises:
        UsageError: an argument out of range, or an environment that can't be used, with what to do about it.
        BrokenEnvironmentError: an environment that breaks in its first reset.
    """

    def __init__(
        self,
        env: object,
        loss: str | Loss | None = None,
        *,
        preset: str | None = None,
        algorithm: str | Algorithm = "a2c",
        n_envs: int | None = None,
        seed: int = 0,
        env_kwargs: Mapping[str, object] | None = None,
        verbose: int = 0,
        **settings: Any,
    ) -> None:
        refuse_policy(type(self).__name__, env, loss)
        task = find(env, **(env_kwargs or {}))
        chosen = algorithm if isinstance(algorithm, Algorithm) else find_algorithm(algorithm)
        found = find_preset(preset, loss, chosen.name)
        words = all_words(chosen, found, n_envs, settings, env, task.given)
        if loss is None:  # who names none may think that it is another one
            refuse_idle(words, settings)
        if told := told_of_few_steps(words, settings, usual(chosen, env, found)):
            warnings.warn(told, stacklevel=2 + (type(self) is not Model))
        self._begin(task, read(words), seed)
        self.verbose = verbose

    @classmethod
    def of(cls: type[ModelT], env: object, agent: Agent, seed: int = 0) -> ModelT:
        """A model of this agent, in the place of keyword arguments; it raises what the constructor does."""
        model = cls.__new__(cls)
        model._begin(find(env), agent, seed)
        return model

    def _begin(self, task: Task, agent: Agent, seed: int) -> None:
        check_one_run(agent)
        check_copies(task, agent.rollout.n_envs)
        check_seed(seed)
        self._describe(agent.on(task.actions.box), seed, task.actions, task.observations)
        self._run: Run | Loaded = Run(task, self.agent, seed)

    def learn(
        self: ModelT,
        total_timesteps: int | float,
        callback: object = None,
        log_interval: int | None = None,
        *,
        progress_bar: bool = True,
        decay_from: int | None = None,
        **others: object,
    ) -> ModelT:
        """Train for that many more steps, rounded up to whole updates.

        There is a log point every `log_interval` updates, counted from the start of the run, and one at the end.
        `galton.callbacks` says which callbacks are called when. The log points before the end do not depend on how
        training is cut into calls of `learn`, unless the learning rate falls over all that is trained.

        Args:
            total_timesteps: steps of the environment, all copies together; a whole number such as 1e6 may be a float.
            callback: from `galton.callbacks`, a function `(model, log) -> bool | None` of your own (False stops), an
                SB3 callback, or several of them.
            progress_bar: show how far training is.
            log_interval: updates between log points, by default 100 for A2C and 1 for PPO, as in SB3; a run that is
                resumed keeps the logs only if it stays the same.
            decay_from: with decay_steps = inf the learning rate falls from this step of the run to 0 at the end of this
                call. By default it falls anew in each call, from where that begins; 0 goes on where a run was cut.
            others: refused, with a hint for SB3's.

        Raises:
            UsageError: a number out of range, a model without an environment, or a callback that can't be called or
                would not be before the end.
            BrokenEnvironmentError: an environment broke; the model keeps what it learnt up to the last update.
            DivergenceError: a gradient was not finite; the model keeps the parameters before it.

        Warns:
            SharedEnvironment: somebody else moved the environment since; its episodes begin anew.
            WideGaussian: at a log point, once a call: σ has outgrown the action box.
        """
        for name in others:
            raise unexpected("learn", name)
        log_interval = self.agent.algorithm.log_interval if log_interval is None else log_interval
        require_integer("log_interval", log_interval, 1)
        n_updates = updates_for(total_timesteps, self.agent.rollout, self.population.step)
        if decay_from is not None:
            require_integer("decay_from", decay_from, 0)
            past = f"decay_from is {decay_from}, but the run is at step {self.num_timesteps}; name an earlier one"
            require(decay_from <= self.num_timesteps, past)
        self._interval = int(log_interval)
        learn(self, n_updates, callback, progress_bar, self.verbose > 0, decay_from)
        return self

    def predict(
        self,
        observation: object,
        state: object = None,
        episode_start: object = None,
        deterministic: bool = False,
        action_masks: object = None,
    ) -> tuple[Any, Any]:
        """The action for one observation, or the actions for a batch of them, within the bounds of the action space.

        `action_masks` says which values are allowed, for each observation, where the environment tells masks; else all
        are. `state` and `episode_start` are for the interface: the policy has no memory, and state comes back as it
        went in.

        Raises:
            UsageError: an observation that the space can't hold, or masks that allow nothing.
        """
        rows, single = self.observations.rows(observation, action_masks)
        if action_masks is not None:
            entry = masks.forbidden(rows[:, rows.shape[1] - self.actions.n_mask :], self.actions.box)
            require(entry is None, f"action_masks allows no value of entry {entry} of the action; allow one at least")
        if deterministic:
            action = exploit(self._now, self.learner, rows)
        else:
            action = explore(self._now, self.learner, rows, self.seed, self.n_predictions)
            self.n_predictions += 1
        actions = self.actions.clip(action)
        return (self.actions.one(actions, 0) if single else actions), state

    def evaluate(
        self, n_episodes: int = 10, env: object = None, env_kwargs: Mapping[str, object] | None = None
    ) -> Float[np.ndarray, " n_episodes"]:
        """Undiscounted returns of whole episodes without exploration; training is not touched by it.

        A copy of the environment is what training's is by now: with the statistics of its wrappers, which stay as they
        are, and with the numbers and arrays that its attributes have got since. Rewards are told as the environment
        gives them, below a wrapper that scales them by running statistics.

        Args:
            n_episodes: how many, side by side on copies of the environment.
            env: another environment to play them on, as in the constructor. On one that is there they are played one
                after another. Wrappers that normalise observations get the statistics of training's.
            env_kwargs: keyword arguments for an id or a name.

        Raises:
            UsageError: an environment that was given and can't be copied as it is; one that normalises observations by
                other statistics than training's; or in a process forked from one that trains.
        """
        check_process()
        require_integer("n_episodes", n_episodes, 1)
        task = self._other(env, env_kwargs)
        if task is None:
            return self.population.evaluate(n_episodes)[0]
        about = (self._now, self.learner, n_episodes, self.seed, self.num_timesteps)
        return returns_on(task, *about, self.wrapper_statistics)

    def yardsticks(self, env: object = None, env_kwargs: Mapping[str, object] | None = None) -> Yardsticks:
        """A policy has to be better than these mean returns: of doing nothing, and of random actions.

        Three episodes of each are played where `evaluate` plays; its arguments and errors are that method's.
        """
        task = self._other(env, env_kwargs)
        return self.population.yardsticks() if task is None else yardsticks_on(task, self.actions.box)

    def _other(self, env: object, env_kwargs: Mapping[str, object] | None) -> Task | None:
        """Another environment to play on, of the model's spaces; None where none is named."""
        if env is None:
            _refuse_alone(env_kwargs)
            return None
        task = find(env, **(env_kwargs or {}))
        check_same_spaces(task, self.actions, self.observations)
        return task

    def save(self, path: str | Path) -> Path:
        """Write the model to one file and return its path; `.safetensors` is added to a name without a suffix.

        It holds all that `load` needs to go on exactly. Loading it runs no code.
        """
        return self.take().save(path)

    @of_class
    def load(
        cls: type[ModelT],  # noqa: N805
        path: str | Path,
        env: object = None,
        env_kwargs: Mapping[str, object] | None = None,
        **others: object,
    ) -> ModelT:
        """The model of a file. Without an environment it predicts; with the one that it was trained on it goes on.

        Other keyword arguments are refused, with a hint for SB3's.

        Raises:
            UsageError: no such file, a model of another algorithm, or an environment with other spaces or in another
                number of copies than n_envs.
            CheckpointError: a file that is damaged or not a model.

        Warns:
            InexactResume: the file has no states of the environments, so their episodes start anew.
        """
        for name in others:
            raise unexpected("load", name, KEPT if name in vocabulary().usual else "")
        found = file.read(Path(path), cls)
        settings, model = found.settings, cls.__new__(cls)
        model._describe(found.agent, settings["seed"], found.actions, found.observations)
        model._interval, model.n_predictions = settings["log_interval"], settings["n_predictions"]
        model._run = Loaded(settings["env"], settings["step"], file.learner_of(found), found.arrays)
        if env is None:
            _refuse_alone(env_kwargs)
        else:
            cause, told = model._go_on(find(env, **(env_kwargs or {})), found.path, found.arrays)
            if cause:
                lost = f"; {told}: wrap it as in training" if told else ""
                message = f"{model.env_name} goes on from the start of new episodes: {cause}{lost}"
                warnings.warn(message, file.InexactResume, stacklevel=2)
        return model

    def _go_on(self, task: Task, path: Path, arrays: Arrays) -> tuple[str, str]:
        """Go on with a run on this environment where the arrays of a file are; what `file.resume` tells."""
        check_copies(task, self.agent.rollout.n_envs)
        check_same_spaces(task, self.actions, self.observations)
        run = Run(task, self.agent, self.seed)
        told = run.resume(path, arrays)
        self.close()
        self._run = run
        return told

    def set_env(self, env: object, env_kwargs: Mapping[str, object] | None = None) -> None:
        """Go on with what was learnt on another environment of the same spaces, from the start of new episodes.

        Raises:
            UsageError: an environment with other spaces, or of which another number of copies was given than n_envs.
        """
        task = find(env, **(env_kwargs or {}))
        arrays = {name: a for name, a in self._run.arrays.items() if not name.startswith(file.ENVIRONMENTS)}
        _, told = self._go_on(task, Path("set_env"), arrays)
        if told:
            message = f"{self.env_name} is not wrapped as what the model was trained on: {told}; wrap both alike"
            warnings.warn(message, stacklevel=2)

    def get_env(self) -> Any:
        """SB3's VecEnv that the model is trained on; None for a model without an environment.

        Of any other environment it is a VecEnv of its spaces and its number of copies, which can't be stepped, and
        through which attributes and methods of training's copies are reached where they are objects of this process.

        Raises:
            UsageError: SB3 is not installed.
        """
        return None if self.env is None else sb3.vec_env(self)


def _refuse_alone(env_kwargs: Mapping[str, object] | None) -> None:
    require(not env_kwargs, f"env_kwargs is {env_kwargs}; give env with it")
