"""Stable-Baselines3's callbacks on our models, as they are: EvalCallback, CheckpointCallback and the like.

Those that read the variables of SB3's rollout (`self.locals["dones"]`) don't work, for there are none here.

SB3 is not imported here: whoever has a callback of its has it.
"""

import functools
import sys
from collections.abc import Sequence
from numbers import Real
from typing import Any

import gymnasium

from galton.errors import UsageError
from galton.extras import is_instance_of
from galton.words import CHOOSING, vocabulary


def is_callback(callback: object) -> bool:
    """True for one of SB3's callbacks, without importing SB3 for the question."""
    return is_instance_of(callback, "stable_baselines3", "BaseCallback")


class Callbacks:
    """The SB3 callbacks of one call of `learn`, called from our training loop.

    They are called once for each step, as by SB3; the calls of a rollout come together, after its update.
    """

    def __init__(self, model: Any, callbacks: Sequence[Any], total_timesteps: int) -> None:
        self._model, self._callbacks = model, list(callbacks)
        self._facade = Facade(model)
        self._locals = {"self": self._facade, "total_timesteps": total_timesteps}

    def __bool__(self) -> bool:
        return bool(self._callbacks)

    def start(self) -> None:
        """Tell the callbacks that training begins."""
        self._facade.num_timesteps = self._model.num_timesteps
        for callback in self._callbacks:
            callback.init_callback(self._facade)
            callback.on_training_start(self._locals, {})

    def after_update(self) -> bool:
        """Tell the callbacks of each step of an update's rollout; whether to go on."""
        n_envs, n_steps = self._model.agent.rollout.n_envs, self._model.agent.rollout.n_steps
        first = self._model.num_timesteps - n_envs * n_steps
        for callback in self._callbacks:
            callback.on_rollout_start()
        for t in range(n_steps if self._callbacks else 0):
            self._facade.num_timesteps = first + (t + 1) * n_envs
            verdicts = [callback.on_step() for callback in self._callbacks]
            if not all(verdicts):
                return False
        for callback in self._callbacks:
            callback.on_rollout_end()
        return True

    def recorded(self, is_log_point: bool) -> dict[str, float]:
        """The numbers that the callbacks recorded since the last log point; at a log point they are forgotten."""
        if not self._callbacks:
            return {}
        logger = self._facade.logger
        numbers = {key: float(value) for key, value in logger.name_to_value.items() if isinstance(value, Real)}
        if is_log_point:
            logger.name_to_value.clear()
            logger.name_to_count.clear()
        return numbers

    def end(self) -> None:
        """Tell the callbacks that training has ended."""
        for callback in self._callbacks:
            callback.on_training_end()


class Facade:
    """Our model as SB3's callbacks know theirs; all that is not here is the model's own, or one of its settings."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self.num_timesteps = model.num_timesteps

    def __getattr__(self, name: str) -> Any:
        is_setting = name in vocabulary().usual and name not in CHOOSING and name in self._model.settings
        return self._model.settings[name] if is_setting else getattr(self._model, name)

    def __setattr__(self, name: str, value: object) -> None:
        own = name in ("_model", "num_timesteps")
        super().__setattr__(name, value) if own else setattr(self._model, name, value)

    @functools.cached_property
    def logger(self) -> Any:
        """SB3's logger, which prints messages; what is recorded is in the log of the next log point."""
        from stable_baselines3.common import logger

        made: Any = logger.Logger(None, [logger.HumanOutputFormat(sys.stdout)])
        made.set_level(logger.INFO if self._model.verbose > 0 else logger.WARN)
        made.dump = lambda *_, **__: None
        return made

    def get_vec_normalize_env(self) -> object:
        """The VecNormalize that the model is trained on, if it is; else normalising is the model's, in `predict`."""
        from stable_baselines3.common.vec_env import unwrap_vec_normalize

        source = _source(self._model)
        return None if source is None else unwrap_vec_normalize(source)


def vec_env(model: Any) -> Any:
    """SB3's own VecEnv, if the model is trained on one; else what has its spaces and its number of copies."""
    if (source := _source(model)) is not None:
        return source
    try:
        from stable_baselines3.common.vec_env import DummyVecEnv
    except ImportError as error:
        told = f"get_env makes a VecEnv of Stable-Baselines3's, which can't be loaded ({error}); install it"
        raise UsageError(told) from None
    envs = model.population.environments
    found = [[one for one in layers if isinstance(one, gymnasium.Env)] for layers in (envs.layers if envs else ())]
    copies: list[Any] = [own[0] if own else None for own in found] or [None] * model.agent.rollout.n_envs
    makers: list[Any] = [functools.partial(_Copy, model, copy) for copy in copies]
    return DummyVecEnv(makers)


def _source(model: Any) -> Any:
    """SB3's VecEnv that the model is trained on, if it is one."""
    source = getattr(model.env, "source", None)
    return source if is_instance_of(source, "stable_baselines3", "VecEnv") else None


_NO_OBJECT = "a copy of training's environment is no object of this process"


class _Copy(gymnasium.Env[Any, Any]):
    """A copy of training's environment, for callbacks that ask for its attributes and set them; nobody steps it."""

    copy: Any

    def __init__(self, model: Any, copy: Any) -> None:
        vars(self).update(action_space=model.action_space, observation_space=model.observation_space, copy=copy)

    def __setattr__(self, name: str, value: object) -> None:
        if self.copy is None:
            raise AttributeError(f"{name} can't be set: {_NO_OBJECT}")
        self.copy.set_wrapper_attr(name, value)

    def get_wrapper_attr(self, name: str) -> Any:
        """An attribute of training's copy, or of what it is around."""
        if self.copy is not None:
            return self.copy.get_wrapper_attr(name)
        if not hasattr(self, name):
            raise AttributeError(f"{name} can't be asked for: {_NO_OBJECT}")
        return getattr(self, name)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """UsageError, which says what can be stepped."""
        raise UsageError(
            "the environment of get_env() can't be stepped, for training goes on with it; make another to step, or "
            "play episodes with model.evaluate"
        )
