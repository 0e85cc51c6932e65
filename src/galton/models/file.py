"""A model is written to one file and read from it again."""

from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from galton.algorithms import ALGORITHMS, actor_critic
from galton.envs.host.statistics import placed
from galton.errors import MALFORMED, CheckpointError, UsageError, require
from galton.normalization import in_new_episodes
from galton.parts import at
from galton.saving import checkpoint
from galton.saving import model_file as saved
from galton.saving.result_folder import MODEL
from galton.training.log import Tally
from galton.training.population import Population
from galton.training.train import check_one_run, check_seed
from galton.types import Learner

ENVIRONMENTS = "environments/"
"""The beginning of the names of arrays that tell the states of environments."""


class InexactResume(UserWarning):
    """A loaded run goes on from the start of new episodes, because its environments can't tell their states."""


class Taken(NamedTuple):
    """The content of a model's file at one moment; it can be written later, and by another thread."""

    settings: checkpoint.Settings
    arrays: dict[str, np.ndarray]

    @property
    def num_timesteps(self) -> int:
        """The environment steps that the model's run had taken."""
        return int(self.settings["step"])

    def scored(self, mean_reward: float) -> "Taken":
        """The same with the mean return of an evaluation, by which the same run knows its best model later."""
        return self._replace(arrays=self.arrays | {saved.SCORE: np.array(mean_reward, np.float64)})

    def save(self, path: str | Path) -> Path:
        """Write it to one file as `Model.save` does, and return the file's path."""
        path = saved.with_suffix(Path(path))
        checkpoint.write(path, self.settings, self.arrays)
        return path


def read(path: Path, opener: type) -> saved.Saved:
    """A model is read from a file for a class: Model, an algorithm's, or one made of them.

    UsageError for one of another class, and what `opened` raises.
    """
    path = saved.existing(path)
    a_run = path.is_dir() and (path / MODEL).is_file()
    require(not a_run, f"path is {path}, the folder of a run; name a file in it, such as {path / MODEL}")
    found = saved.opened(path)
    try:
        check_one_run(found.agent)
        check_seed(found.settings["seed"])
    except UsageError as error:
        raise saved.unusable(path, error) from None
    bound = {cls.__name__ for cls in opener.__mro__} & {algorithm.label for algorithm in ALGORITHMS.values()}
    label = found.agent.algorithm.label
    opening = label if type(found.agent.algorithm).__module__.startswith("galton.") else "Model"
    fits = not bound or label in bound
    require(fits, f"path is {path}, which holds a model of {label}; load it with galton.{opening}.load")
    return found


def learner_of(found: saved.Saved) -> Learner:
    """The learner of a file's model; CheckpointError if the arrays are not those of its settings, or not finite."""
    try:
        checkpoint.check_numbers(found.arrays)
        agent, size = at(found.agent, 0.0), found.observations.size
        one = jax.eval_shape(lambda key: actor_critic.init(key, agent, size), jax.random.key(0))
        like = {"run": {"learner": jax.tree.map(lambda x: jax.ShapeDtypeStruct((1, *x.shape), x.dtype), one)}}
        # NamedTuples and dictionaries have the same names in a checkpoint.
        learner = checkpoint.unflatten(_by_todays_names(found.arrays), like)["run"]["learner"]
    except MALFORMED as error:
        raise saved.unusable(found.path, error) from None
    first: Learner = jax.tree.map(lambda rows: jnp.asarray(rows[0]), learner)
    return first


def resume(path: Path, population: Population, arrays: dict[str, np.ndarray]) -> tuple[str, str]:
    """Put a population where the file's was.

    Returns:
        Why not exactly, and what became of its wrappers' statistics in that case; each is empty if there is nothing to
        tell.
    """
    like = population.snapshot()
    cause = told = ""
    try:
        snapshot = checkpoint.unflatten(_grown(arrays, like["run"].tally), {"run": like["run"]})
        try:
            snapshot["environments"] = _states(arrays, like.get("environments"))
        except CheckpointError as error:
            cause = str(error)
            if population.environments is None:  # in JAX they have begun new ones
                snapshot["environments"], run = like["environments"], snapshot["run"]
                snapshot["run"] = run._replace(learner=in_new_episodes(run.learner))
            else:
                snapshot["statistics"], told = placed(arrays, like.get("statistics", {}))
        population.restore(snapshot)
    except MALFORMED as error:  # UsageError is a ValueError
        raise saved.unusable(path, error) from None
    return cause, told


def _states(arrays: dict[str, np.ndarray], like: PyTree[np.ndarray] | None) -> PyTree[np.ndarray]:
    """The states of a file's environments; CheckpointError where these can't be put into them.

    What a user's own `get_state` tells may have more entries by now than after a reset, and of other types.
    """
    if like is None:
        raise CheckpointError(
            "its environments can't be put into a state; an environment, and a wrapper that Galton doesn't know, "
            "needs get_state and set_state for it"
        )
    try:
        if isinstance(like, dict):
            there = {name.removeprefix(ENVIRONMENTS): a for name, a in arrays.items() if name.startswith(ENVIRONMENTS)}
            own = {name: array for name, array in there.items() if name.startswith("state/")}
            if more := there.keys() - like.keys() - own.keys():
                raise CheckpointError(f"it has {', '.join(sorted(more))}, which they have not")
            for name, array in own.items():
                shape = like[name].shape if name in like else like["length"].shape + array.shape[2:]
                like = like | {name: jax.ShapeDtypeStruct(shape, array.dtype)}
        return checkpoint.unflatten(arrays, {"environments": like})["environments"]
    except CheckpointError as error:
        raise CheckpointError(f"the checkpoint has no state for its environments ({error})") from None


def _grown(arrays: dict[str, np.ndarray], tally: Tally) -> dict[str, np.ndarray]:
    """The arrays with what the algorithm did not yet tell when they were written: unknown up to the next log point."""
    unknown = np.where(arrays["run/tally/n_updates"] > 0, np.float32(np.nan), np.float32(0))
    return {f"run/tally/diagnostics/{name}": unknown for name in tally.diagnostics} | _by_todays_names(arrays)


def _by_todays_names(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays as they are called today, with the origin of a normaliser that had none when they were written.

    Its statistics began at 0. The dual variable of a held entropy had a name of its own.
    """
    normalizer, dual = "run/learner/normalizer", "run/learner/dual"
    mean = arrays.get(f"{normalizer}/observation/mean")
    found = arrays if mean is None else {f"{normalizer}/origin": np.zeros_like(mean)} | arrays
    return found | ({"run/learner/memory/entropy": arrays[dual]} if dual in arrays else {})
