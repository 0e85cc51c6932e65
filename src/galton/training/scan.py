"""A population on environments in pure JAX: whole log intervals in one compiled program, on every JAX device."""

import functools
import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, Int, PyTree, UInt

from galton import normalization
from galton.algorithms import a2c
from galton.envs.base import Environment
from galton.losses import Loss, find_loss
from galton.policies import Policy
from galton.training.evaluate import evaluate
from galton.training.rollout import Noise, draw_noise, rollout, start_episodes
from galton.training.state import Log, RunState, begin, learn, read_log, rollout_key
from galton.types import Config, EpisodeState, Hypers, Learner, Transition


class ScanState(NamedTuple):
    """One run and its environments."""

    run: RunState
    episodes: EpisodeState


class ScanPopulation:
    """R runs on an Environment record. They are split evenly over devices, the last repeated to fill up.

    Args:
        env: a hashable record of constants.
        config: shared by all runs.
        hypers: each field `[R]`.
        seeds: one for each run, 0 … 2³² − 1.
        interval: updates between log points, for which the program is laid out; any other number works too.
        devices: what to compute on.
    """

    def __init__(
        self,
        env: Environment,
        config: Config,
        hypers: Hypers,
        seeds: Sequence[int],
        interval: int,
        devices: Sequence[jax.Device],
    ) -> None:
        self._env, self._config, self._n_runs = env, config, len(seeds)
        n_devices = min(len(devices), self._n_runs)
        self._padded = np.minimum(np.arange(math.ceil(self._n_runs / n_devices) * n_devices), self._n_runs - 1)
        self._on_runs = NamedSharding(Mesh(devices[:n_devices], "runs"), PartitionSpec("runs"))
        start = time.perf_counter()
        self._programs = _compile(env, config, find_loss(config.loss), interval, len(self._padded), self._on_runs)
        self.compile_seconds = time.perf_counter() - start
        self.set_hypers(hypers)
        self._state = self._place(self._programs.begin(np.asarray(seeds, np.uint32)[self._padded]))
        self._batch: Transition | None = None

    @property
    def step(self) -> int:
        """Environment steps of each run so far."""
        return int(self._state.run.step[0])

    @property
    def learner(self) -> Learner:
        """What the runs have learnt, each leaf `[R, ...]`."""
        learner: Learner = self._fetch(self._state.run.learner)
        return learner

    @property
    def diverged_at(self) -> Int[np.ndarray, " R"]:
        """The step where a run's gradient was not finite, −1 while there is none."""
        diverged_at: np.ndarray = self._fetch(self._state.run.diverged_at)
        return diverged_at

    def set_hypers(self, hypers: Hypers) -> None:
        """Go on with other numbers."""
        self._hypers = self._place(jax.tree.map(lambda h: np.asarray(h, np.float32)[self._padded], hypers))

    def advance(self, n_updates: int) -> None:
        """Train all runs."""
        self._state, self._batch = self._programs.advance(self._state, self._hypers, np.int32(n_updates))

    def log(self) -> Log:
        """Of the updates since the last log; without evaluation."""
        run, log = self._programs.log(self._state.run, self._batch, self._hypers)
        self._state = self._state._replace(run=run)
        fetched: Log = self._fetch(log)
        return fetched

    def evaluate(self, n_episodes: int) -> Float[np.ndarray, "R n_episodes"]:
        """Undiscounted returns of whole episodes without exploration."""
        run = self._state.run
        program, seconds = _compile_evaluation(
            self._env, self._config, find_loss(self._config.loss), n_episodes, len(self._padded), self._on_runs
        )
        self.compile_seconds += seconds()
        returns: np.ndarray = self._fetch(program(run.evaluation_key, run.step, run.learner))
        return returns

    def snapshot(self) -> dict[str, Any]:
        """Everything that goes on."""
        run, episodes = self._fetch(self._state._replace(run=without_keys(self._state.run)))
        return {"run": run, "environments": episodes}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go back to a snapshot of a population of the same shape."""
        state = ScanState(snapshot["run"], snapshot["environments"])
        padded = jax.tree.map(lambda x: np.asarray(x)[self._padded], state)
        self._state = self._place(padded._replace(run=with_keys(padded.run)))

    def close(self) -> None:
        """Nothing to let go of."""

    def _place(self, tree: Any) -> Any:
        return jax.device_put(tree, self._on_runs)

    def _fetch(self, tree: Any) -> Any:
        return jax.tree.map(lambda x: np.asarray(x)[: self._n_runs], tree)


def without_keys(run: RunState) -> RunState:
    """Keys as plain numbers."""
    return run._replace(key=jax.random.key_data(run.key), evaluation_key=jax.random.key_data(run.evaluation_key))


def with_keys(run: RunState) -> RunState:
    """Plain numbers as keys."""
    key, evaluation_key = (jax.random.wrap_key_data(jnp.asarray(k)) for k in (run.key, run.evaluation_key))
    return run._replace(key=key, evaluation_key=evaluation_key)


class _Programs(NamedTuple):
    begin: Callable[..., ScanState]
    """Seeds → states."""
    advance: Callable[..., tuple[ScanState, Transition]]
    """(states, hypers, number of updates) → states and the last rollouts."""
    log: Callable[..., tuple[RunState, Log]]
    """(runs, the last rollouts, hypers) → runs and logs."""


@functools.lru_cache(maxsize=64)
def _compile(
    env: Environment, config: Config, loss: Loss, interval: int, n_runs: int, on_runs: NamedSharding
) -> _Programs:
    del loss  # a part of the key: the loss of that name may have changed
    policy = a2c.make_policy(config, env.action_low, env.action_high)
    n_drawn = max(n for n in range(1, 17) if interval % n == 0)
    begin_all = jax.jit(lambda seeds: jax.lax.map(functools.partial(_begin, env, config, policy), seeds))
    advance = _on_all_devices(functools.partial(_advance, env, config, policy, n_drawn), on_runs, (0, 0, None))
    log = _on_all_devices(functools.partial(read_log, config, policy), on_runs, (0, 0, 0))

    seeds = jax.ShapeDtypeStruct((n_runs,), jnp.uint32)
    state = _placed(jax.eval_shape(begin_all, seeds), on_runs)
    hypers = _placed(jax.tree.map(lambda _: jax.ShapeDtypeStruct((n_runs,), jnp.float32), Hypers()), on_runs)
    n = jax.ShapeDtypeStruct((), jnp.int32)
    batch = _placed(jax.eval_shape(advance, state, hypers, n)[1], on_runs)
    return _Programs(
        begin_all.lower(seeds).compile(),
        jax.jit(advance, donate_argnums=0).lower(state, hypers, n).compile(),
        jax.jit(log, donate_argnums=0).lower(state.run, batch, hypers).compile(),
    )


@functools.lru_cache(maxsize=64)
def _compile_evaluation(
    env: Environment, config: Config, loss: Loss, n_episodes: int, n_runs: int, on_runs: NamedSharding
) -> tuple[Callable[..., Array], Callable[[], float]]:
    """The program, and the seconds that compiling it took, told once."""
    del loss
    start = time.perf_counter()
    policy = a2c.make_policy(config, env.action_low, env.action_high)

    def program(key: Array, step: Array, learner: Learner) -> Array:
        return evaluate(jax.random.fold_in(key, step), env, policy, learner, n_episodes)

    begin_all = functools.partial(jax.lax.map, functools.partial(_begin, env, config, policy))
    run = _placed(jax.eval_shape(begin_all, jax.ShapeDtypeStruct((n_runs,), jnp.uint32)).run, on_runs)
    compiled = (
        jax.jit(_on_all_devices(program, on_runs, (0, 0, 0))).lower(run.evaluation_key, run.step, run.learner).compile()
    )
    seconds = [time.perf_counter() - start]
    return compiled, lambda: seconds.pop() if seconds else 0.0


def _on_all_devices(f: Callable[..., Any], on_runs: NamedSharding, in_axes: tuple[int | None, ...]) -> Any:
    """Over runs: side by side on a device, and split over devices. An argument without an axis is shared."""
    specs = tuple(PartitionSpec() if axis is None else on_runs.spec for axis in in_axes)
    return jax.shard_map(
        jax.vmap(f, in_axes), mesh=on_runs.mesh, in_specs=specs, out_specs=on_runs.spec, check_vma=False
    )


def _placed(tree: PyTree[Any], on_runs: NamedSharding) -> Any:
    return jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=on_runs), tree)


def _begin(env: Environment, config: Config, policy: Policy, seed: UInt[Array, ""]) -> ScanState:
    run, episodes_key = begin(config, policy, len(env.observation_low), seed)
    episodes = start_episodes(episodes_key, env, config.n_envs)
    first = jax.vmap(env.observe)(episodes.env)
    learner = run.learner._replace(normalizer=normalization.observe(run.learner.normalizer, first))
    return ScanState(run._replace(learner=learner), episodes)


def _advance(
    env: Environment,
    config: Config,
    policy: Policy,
    n_drawn: int,
    state: ScanState,
    hypers: Hypers,
    n_updates: Int[Array, ""],
) -> tuple[ScanState, Transition]:
    """Train one run for some updates; also the last rollout, which the log looks at."""
    batch_size = config.n_steps * config.n_envs

    def iteration(state: ScanState, noise: Noise) -> tuple[ScanState, Transition]:
        episodes, learner, batch, finished = rollout(env, policy, state.run.learner, state.episodes, noise, hypers)
        run = learn(config, policy, state.run._replace(learner=learner), batch, finished, hypers)
        return ScanState(run, episodes), batch

    def iterations(carry: tuple[Array, ScanState, Transition]) -> tuple[Array, ScanState, Transition]:
        # A generator call costs as much for several updates as for one; each update has its own key all the same.
        done, state, batch = carry
        keys = jax.vmap(functools.partial(rollout_key, state.run))(jnp.arange(n_drawn) * batch_size)
        noise = jax.vmap(lambda key: draw_noise(key, env, policy, config))(keys)
        n = jnp.minimum(n_drawn, n_updates - done)
        state, batch = jax.lax.fori_loop(
            0, n, lambda i, carry: iteration(carry[0], jax.tree.map(lambda x: x[i], noise)), (state, batch)
        )
        return done + n, state, batch

    shape = jax.eval_shape(
        lambda: iteration(state, jax.tree.map(jnp.asarray, draw_noise(state.run.key, env, policy, config)))[1]
    )
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shape)
    _, state, batch = jax.lax.while_loop(lambda carry: carry[0] < n_updates, iterations, (jnp.int32(0), state, nothing))
    return state, batch
