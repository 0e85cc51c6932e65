"""A policy has to be better than doing nothing and acting at random, neither of which needs any learning."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from galton.decimals import fitting
from galton.envs.host.base import HostEnvironments
from galton.envs.task import Task
from galton.parts import Box
from galton.training.evaluate import opened, play

N_EPISODES = 3
"""The number of episodes of each that are played."""
SEED = 0
"""Of the episodes and of the random actions: they are the same in every run."""

Act = Callable[[Float[np.ndarray, "n o"]], Float[np.ndarray, "n d"]]
"""A function that gives n actions for n observations."""


class Yardsticks(NamedTuple):
    """Mean undiscounted returns of N_EPISODES whole episodes."""

    doing_nothing: float
    """Of the action 0; in a dimension whose bounds leave 0 out, of the middle between them."""
    random_actions: float
    """Of actions that are uniform in the box."""

    def log(self) -> dict[str, float]:
        """Both numbers under the names that a log has for them."""
        return {f"eval/{name}": value for name, value in self._asdict().items()}

    def __str__(self) -> str:
        form = fitting(*self)
        return f"doing nothing returns {self.doing_nothing:{form}}, random actions {self.random_actions:{form}}"

    def not_reached_by(self, mean: float) -> str:
        """The message about a policy whose mean return is below one of the two; empty if it isn't."""
        above = [(value, name.replace("_", " ")) for name, value in self._asdict().items() if mean < value]
        form = fitting(mean, *self)
        told = " and ".join(f"{name} ({value:{form}})" for value, name in above)
        return f"the policy's return of {mean:{form}} is below that of {told}" if told else ""


def logged(log: Mapping[str, float]) -> Yardsticks | None:
    """The yardsticks that a log holds; None if it holds none."""
    found = [log.get(name, math.nan) for name in Yardsticks(0.0, 0.0).log()]
    return None if any(map(math.isnan, found)) else Yardsticks(*found)


def nothing(box: Box) -> Act:
    """Acts by 0, by the middle of a dimension whose bounds leave 0 out, and by the first value of a choice."""
    low, high = (np.asarray(bound, np.float32) for bound in (box.low, box.high))
    action = np.where((low <= 0) & (high >= 0), np.float32(0), low + (high - low) / 2)

    def act(observation: np.ndarray) -> np.ndarray:
        same = np.tile(action, (len(observation), 1))
        return _allowed(box, observation, same, lambda i, values: -abs(values - action[i]))

    return act


def at_random(box: Box) -> Act:
    """Acts by what is uniform in the box and among the values: the same actions again for whoever asks anew."""
    rng, n = np.random.default_rng(SEED), np.array(box.n_values or np.zeros(len(box.low)))
    low, high = np.where(n > 0, 0, box.low), np.where(n > 0, n, box.high)

    def act(observation: np.ndarray) -> np.ndarray:
        drawn = rng.uniform(low, high, (len(observation), len(n)))
        action = np.where(n > 0, box.low + np.minimum(np.floor(drawn), n - 1), drawn).astype(np.float32)
        return _allowed(box, observation, action, lambda _, values: rng.random((len(observation), len(values))))

    return act


def _allowed(
    box: Box,
    observation: Float[np.ndarray, "n o"],
    action: Float[np.ndarray, "n d"],
    liking: Callable[[int, np.ndarray], np.ndarray],
) -> Float[np.ndarray, "n d"]:
    """The actions, but for each entry with a mask, at the end of an observation, the allowed value that is liked most.

    `liking` tells it of an entry's values: those of a choice, or the middles of a number's bins.
    """
    masks = np.split(observation[:, observation.shape[1] - box.n_mask :], np.cumsum(box.mask_sizes)[:-1], 1)
    for i, mask in enumerate(masks):
        if k := mask.shape[1]:
            is_choice = i in box.choices
            values = box.low[i] + (np.arange(k) if is_choice else (np.arange(k) + 0.5) / k * (box.high[i] - box.low[i]))
            action[:, i] = values[np.where(mask > 0, liking(i, values), -np.inf).argmax(1)]
    return action


def yardsticks(name: str, envs: HostEnvironments, n_copies: int, box: Box) -> Yardsticks:
    """Play both on these copies, from the same first states; BrokenEnvironmentError where an episode does not end."""
    seeds = np.random.SeedSequence(SEED).generate_state(n_copies)
    means = [play(name, envs, seeds, act(box), N_EPISODES).mean() for act in (nothing, at_random)]
    return Yardsticks(*map(float, means))


def yardsticks_on(task: Task, box: Box) -> Yardsticks:
    """Play both on copies of an environment, or on those given; UsageError for one that is being trained on."""
    with opened(task, N_EPISODES) as (envs, n_copies):
        return yardsticks(task.name, envs, n_copies, box)
