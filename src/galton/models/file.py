"""A model as one file, and back."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from galton.algorithms import actor_critic
from galton.envs.base import Environment
from galton.envs.find import find
from galton.envs.host.action_box import ActionBox
from galton.envs.host.base import HostTask
from galton.envs.host.observations import Observations
from galton.envs.host.space_json import from_json, to_json
from galton.errors import CheckpointError, require
from galton.records import written
from galton.training import checkpoint
from galton.training import settings as saved

if TYPE_CHECKING:
    import galton.models.model

ModelT = TypeVar("ModelT", bound="galton.models.model.Model")


class InexactResume(UserWarning):
    """A loaded run goes on from the start of new episodes, because its environments can't tell their states."""


def save(model: "galton.models.model.Model", path: Path) -> Path:
    """Write the model, and return the file's path."""
    config = written(model.config)
    settings = {
        "class": model.agent.algorithm.label,
        "env": model.env_name,
        "config": config | {"net_arch": [int(units) for units in model.config.net_arch]},
        "hypers": {name: float(value) for name, value in written(model.hypers).items()},
        "seed": int(model.seed),
        "step": model.num_timesteps,
        "log_interval": model.updates_per_log,
        "n_predictions": model.n_predictions,
        "action_space": to_json(model.action_space),
        "observation_space": to_json(model.observation_space),
    }
    path = path if path.suffix else path.with_suffix(".safetensors")
    checkpoint.write(path, settings, checkpoint.flatten(model.population.snapshot()))
    return path


def load(cls: type[ModelT], path: Path, env: Any, env_kwargs: dict[str, Any]) -> ModelT:
    """The model of a file; see `Model.load`."""
    if not path.exists() and path.with_suffix(".safetensors").exists():
        path = path.with_suffix(".safetensors")
    settings, arrays = checkpoint.read(path)
    settings = saved.checked(path, settings, arrays)
    require(
        cls.__name__ in ("Model", settings["class"]),
        f"path is {path}, which holds a model of {settings['class']}; load it with galton.{settings['class']}.load",
    )
    model = cls.__new__(cls)
    try:
        config, hypers = saved.config_of(settings), saved.hypers_of(settings)
        actions = ActionBox("the checkpoint", from_json(settings["action_space"]))
        observations = Observations("the checkpoint", from_json(settings["observation_space"]))
        model.describe(config, hypers, settings["seed"], actions, observations)
        model.n_predictions = settings["n_predictions"]
        one = jax.eval_shape(
            lambda key: actor_critic.init(key, model.agent, hypers, observations.size), jax.random.key(0)
        )
        like = {"run": {"learner": jax.tree.map(lambda x: jax.ShapeDtypeStruct((1, *x.shape), x.dtype), one)}}
        # NamedTuples and dictionaries have the same names in a checkpoint.
        learner = checkpoint.unflatten(arrays, like)["run"]["learner"]
        first = jax.tree.map(lambda rows: jnp.asarray(rows[0]), learner)
        model.remember(first, settings["step"], settings["log_interval"])
    except saved.MALFORMED as error:
        raise saved.unusable(path, error) from None
    if env is None:
        require(not env_kwargs, f"env_kwargs is {env_kwargs}; give env with it")
        return model
    cause = _resume(model, find(env, **env_kwargs), path, arrays)
    if cause:
        message = f"{model.env_name} goes on from the start of new episodes: {cause}"
        warnings.warn(message, InexactResume, stacklevel=3)
    return model


def _resume(
    model: "galton.models.model.Model", task: Environment | HostTask, path: Path, arrays: dict[str, np.ndarray]
) -> str:
    """Go on from there; why not exactly, if so."""
    model.check_spaces(task)
    model.connect(task)
    like, cause = model.population.snapshot(), ""
    try:
        snapshot = checkpoint.unflatten(_grown(model, arrays), {"run": like["run"]})
        if "environments" not in like:
            cause = "its environments can't be put into a state"
        else:
            try:
                snapshot |= checkpoint.unflatten(arrays, {"environments": like["environments"]})
            except CheckpointError as error:
                snapshot["environments"] = like["environments"]
                cause = f"the checkpoint has no state for its environments ({error})"
        model.population.restore(snapshot)
    except saved.MALFORMED as error:
        model.close()
        raise saved.unusable(path, error) from None
    return cause


def _grown(model: "galton.models.model.Model", arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays with what the algorithm did not yet tell when they were written: unknown up to the next log point."""
    unknown = np.where(arrays["run/tally/n_updates"] > 0, np.float32(np.nan), np.float32(0))
    return {f"run/tally/diagnostics/{name}": unknown for name in model.agent.algorithm.scalars} | arrays
