"""Many runs of one configuration, trained side by side in one compiled program."""

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, Int, Key, UInt

from galton.algorithms import a2c
from galton.envs.base import Environment
from galton.errors import require, require_integer
from galton.losses import Loss, find_loss
from galton.training.evaluate import evaluate
from galton.training.rollout import Noise, draw_noise, rollout, start_episodes
from galton.types import Config, EpisodeState, Hypers, Learner, check_hypers


class RunState(NamedTuple):
    """All there is to one run between two log points."""

    learner: Learner
    episodes: EpisodeState
    key: Key[Array, ""]
    """Of everything random in training; the step, folded in, gives each rollout its own."""
    evaluation_key: Key[Array, ""]
    """Of the evaluations, so that they never touch training."""
    step: Int[Array, ""]
    """Environment steps so far."""
    diverged_at: Int[Array, ""]
    """The step of the first update whose gradient was not finite, −1 while there is none."""


class Log(NamedTuple):
    """What is recorded at each log point; NaN once the run has diverged. With axes `[R, L]` in a Result."""

    training_return: Float[Array, "*batch"]
    """Mean undiscounted return of the episodes that ended since the last log point; NaN where none did."""
    n_episodes: Float[Array, "*batch"]
    """How many those were."""
    evaluation_return: Float[Array, "*batch"]
    """Mean undiscounted return of the deterministic policy; NaN where evaluation is off."""
    entropy: Float[Array, "*batch"]
    """This and the rest: means over the updates since the last log point."""
    grad_norm: Float[Array, "*batch"]
    policy_loss: Float[Array, "*batch"]
    value_loss: Float[Array, "*batch"]


@dataclasses.dataclass(frozen=True)
class Result:
    """R trained runs, L log points each."""

    config: Config
    hypers: Hypers
    """Each field `[R]`."""
    seeds: Int[np.ndarray, " R"]
    steps: Int[np.ndarray, " L"]
    """Environment steps taken at each log point."""
    log: Log
    """numpy arrays `[R, L]`."""
    diverged_at: Int[np.ndarray, " R"]
    """−1 for a run that did not."""
    learner: Learner
    """Each leaf numpy, `[R, ...]`."""
    compile_seconds: float
    train_seconds: float

    @property
    def steps_per_second(self) -> float:
        """Environment steps of training, all runs together, per second; evaluation's time included."""
        return len(self.seeds) * float(self.steps[-1]) / self.train_seconds

    def final(self, metric: str, fraction: float = 0.05) -> Float[np.ndarray, " R"]:
        """A metric's mean over the last 5% of the log points (at least one) of each run.

        NaN for a diverged run. Points without a finished episode don't count; if all lack one, the last before
        them does.
        """
        curves = getattr(self.log, metric)
        last = curves[:, -max(1, round(fraction * len(self.steps))) :]
        known = ~np.isnan(last)
        mean = np.where(known, last, 0).sum(1) / np.maximum(known.sum(1), 1)
        latest = np.where(np.isnan(curves), -1, np.arange(curves.shape[1])).max(1)
        mean = np.where(known.any(1), mean, curves[np.arange(len(curves)), latest])
        return np.where(self.diverged_at >= 0, np.nan, mean)


def train(
    env: Environment,
    config: Config,
    hypers: Hypers,
    seeds: Sequence[int],
    total_timesteps: int,
    *,
    n_logs: int = 100,
    n_eval_episodes: int = 10,
    on_log: Callable[[int, Log], None] | None = None,
) -> Result:
    """Train R runs side by side, one per seed, on every JAX device of this process.

    Args:
        env: a hashable record of constants.
        config: shared by all runs.
        hypers: each field a number for all runs or an array `[R]`.
        seeds: R integers; a run is determined by its seed, its settings and `n_logs`' division of its steps.
        total_timesteps: per run; rounded up to whole updates and log points.
        n_logs: log points, at most one per update.
        n_eval_episodes: episodes of each evaluation at each log point; 0 turns evaluation off.
        on_log: called at each log point with the steps so far and the log's `[R]` arrays.

    Raises:
        UsageError: a number out of range.
    """
    check_arguments(hypers, seeds, total_timesteps, n_logs, n_eval_episodes)
    n_runs = len(seeds)
    n_updates = math.ceil(total_timesteps / (config.n_steps * config.n_envs))
    updates_per_log = math.ceil(n_updates / min(n_logs, n_updates))
    n_logs = math.ceil(n_updates / updates_per_log)
    steps = (1 + np.arange(n_logs)) * updates_per_log * config.n_steps * config.n_envs
    require(steps[-1] < 2**31, f"total_timesteps is {total_timesteps}; one run counts up to 2³¹ − 1 steps")

    # Runs are split evenly over devices: the last run is repeated to fill up, and the copies are dropped.
    n_devices = min(jax.device_count(), n_runs)
    padded = np.minimum(np.arange(math.ceil(n_runs / n_devices) * n_devices), n_runs - 1)
    all_hypers = Hypers._make(np.broadcast_to(np.asarray(h, np.float32), n_runs) for h in hypers)
    on_runs = NamedSharding(Mesh(jax.devices()[:n_devices], "runs"), PartitionSpec("runs"))

    start = time.perf_counter()
    begin, advance = _compile(
        env, config, find_loss(config.loss), updates_per_log, n_eval_episodes, len(padded), on_runs
    )
    compile_seconds = time.perf_counter() - start

    start = time.perf_counter()
    state = jax.device_put(begin(jnp.asarray(seeds, jnp.uint32)[padded]), on_runs)
    device_hypers = jax.device_put(jax.tree.map(lambda h: h[padded], all_hypers), on_runs)
    logs = []
    for step in steps:
        state, log = advance(state, device_hypers)
        logs.append(jax.tree.map(lambda x: np.asarray(x)[:n_runs], log))
        if on_log:
            on_log(int(step), logs[-1])
    learner, diverged_at = jax.tree.map(lambda x: np.asarray(x)[:n_runs], (state.learner, state.diverged_at))
    train_seconds = time.perf_counter() - start

    return Result(
        config,
        all_hypers,
        np.asarray(seeds),
        steps,
        jax.tree.map(lambda *x: np.stack(x, axis=1), *logs),
        diverged_at,
        learner,
        compile_seconds,
        train_seconds,
    )


def check_arguments(
    hypers: Hypers, seeds: Sequence[int], total_timesteps: int, n_logs: int, n_eval_episodes: int
) -> None:
    """Raise UsageError for what `train` can't take."""
    require(len(seeds) >= 1, "seeds is empty; give at least 1")
    for seed in seeds:
        require_integer("seed", seed, 0)
        require(seed < 2**32, f"seed is {seed}; it must be less than 2³²")
    require_integer("total_timesteps", total_timesteps, 1)
    require_integer("n_logs", n_logs, 1)
    require_integer("n_eval_episodes", n_eval_episodes, 0)
    check_hypers(hypers)
    for name, numbers in hypers._asdict().items():
        shape = np.shape(numbers)
        fits = shape in ((), (len(seeds),))
        require(fits, f"{name} has shape {shape}; it must be a number, or [{len(seeds)}]: one for each run")


@functools.lru_cache(maxsize=64)
def _compile(
    env: Environment,
    config: Config,
    loss: Loss,
    updates_per_log: int,
    n_eval_episodes: int,
    n_runs: int,
    on_runs: NamedSharding,
) -> tuple[Callable[..., RunState], Callable[..., tuple[RunState, Log]]]:
    """Two compiled functions: seeds → states, and (states, hypers) → the states and logs of the next log point."""
    del loss  # a part of the key: the loss of that name may have changed
    begin = jax.jit(lambda seeds: jax.lax.map(functools.partial(_begin, env, config), seeds))
    seeds = jax.ShapeDtypeStruct((n_runs,), jnp.uint32)
    advance = jax.shard_map(
        jax.vmap(functools.partial(_advance, env, config, updates_per_log, n_eval_episodes)),
        mesh=on_runs.mesh,
        in_specs=on_runs.spec,
        out_specs=on_runs.spec,
        check_vma=False,
    )
    place = functools.partial(
        jax.tree.map, lambda x: jax.ShapeDtypeStruct((n_runs, *x.shape[1:]), x.dtype, sharding=on_runs)
    )
    state = place(jax.eval_shape(begin, seeds))
    hypers = place(jax.tree.map(lambda _: jax.ShapeDtypeStruct((n_runs,), jnp.float32), Hypers()))
    return begin.lower(seeds).compile(), jax.jit(advance, donate_argnums=0).lower(state, hypers).compile()


def _begin(env: Environment, config: Config, seed: UInt[Array, ""]) -> RunState:
    """A new run."""
    init_key, episodes_key, key, evaluation_key = jax.random.split(jax.random.key(seed), 4)
    policy = a2c.make_policy(config, env.action_low, env.action_high)
    learner = a2c.init(init_key, config, policy, len(env.observation_low))
    episodes = start_episodes(episodes_key, env, config.n_envs)
    return RunState(learner, episodes, key, evaluation_key, jnp.int32(0), jnp.int32(-1))


def _advance(
    env: Environment, config: Config, n_updates: int, n_eval_episodes: int, state: RunState, hypers: Hypers
) -> tuple[RunState, Log]:
    """Train one run up to its next log point and evaluate it there."""
    policy = a2c.make_policy(config, env.action_low, env.action_high)
    batch_size = config.n_steps * config.n_envs

    def iteration(state: RunState, noise: Noise) -> tuple[RunState, tuple[Array, ...]]:
        episodes, batch, finished = rollout(env, policy, state.learner.params, state.episodes, noise)
        learner, diagnostics = a2c.update(config, policy, state.learner, batch, hypers)

        step = state.step + batch_size
        fine = jnp.isfinite(diagnostics.grad_norm) | (state.diverged_at >= 0)
        diverged_at = jnp.where(fine, state.diverged_at, step)
        sum_of_returns = jnp.where(finished.done, finished.undiscounted_return, 0.0).sum()
        record = (sum_of_returns, finished.done.sum(dtype=jnp.float32), *diagnostics)
        return RunState(learner, episodes, state.key, state.evaluation_key, step, diverged_at), record

    def iterations(state: RunState, _: None) -> tuple[RunState, tuple[Array, ...]]:
        steps = state.step + jnp.arange(n_drawn) * batch_size
        keys = jax.vmap(jax.random.fold_in, in_axes=(None, 0))(state.key, steps)
        noise = jax.vmap(lambda key: draw_noise(key, env, policy, config))(keys)
        return jax.lax.scan(iteration, state, noise)

    # A generator call costs as much for several updates as for one; each update has its own key all the same.
    n_drawn = max(n for n in range(1, 17) if n_updates % n == 0)
    state, records = jax.lax.scan(iterations, state, length=n_updates // n_drawn)
    sum_of_returns, n_episodes = records[0].sum(), records[1].sum()
    diagnostics = a2c.Diagnostics(*(record.mean() for record in records[2:]))

    evaluation_return = jnp.array(jnp.nan)
    if n_eval_episodes:
        key = jax.random.fold_in(state.evaluation_key, state.step)
        evaluation_return = evaluate(key, env, policy, state.learner.params, n_eval_episodes).mean()
    log = Log(
        training_return=jnp.where(n_episodes > 0, sum_of_returns / n_episodes, jnp.nan),
        n_episodes=n_episodes,
        evaluation_return=evaluation_return,
        entropy=diagnostics.entropy,
        grad_norm=diagnostics.grad_norm,
        policy_loss=diagnostics.policy_loss,
        value_loss=diagnostics.value_loss,
    )
    return state, jax.tree.map(lambda x: jnp.where(state.diverged_at < 0, x, jnp.nan), log)
