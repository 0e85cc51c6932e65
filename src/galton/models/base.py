"""A model as one looks at it: its agent, its spaces, where it stands and what it has learnt."""

from typing import TYPE_CHECKING, Any, TypeVar

from galton.agents import in_two, words_of, written
from galton.algorithms import Agent
from galton.envs.host.actions import Actions
from galton.envs.host.base import Space
from galton.envs.host.observations import Observations
from galton.envs.host.space_json import actions_to_json, to_json
from galton.envs.task import Task
from galton.errors import DivergenceError, UsageError, require
from galton.models.file import Taken
from galton.models.hints import KEPT
from galton.models.settings import unusual
from galton.models.state import Loaded, Run, parameters_of
from galton.parts import at, has_schedules
from galton.records import Fields
from galton.training.population import Population
from galton.training.remedy import remedy
from galton.training.train import check_seed
from galton.types import Learner, Params
from galton.words import CHOOSING, vocabulary

BaseT = TypeVar("BaseT", bound="Base")


class Base:
    """A model, of which a subclass says how it is made and what it does."""

    _run: Run | Loaded

    def _describe(self, agent: Agent, seed: int, actions: Actions, observations: Observations) -> None:
        """Become the model of this agent, without a run yet."""
        self.agent, self.seed, self.actions, self.observations = agent, seed, actions, observations
        self._is_scheduled = has_schedules(agent)
        self._interval, self.verbose, self.n_predictions = self.agent.algorithm.log_interval, 0, 0

    def __setattr__(self, name: str, value: object) -> None:
        require(name not in vocabulary().usual, f"{name} can't be set: {KEPT}")
        super().__setattr__(name, value)

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            """Say where a setting is, which in SB3 is an attribute."""
            if "agent" in vars(self) and name in self.settings and name not in CHOOSING:
                raise AttributeError(f"{type(self).__name__} has no {name!r}; model.settings[{name!r}] is its setting")
            return self.__getattribute__(name)  # whose error it is

    def __repr__(self) -> str:
        told = {"n_envs": self.agent.rollout.n_envs} | unusual(self.agent) | {"seed": self.seed}
        what = f"{self.settings['loss']} on {self.env_name}"
        said = ", ".join([what, *(f"{name}={value!r}" for name, value in told.items())])
        return f"<galton.{type(self).__name__}: {said}, {self.num_timesteps:,} steps>"

    @property
    def _going(self) -> Run:
        if isinstance(self._run, Loaded):
            told = "the model was loaded without an environment; give it one: load(path, env=...), or set_env(env)"
            raise UsageError(told)
        return self._run

    @property
    def _now(self) -> Agent:
        """The agent with the numbers of this step, which takes a while to look up and only schedules need."""
        return at(self.agent, self.num_timesteps) if self._is_scheduled else self.agent

    @property
    def settings(self) -> Fields:
        """The settings of its agent by name, as keyword arguments; those that none of its parts has are left out."""
        return words_of(self.agent)

    @property
    def env(self) -> Task | None:
        """The environment, as `galton.envs.find` made it; None for a model that was loaded without one."""
        return self._run.task

    @property
    def env_name(self) -> str:
        """The name that messages and files have for the environment."""
        return self._run.env_name

    @property
    def action_space(self) -> Space:
        """The actions as Gymnasium describes them."""
        return self.actions.space

    @property
    def observation_space(self) -> Space:
        """The observations as Gymnasium describes them."""
        return self.observations.space

    @property
    def num_timesteps(self) -> int:
        """The environment steps that the run has taken, all copies together."""
        return self._run.step

    @property
    def log_interval(self) -> int:
        """The environment steps between two log points, all copies together, as `learn` was last told."""
        return self._interval * self.agent.rollout.size

    @property
    def learner(self) -> Learner:
        """All that was learnt: parameters, Adam's moments and the statistics that normalise."""
        return self._run.learner

    @property
    def wrapper_statistics(self) -> list[dict[str, Any]]:
        """The running statistics by which wrappers normalise the observations of each copy, by place."""
        return self._run.statistics

    @property
    def population(self) -> Population:
        """The one run, as training sees it; UsageError for a model without an environment."""
        return self._going.population

    def set_random_seed(self, seed: int) -> None:
        """Draw all that is random from here on from another seed; episodes that have begun go on as they are."""
        check_seed(seed)
        self.population.reseed([seed])
        self.seed, self.n_predictions = seed, 0

    def get_parameters(self) -> Params:
        """A copy of the networks' parameters: `actor`, `critic` and, for the Gaussian, `log_std`, as numpy arrays.

        A model that normalises has its statistics with them, under `normalizer`: mean, variance and n (how many were
        seen) of what `Normalizer` names, and the origin that observations are counted from.
        """
        return parameters_of(self.learner)

    def set_parameters(self, parameters: Params) -> None:
        """Go on with other parameters, such as another model's, and its statistics; Adam's moments stay.

        A model that normalises warns where the statistics are missing, and keeps its own.

        Raises UsageError for other names or shapes than its own, and for numbers that are not finite.
        """
        self._going.set_parameters(parameters)

    def advance(self, n_updates: int) -> None:
        """Train for so many updates; no callback is called and nothing is logged.

        Raises:
            BrokenEnvironmentError, DivergenceError: as `learn`.
        """
        self._going.advance(n_updates)
        step = int(self.population.diverged_at[0])
        if step >= 0:
            raise DivergenceError(
                f"the gradient was not finite at step {step:,}; the model keeps the parameters before it. "
                f"{remedy(at(self.agent, step), self.population.learner)}"
            )

    def take(self) -> Taken:
        """The file is made that `save` would write now, to be written later or by another thread."""
        settings = {
            "class": self.agent.algorithm.label,
            "env": self.env_name,
            **in_two(written(self.settings)),
            "seed": int(self.seed),
            "step": self.num_timesteps,
            "log_interval": self._interval,
            "n_predictions": self.n_predictions,
            "action_space": actions_to_json(self.actions),
            "observation_space": to_json(self.observation_space),
        }
        return Taken(settings, self._run.arrays)

    def close(self) -> None:
        """Close the environments that the model made. Nobody has to: they are closed too once nobody holds the model.

        One that was given ready-made is its owner's, and stays open.
        """
        if isinstance(self._run, Run):
            self._run.close()

    def __copy__(self: BaseT) -> BaseT:
        """Another view of the same run, as `copy.copy` makes of any object."""
        model = type(self).__new__(type(self))
        vars(model).update(vars(self))
        return model

    def __reduce__(self) -> Any:
        """TypeError for pickle and deepcopy, which says what to do: environments and programs can't be taken along."""
        name = type(self).__name__
        raise TypeError(
            f"a {name} can't be pickled or copied, for it holds environments and compiled programs; save(path) writes "
            f"all that it has learnt, and {name}.load(path, env) makes another that goes on from there"
        )
