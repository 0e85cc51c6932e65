"""Evaluation: whole episodes of the policy that does not explore, and what they return."""

import contextlib
import itertools
import warnings
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Integer, Key, PyTree

from galton import normalization
from galton.algorithms import Agent, actor_critic
from galton.envs.host.base import HostEnvironments
from galton.envs.host.layers import has_no_limit
from galton.envs.host.statistics import frozen
from galton.envs.jax_task import JaxTask
from galton.envs.task import Task
from galton.errors import BrokenEnvironmentError, UsageError
from galton.training.rollout import start_episodes
from galton.types import Learner

LONG = 10_000
"""Steps after which it is said of an episode that it may have no end, and after which evaluation cuts one that has no
time limit."""
LIMIT_IT = (
    "gymnasium.make(id, max_episode_steps=...), env_kwargs with an id, or gymnasium.wrappers.TimeLimit sets a limit"
)
MAX_STEPS = 100_000
"""An episode outside JAX that is longer is taken for one that never ends."""

Carry = tuple[PyTree[Array], Array, Array, Array]
"""The values that evaluation carries between steps: states, returns so far, which episodes still run, and the step."""


def deterministic_action(
    agent: Agent, learner: Learner, observation: Float[Array, "*batch o"]
) -> Float[Array, "*batch d"]:
    """The action taken without exploration, from observations that `normalization.from_origin` tells."""
    normalised = normalization.observation(learner.normalizer, observation)
    return actor_critic.distribution(agent, learner.params, normalised).deterministic_action()


def copies(task: Task, n_copies: int, n_threads: int = 1) -> HostEnvironments:
    """So many copies of a task to evaluate on; UsageError if training has one of them."""
    envs = task.make(n_copies, n_threads)
    if any(moves.are_watched for moves in envs.moves):
        envs.close()
        raise UsageError(
            f"{task.name} is being trained on and can't be copied, and evaluation would move it in the middle of an "
            "episode; evaluate on an environment of its own: evaluate(env=...) or Evaluate(env=...) takes an id or a "
            "function that makes it"
        )
    return envs


class Kept:
    """A task with the copies of it to evaluate on, made once for many evaluations; it is a Task that has these.

    Of an environment that was given these are all that there are: episodes follow one another on them.
    """

    def __init__(self, task: Task, n_episodes: int) -> None:
        self.name, self.n_threads, self.given = task.name, task.n_threads, task.given or n_episodes
        self.actions, self.observations = task.actions, task.observations
        self._envs = copies(task, self.given)

    def make(self, n_copies: int, n_threads: int = 1) -> HostEnvironments:
        """The copies that there are."""
        assert n_copies == self.given
        return self._envs

    def close(self) -> None:
        """Close the copies that Galton made."""
        self._envs.close()


@contextlib.contextmanager
def opened(task: Task, n_episodes: int) -> Iterator[tuple[HostEnvironments, int]]:
    """The copies of a task for so many episodes and their number, closed at the end unless they are kept for more."""
    n_copies = task.given or n_episodes
    envs = copies(task, n_copies)
    try:
        yield envs, n_copies
    finally:
        if not isinstance(task, Kept):
            envs.close()


def play(
    name: str,
    envs: HostEnvironments,
    seeds: Integer[np.ndarray, " M"],
    act: Callable[[Float[np.ndarray, "M o"]], Float[np.ndarray, "M d"]],
    n_episodes: int,
) -> Float[np.ndarray, " n_episodes"]:
    """Undiscounted returns of whole episodes in M environments outside JAX, dealt out evenly.

    Statistics of wrappers stay what they are, and rewards are those that the environment gives. An episode without a
    time limit is cut after LONG steps, with a warning; BrokenEnvironmentError where one with a limit does not end.
    """
    n, found, cut = len(seeds), list[float](), False
    endless = np.array([has_no_limit(layers) for layers in envs.layers] or [False] * n)
    with frozen(envs.layers) as as_given:
        while len(found) < n_episodes:  # again only after a cut: what was cut goes on, so the next begins with a reset
            returns: list[list[float]] = [[] for _ in range(n)]
            wanted = (n_episodes - len(found) + n - 1 - np.arange(n)) // n
            observation = envs.reset(seeds)
            collected, length = np.zeros(n), np.zeros(n, int)
            while (active := np.array([len(own) for own in returns]) < wanted).any():
                steps = envs.step(act(observation))
                collected += as_given(steps.reward)
                length += 1
                too_long = endless & active & (length >= LONG)
                for i in np.flatnonzero(steps.terminated | steps.truncated | too_long):
                    if active[i]:
                        returns[i].append(collected[i])
                    collected[i], length[i] = 0.0, 0
                if too_long.any():
                    cut = True
                    wanted = np.minimum(wanted, [len(own) + (t > 0) for own, t in zip(returns, length, strict=True)])
                if envs.layers and (length[active] >= MAX_STEPS).any():  # others have the limit that they say
                    raise BrokenEnvironmentError(
                        f"{name}: an episode of evaluation did not end in {MAX_STEPS:,} steps; give the environment a "
                        "time limit (gymnasium.wrappers.TimeLimit) or turn evaluation off"
                    )
                observation = steps.observation
            found += itertools.chain(*returns)
            seeds = np.random.SeedSequence([int(seed) for seed in seeds]).generate_state(n)
    if cut:
        warnings.warn(
            f"{name} has no time limit, and an episode of evaluation was cut after {LONG:,} steps; {LIMIT_IT}",
            stacklevel=2,
        )
    return np.array(found)


def evaluate(
    key: Key[Array, ""],
    task: JaxTask,
    agent: Agent,
    learner: Learner,
    n_episodes: int,
    trained: PyTree[Array] = (),
) -> Float[Array, " n_episodes"]:
    """Undiscounted returns of whole episodes under the deterministic action, stepped side by side.

    They begin with what outlasts episodes in the states of training's copies, each leaf `[N, ...]`, if any are given.
    """
    reset_key, step_key = jax.random.split(key)
    start, env = start_episodes(reset_key, task, n_episodes), task.record
    start = start._replace(env=task.going_on(trained, start.env))
    noise = jax.vmap(jax.vmap(env.noise))(jax.random.split(step_key, (env.max_episode_steps, n_episodes)))

    def running(carry: Carry) -> Array:
        _, _, active, t = carry
        return active.any() & (t < env.max_episode_steps)

    def step(carry: Carry) -> Carry:
        states, returns, active, t = carry
        moved = normalization.from_origin(learner.normalizer, jax.vmap(task.observe)(states))
        action = deterministic_action(agent, learner, moved)
        states, reward, terminated = jax.vmap(task.step)(states, action, jax.tree.map(lambda x: x[t], noise))
        return states, returns + jnp.where(active, reward, 0.0), active & ~terminated, t + 1

    first = (start.env, start.undiscounted_return, jnp.ones(n_episodes, bool), jnp.int32(0))
    return jax.lax.while_loop(running, step, first)[1]
