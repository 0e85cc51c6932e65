"""A population on environments in pure JAX: whole log intervals in one compiled program, on every JAX device."""

import functools
import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding
from jax.stages import Compiled
from jaxtyping import Array, Float, Int, PyTree, UInt

from galton import normalization
from galton.algorithms import Agent
from galton.envs.jax_task import JaxTask, RecordEnvironments
from galton.parts import at
from galton.policies.correlation import nothing_before
from galton.training.evaluate import evaluate
from galton.training.layout import Layout
from galton.training.log import Log
from galton.training.programs import kept
from galton.training.rollout import EpisodeState, Noise, draw_noise, rollout, start_episodes
from galton.training.run import (
    RunState,
    Snapshot,
    Tree,
    begin,
    in_steps,
    key_at,
    learn,
    over_all,
    over_runs,
    read_log,
    reseeded,
    restored,
    rollout_key,
    step_of,
    stored,
)
from galton.training.size import check_programs
from galton.training.yardsticks import N_EPISODES, Yardsticks, yardsticks
from galton.types import Learner, Rule, Transition


class DeviceState(NamedTuple):
    """One run and its environments; with a leading axis R in every leaf, R of them."""

    run: RunState
    episodes: EpisodeState


def iteration(task: JaxTask, agent: Agent, state: DeviceState, noise: Noise) -> tuple[DeviceState, Transition]:
    """One round of the training loop: act for n_steps steps, then learn from them. The rollout is returned too."""
    now = at(agent, step_of(agent, state.run.updates))
    episodes, normalizer, batch, finished, metrics = rollout(task, now, state.run.learner, state.episodes, noise)
    return DeviceState(learn(agent, state.run, normalizer, batch, finished, metrics), episodes), batch


def iterate(
    task: JaxTask, agent: Agent, state: DeviceState, n_updates: Int[Array, ""]
) -> tuple[DeviceState, Transition]:
    """Train one run for n_updates; its last rollout, which the log looks at, is returned too.

    Noise is drawn for a block of rollouts at once, since a call of the generator costs as much for several short ones
    as for one. Each rollout has its own key, so nothing depends on the blocks.
    """
    batch_size = agent.rollout.size
    n_drawn = min(16, max(1, _STEPS_DRAWN // batch_size))

    def block(carry: tuple[Array, DeviceState, Transition]) -> tuple[Array, DeviceState, Transition]:
        done, state, batch = carry
        keys = jax.vmap(functools.partial(rollout_key, agent, state.run))(jnp.arange(n_drawn))
        noise = jax.vmap(lambda key: draw_noise(key, task, agent))(keys)
        n = jnp.minimum(n_drawn, n_updates - done)
        state, batch = jax.lax.fori_loop(
            0,
            n,
            lambda i, carry: iteration(task, agent, carry[0], jax.tree.map(lambda x: x[i], noise)),
            (state, batch),
        )
        return done + n, state, batch

    shape = jax.eval_shape(lambda: iteration(task, agent, state, draw_noise(state.run.key, task, agent))[1])
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shape)
    _, state, batch = jax.lax.while_loop(lambda carry: carry[0] < n_updates, block, (jnp.int32(0), state, nothing))
    return state, batch


_STEPS_DRAWN = 2048
"""The most environment steps of noise that a block draws: up to 16 rollouts, or a single one that is longer."""


def begin_on_device(task: JaxTask, agent: Agent, seed: UInt[Array, ""]) -> DeviceState:
    """A new run at the start of its first episodes; the statistics have counted their observations."""
    run, episodes_key = begin(agent, task.observations.size, seed, task.metric_names)
    n_envs = agent.rollout.n_envs
    before = nothing_before(agent.policy, (n_envs,), agent.rollout.noise_correlation)
    episodes = start_episodes(episodes_key, task, n_envs)._replace(noise=before)
    if agent.rollout.resets == "first":
        episodes = episodes._replace(first=episodes.env)
    first = jax.vmap(task.observe)(episodes.env)
    learner = run.learner._replace(normalizer=normalization.begin(run.learner.normalizer, first))
    return DeviceState(run._replace(learner=learner), episodes)


class DevicePopulation:
    """R runs on an environment in JAX. They are split evenly over devices, the last repeated to fill up.

    Of a single run the copies of the environment are split, and each minibatch's gradient is that of all.
    All arrays that go in or out are numpy's, with a leading axis R.
    """

    def __init__(self, task: JaxTask, agent: Agent, seeds: Sequence[int], devices: Sequence[jax.Device]) -> None:
        self._n_runs = len(seeds)
        self._layout = Layout.of(devices, self._n_runs, agent.rollout.n_envs)
        n_parts = 1 if self._layout.of_copies else self._layout.mesh.size
        self._padded = np.minimum(np.arange(math.ceil(self._n_runs / n_parts) * n_parts), self._n_runs - 1)
        self._given = jax.tree.map(lambda number: np.asarray(number, np.float32)[self._padded], agent)
        self._task: JaxTask = jax.device_put(task, self._layout.everywhere)
        self._agent, self._shapes = self._place(self._given), (_shapes(task), _shapes(self._given))
        self._programs: _Programs | None = None
        start = time.perf_counter()
        begin_all = _compile_begin(*self._shapes, self._layout)
        self.compile_seconds = time.perf_counter() - start
        self._state = self._placed(begin_all(self._task, self._given, np.asarray(seeds, np.uint32)[self._padded]))
        self._batch: Transition | None = None

    @property
    def step(self) -> int:
        """The environment steps that each run has taken."""
        return int(in_steps(self._given, self._state.run.updates[0]))

    @property
    def learner(self) -> Learner:
        """All that the runs have learnt, each leaf `[R, ...]`."""
        return self._fetch(self._state.run.learner)

    @property
    def diverged_at(self) -> Int[np.ndarray, " R"]:
        """The step where a run's gradient was not finite, −1 while there is none."""
        diverged_at: Array = self._fetch(self._state.run.diverged_at)
        return in_steps(self._given, diverged_at)

    @property
    def environments(self) -> None:
        """None, since environments in JAX are states in the population's own."""

    def decay_over(self, begin: int, end: float) -> None:
        """Let learning rates that fall over all that is trained (decay_steps = inf) fall from one step to another."""
        self._agent = self._place(over_all(self._given, begin, end))

    def compile(self) -> None:
        """Compile what training runs, unless that is done; the first `advance` does it otherwise."""
        if self._programs is None:
            start = time.perf_counter()
            programs = _compile(*self._shapes, self._layout)
            self.compile_seconds += time.perf_counter() - start
            check_programs(programs, self._given, list(self._layout.mesh.devices.flat))
            self._programs = programs

    def advance(self, n_updates: int) -> None:
        """Train all runs for so many updates each. The results do not depend on how training is cut into calls."""
        self.compile()
        assert self._programs
        self._state, self._batch = self._programs.advance(self._task, self._agent, self._state, np.int32(n_updates))
        jax.block_until_ready(self._state.run.updates)

    def log(self, begin_next: bool = True) -> Log:
        """The log of the updates since the last one, each number `[R]`, without evaluation.

        With begin_next=False this one only looks: the next log has the same updates again.
        """
        assert self._programs
        run, log = self._programs.log(self._agent, self._state.run, self._batch)
        if begin_next:
            self._state = self._state._replace(run=run)
        return self._fetch(log)

    def evaluate(self, n_episodes: int, rule: Rule | None = None) -> Float[np.ndarray, "R n_episodes"]:
        """Undiscounted returns of whole episodes without exploration; training is not touched by it.

        The rule says which deterministic action is taken; None is the configuration's. The episodes are the same.
        """
        run, agent = self._state.run, self._agent.acting_by(rule)
        start = time.perf_counter()
        program = _compile_evaluation(self._shapes[0], _shapes(agent), n_episodes, self._layout)
        self.compile_seconds += time.perf_counter() - start
        trained = self._state.episodes.env if self._task.is_carried else ()
        given = (run.evaluation_key, run.updates, run.learner, trained)
        return np.asarray(self._fetch(program(self._task, agent, *given)))

    def check_evaluation(self, n_episodes: int) -> None:
        """Nothing to check: there are as many copies of the environment as one wants."""

    def yardsticks(self) -> Yardsticks:
        """The returns of doing nothing and of random actions, where the first run's evaluation plays."""
        task = self._task
        trained = jax.tree.map(lambda x: x[0], self._fetch(self._state.episodes.env)) if task.is_carried else ()
        return yardsticks(task.name, RecordEnvironments(task, trained), N_EPISODES, self._agent.box)

    def put(self, learner: Learner) -> None:
        """Go on with something else learnt, each leaf `[R, ...]`, also where a run had diverged."""
        padded = self._place(jax.tree.map(lambda x: np.asarray(x)[self._padded], learner))
        never = jnp.full_like(self._state.run.diverged_at, -1)
        self._state = self._state._replace(run=self._state.run._replace(learner=padded, diverged_at=never))

    def reseed(self, seeds: Sequence[int]) -> None:
        """Draw all that is random from here on from other seeds; the environments' noise is part of it."""
        run = reseeded(self._state.run, np.asarray(seeds, np.uint32)[self._padded])
        self._state = self._state._replace(run=self._place(run))

    def snapshot(self) -> Snapshot:
        """Runs and environments, from which `restore` goes on exactly."""
        run = stored(self._given, self._state.run)
        return self._fetch({"run": run, "environments": jax.tree.map(_plain, self._state.episodes)})

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of a population of the same shape."""
        padded = jax.tree.map(lambda x: np.asarray(x)[self._padded], dict(snapshot))
        episodes = jax.tree.map(_as_was, self._state.episodes, padded["environments"])
        self._state = self._placed(DeviceState(restored(self._given, padded["run"]), episodes))

    def close(self) -> None:
        """Do nothing, since environments in JAX hold nothing open."""

    def _place(self, tree: Tree) -> Tree:
        return jax.device_put(tree, self._layout.of_runs)

    def _placed(self, state: DeviceState) -> DeviceState:
        return jax.device_put(state, _shardings(self._layout, state))

    def _fetch(self, tree: Tree) -> Tree:
        return jax.tree.map(lambda x: np.asarray(x)[: self._n_runs], tree)


def _plain(leaf: Array) -> Array:
    """Return a leaf that can be fetched from a device: of random keys their numbers."""
    return jax.random.key_data(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf


def _as_was(like: Array, leaf: np.ndarray) -> Array | np.ndarray:
    """Return what `_plain` made such a leaf into as it was: numbers of keys as random keys."""
    is_key = jnp.issubdtype(like.dtype, jax.dtypes.prng_key)
    return jax.random.wrap_key_data(jnp.asarray(leaf), impl=jax.random.key_impl(like)) if is_key else leaf


class _Programs(NamedTuple):
    advance: Compiled
    """(task, agents, states, number of updates) → states and the last rollouts."""
    log: Compiled
    """(agents, runs, the last rollouts) → runs and logs."""


@kept
def _compile_begin(
    task: JaxTask, agent: Agent, layout: Layout
) -> Callable[[JaxTask, Agent, UInt[np.ndarray, " R"]], DeviceState]:
    """The program that makes new runs, for a task and an agent with numbers of these shapes."""
    return jax.jit(_begin_all(layout)).lower(task, agent, _seeds(agent)).compile()


@kept
def _compile(task: JaxTask, agent: Agent, layout: Layout) -> _Programs:
    """The programs that train, for a task and an agent with numbers of these shapes."""
    axes = (None, 0, 0, None)
    of_runs = over_runs(agent.algorithm.side_by_side, iterate, axes)
    advance, log = layout.on_all(of_runs, axes), layout.on_all(jax.vmap(read_log), (0, 0, 0))

    state = jax.eval_shape(_begin_all(layout), task, agent, _seeds(agent))
    state = jax.tree.map(_shape, state, _shardings(layout, state))
    agent = _shapes(agent, layout.of_runs)
    n = jax.ShapeDtypeStruct((), jnp.int32)
    batch = _shapes(jax.eval_shape(advance, task, agent, state, n)[1], layout.of_envs(2))
    given = jax.tree.map(lambda x: x.sharding, (state, batch))
    return _Programs(
        jax.jit(advance, out_shardings=given).lower(task, agent, state, n).compile(),
        jax.jit(log, out_shardings=layout.of_runs).lower(agent, state.run, batch).compile(),
    )


@kept
def _compile_evaluation(task: JaxTask, agent: Agent, n_episodes: int, layout: Layout) -> Callable[..., Array]:

    def program(
        task: JaxTask, agent: Agent, key: Array, updates: Array, learner: Learner, trained: PyTree[Array]
    ) -> Array:
        now = at(agent, step_of(agent, updates))
        return evaluate(key_at(agent, key, updates), task, now, learner, n_episodes, trained)

    axes = (None, 0, 0, 0, 0, 0)
    state = jax.eval_shape(_begin_all(layout), task, agent, _seeds(agent))
    run = _shapes(state.run, layout.of_runs)
    trained = jax.tree.map(_shape, state, _shardings(layout, state)).episodes.env if task.is_carried else ()
    given = (task, _shapes(agent, layout.of_runs), run.evaluation_key, run.updates, run.learner, trained)
    return jax.jit(layout.on_all(jax.vmap(program, axes), axes)).lower(*given).compile()


def _shardings(layout: Layout, state: DeviceState) -> DeviceState:
    return DeviceState(
        jax.tree.map(lambda _: layout.of_runs, state.run), jax.tree.map(lambda _: layout.of_envs(1), state.episodes)
    )


def _shape(x: Any, sharding: NamedSharding | None) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=sharding)


def _shapes(tree: Tree, sharding: NamedSharding | None = None) -> Tree:
    """The shapes of numbers, which programs are compiled for, all split over devices in the same way, or not."""
    return jax.tree.map(lambda x: _shape(x, sharding), tree)


def _seeds(agent: Agent) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(jax.tree.leaves(agent)[0].shape, jnp.uint32)


def _begin_all(layout: Layout) -> Callable[[JaxTask, Agent, UInt[Array, " R"]], DeviceState]:
    """Make new runs: all at once, but on a CPU one after the other, without a batch axis (`networks.last_layer`)."""
    if layout.mesh.devices.flat[0].platform != "cpu":
        return jax.vmap(begin_on_device, (None, 0, 0))
    return lambda task, agent, seeds: jax.lax.map(lambda run: begin_on_device(task, *run), (agent, seeds))
