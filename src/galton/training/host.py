"""A population on environments outside JAX: one `act` per step for all runs, one update per rollout.

Runs are dealt to groups, one for each thread that the task allows; a group has its own JAX device and steps without
waiting for the others.
"""

import functools
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from galton import normalization
from galton.algorithms import a2c
from galton.envs.host.action_box import ActionBox
from galton.envs.host.base import HostEnvironments, HostTask
from galton.envs.host.observations import Observations
from galton.losses import Loss, find_loss
from galton.normalization import Normalizer
from galton.training.evaluate import deterministic_action, play
from galton.training.scan import with_keys, without_keys
from galton.training.state import Finished, Log, RunState, begin, learn, read_log, rollout_key
from galton.types import Config, Hypers, Learner, Params, Transition


class HostPopulation:
    """R runs with N copies of a HostTask each.

    Args:
        task: what to train on.
        config: shared by all runs.
        hypers: each field `[R]`.
        seeds: one for each run, 0 … 2³² − 1.
        devices: what to compute on, each with a thread.

    Raises:
        UsageError: more copies than the task has.
        BrokenEnvironmentError: an environment broke in its first reset.
    """

    def __init__(
        self, task: HostTask, config: Config, hypers: Hypers, seeds: Sequence[int], devices: Sequence[jax.Device]
    ) -> None:
        n_groups = min(task.n_threads, len(devices), len(seeds))
        self._slices = [slice(part[0], part[-1] + 1) for part in np.array_split(np.arange(len(seeds)), n_groups)]
        self._groups: list[_Group] = []
        self._task, self._config, self._evaluators = task, config, {}  # type: ignore[var-annotated]
        self._seeds = np.asarray(seeds, np.uint32)
        self._pool = ThreadPoolExecutor(n_groups) if n_groups > 1 else None
        box = ActionBox(task.name, task.action_space)
        programs = _programs(config, find_loss(config.loss), tuple(box.low.tolist()), tuple(box.high.tolist()))
        size = Observations(task.name, task.observation_space).size
        start = time.perf_counter()
        for part, device in zip(self._slices, devices, strict=False):
            threads = max(1, task.n_threads // n_groups)
            self._groups.append(_Group(task, config, programs, size, len(box.low), self._seeds[part], device, threads))
        self.set_hypers(hypers)
        self._each(_Group.warm_up)
        self.compile_seconds = time.perf_counter() - start
        self._each(_Group.reset)

    @property
    def step(self) -> int:
        """Environment steps of each run so far."""
        return int(self._groups[0].runs.step[0])

    @property
    def learner(self) -> Learner:
        """What the runs have learnt, each leaf `[R, ...]`."""
        learner: Learner = self._join([group.runs.learner for group in self._groups])
        return learner

    @property
    def diverged_at(self) -> Int[np.ndarray, " R"]:
        """The step where a run's gradient was not finite, −1 while there is none."""
        diverged_at: np.ndarray = self._join([group.runs.diverged_at for group in self._groups])
        return diverged_at

    def set_hypers(self, hypers: Hypers) -> None:
        """Go on with other numbers."""
        for group, part in zip(self._groups, self._slices, strict=True):
            group.hypers = group.place(jax.tree.map(lambda h, part=part: np.asarray(h, np.float32)[part], hypers))

    def advance(self, n_updates: int) -> None:
        """Train all runs."""
        self._each(_Group.advance, n_updates)

    def log(self) -> Log:
        """Of the updates since the last log; without evaluation."""
        log: Log = self._join(self._each(_Group.log))
        return log

    def evaluate(self, n_episodes: int) -> Float[np.ndarray, "R n_episodes"]:
        """Undiscounted returns of whole episodes without exploration, on copies of their own."""
        for group in self._groups:
            group.make_evaluator(n_episodes)
        return np.concatenate(self._each(_Group.evaluate, n_episodes))

    def snapshot(self) -> dict[str, Any]:
        """Everything that goes on."""
        parts = [group.snapshot() for group in self._groups]
        if any(part["environments"] is None for part in parts):
            for part in parts:
                del part["environments"]
        joined: dict[str, Any] = self._join(parts)
        return joined

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go back to a snapshot of a population of the same shape."""
        for group, part in zip(self._groups, self._slices, strict=True):
            group.restore(jax.tree.map(lambda x, part=part: np.asarray(x)[part], snapshot))

    def close(self) -> None:
        """Let go of the environments and threads."""
        for group in self._groups:
            group.close()
        if self._pool:
            self._pool.shutdown()

    def _each(self, method: Callable[..., Any], *arguments: Any) -> list[Any]:
        if not self._pool:
            return [method(group, *arguments) for group in self._groups]
        futures = [self._pool.submit(method, group, *arguments) for group in self._groups]
        return [future.result() for future in futures]

    @staticmethod
    def _join(parts: list[Any]) -> Any:
        return jax.tree.map(lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves]), *parts)


class _Programs(NamedTuple):
    """Compiled at their first call on each device; all but the first are mapped over the runs of a group."""

    begin: Callable[..., RunState]
    """(observation size, seeds) → runs."""
    observe: Callable[..., RunState]
    """(runs, first observations `[P, N, o]`) → runs."""
    prepare: Callable[..., Array]
    """Runs → the noise of their next rollout `[P, T, N, n]`."""
    act: Callable[..., tuple[Array, Array | None]]
    """(params, normalizers, observations `[P, N, o]`, noise, t) → actions and, if it is on, normalised observations."""
    receive: Callable[..., Any]
    """(normalizers, rewards, dones, final and following observations, hypers) → as normalization.receive."""
    learn: Callable[..., RunState]
    """(runs, batch `[P, T, N]`, finished, hypers) → runs."""
    log: Callable[..., tuple[RunState, Log]]
    """(runs, batch, hypers) → runs and logs."""
    exploit: Callable[..., Array]
    """(learners, observations `[P, n, o]`) → deterministic actions."""


@functools.lru_cache(maxsize=64)
def _programs(config: Config, loss: Loss, low: tuple[float, ...], high: tuple[float, ...]) -> _Programs:
    del loss  # a part of the key: the loss of that name may have changed
    policy = a2c.make_policy(config, np.array(low, np.float32), np.array(high, np.float32))

    def begin_all(size: int, seeds: Array) -> RunState:
        runs: RunState = jax.lax.map(lambda seed: begin(config, policy, size, seed)[0], seeds)
        return runs

    def observe(run: RunState, observation: Array) -> RunState:
        learner = run.learner._replace(normalizer=normalization.observe(run.learner.normalizer, observation))
        return run._replace(learner=learner)

    def prepare(run: RunState) -> Array:
        return policy.noise(rollout_key(run), (config.n_steps, config.n_envs))

    def act(
        params: Params, normalizer: Normalizer, observation: Array, noise: Array, t: Array
    ) -> tuple[Array, Array | None]:
        normalised = normalization.observation(normalizer, observation)
        now = jax.lax.dynamic_index_in_dim(noise, t, keepdims=False)
        return a2c.act(policy, params, normalised, now), normalised if config.normalize_observation else None

    return _Programs(
        jax.jit(begin_all, static_argnums=0),
        jax.jit(jax.vmap(observe), donate_argnums=0),
        jax.jit(jax.vmap(prepare)),
        jax.jit(jax.vmap(act, (0, 0, 0, 0, None))),
        jax.jit(jax.vmap(normalization.receive)),
        jax.jit(jax.vmap(functools.partial(learn, config, policy)), donate_argnums=0),
        jax.jit(jax.vmap(functools.partial(read_log, config, policy)), donate_argnums=0),
        jax.jit(jax.vmap(functools.partial(deterministic_action, policy))),
    )


class _Group:
    """P runs that are stepped together by one thread on one device."""

    def __init__(
        self,
        task: HostTask,
        config: Config,
        programs: _Programs,
        observation_size: int,
        action_size: int,
        seeds: np.ndarray,
        device: jax.Device,
        n_threads: int,
    ) -> None:
        self._task, self._config, self._programs, self._device, self._seeds = task, config, programs, device, seeds
        self._shape, self._n_threads = (len(seeds), config.n_envs), n_threads
        self._observation_size, self._action_size = observation_size, action_size
        self._envs = task.make(len(seeds) * config.n_envs, n_threads)
        self._evaluator: HostEnvironments | None = None
        self._evaluator_episodes = 0
        self.hypers: Any = None
        """Placed by the population, each field `[P]`."""
        self._interrupted = False
        """Whether an exception left the environments in the middle of a rollout."""
        with jax.default_device(device):
            self.runs: RunState = self.place(programs.begin(observation_size, jnp.asarray(seeds)))
            self._times = [jnp.int32(t) for t in range(config.n_steps)]
        self._batch = self._empty_batch()

    def place(self, tree: Any) -> Any:
        """On this group's device."""
        return jax.device_put(tree, self._device)

    def reset(self) -> None:
        """Begin episodes."""
        seeds = [np.random.SeedSequence((int(seed), 0)).generate_state(self._config.n_envs) for seed in self._seeds]
        self._start(self._envs.reset(np.concatenate(seeds)))
        self.runs = self._programs.observe(self.runs, self._observation)

    def _start(self, observation: np.ndarray) -> None:
        self._observation = self._split(observation)
        self._length = np.zeros(self._shape, np.int32)
        self._return = np.zeros(self._shape)

    def advance(self, n_updates: int) -> None:
        """Train the runs."""
        if self._interrupted:
            self._start_anew()
        self._interrupted = True
        for _ in range(n_updates):
            self._batch, finished = self._rollout()
            self.runs = self._programs.learn(self.runs, self._batch, finished, self.hypers)
        self._interrupted = False

    def _rollout(self) -> tuple[Transition, Finished]:
        """T steps of the P · N environments; numpy arrays `[P, T, N, ...]`."""
        programs, runs, config = self._programs, self.runs, self._config
        batch, finished = self._empty_batch(), self._empty_finished()
        noise, learner = programs.prepare(runs), runs.learner
        normalizing = config.normalize_observation or config.normalize_reward
        params = _acting(learner.params)
        for t, device_t in enumerate(self._times):
            sampled, normalised = programs.act(params, learner.normalizer, self._observation, noise, device_t)
            action = np.asarray(sampled)
            observation = self._observation if normalised is None else np.asarray(normalised)
            steps = self._envs.step(action.reshape(-1, action.shape[-1]))
            reward, final, following = map(self._split, (steps.reward, steps.final_observation, steps.observation))
            terminated, truncated = map(self._split, (steps.terminated, steps.truncated))
            done = terminated | truncated
            self._length += 1
            self._return += reward
            finished.done[:, t], finished.undiscounted_return[:, t] = done, self._return
            finished.length[:, t] = self._length
            if done.any():
                self._length[done] = 0
                self._return[done] = 0.0
            if normalizing:
                normalizer, *received = programs.receive(
                    learner.normalizer, reward, done, final, following, self.hypers
                )
                reward, final = map(np.asarray, received)
                learner = learner._replace(normalizer=normalizer)
            values = (observation, action, reward, final, terminated, truncated)
            for column, value in zip(batch, values, strict=True):
                column[:, t] = value
            self._observation = following
        self.runs = runs._replace(learner=learner)
        return batch, finished

    def log(self) -> Log:
        """Of the updates since the last log."""
        self.runs, log = self._programs.log(self.runs, self._batch, self.hypers)
        return log

    def make_evaluator(self, n_episodes: int) -> None:
        """Copies of the task for evaluation, kept from one to the next."""
        if self._evaluator is None or self._evaluator_episodes != n_episodes:
            if self._evaluator:
                self._evaluator.close()
            self._evaluator, self._evaluator_episodes = (
                self._task.make(len(self._seeds) * n_episodes, self._n_threads),
                n_episodes,
            )

    def evaluate(self, n_episodes: int) -> Float[np.ndarray, "P n_episodes"]:
        """Whole episodes of the deterministic policy."""
        assert self._evaluator
        step = int(self.runs.step[0])
        seeds = [np.random.SeedSequence((int(seed), 1, step)).generate_state(n_episodes) for seed in self._seeds]
        learner = self.runs.learner

        def act(observation: np.ndarray) -> np.ndarray:
            action = np.asarray(self._programs.exploit(learner, self._split(observation)))
            return action.reshape(len(observation), -1)

        return self._split(play(self._task.name, self._evaluator, np.concatenate(seeds), act))

    def snapshot(self) -> dict[str, Any]:
        """Everything that goes on; `environments` is None where they can't tell their states."""
        own = {"observation": self._observation, "length": self._length, "return": self._return}
        state = None if self._interrupted else self._envs.get_state()
        environments = None if state is None else own | {key: self._split(value) for key, value in state.items()}
        return {"run": jax.tree.map(np.asarray, without_keys(self.runs)), "environments": environments}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go back; from the start of new episodes, with the normaliser as it was, if there are no states."""
        self.runs = self.place(with_keys(snapshot["run"]))
        if "environments" not in snapshot:
            self._start_anew()
            return
        self._interrupted = False
        state = dict(snapshot["environments"])
        self._observation, self._length, self._return = (
            np.array(state.pop(name)) for name in ("observation", "length", "return")
        )
        self._envs.set_state({key: value.reshape(-1, *value.shape[2:]) for key, value in state.items()})

    def _start_anew(self) -> None:
        """New episodes in the middle of a run."""
        step = int(self.runs.step[0])
        seeds = [np.random.SeedSequence((int(s), 2, step)).generate_state(self._config.n_envs) for s in self._seeds]
        self._start(self._envs.reset(np.concatenate(seeds)))
        self._interrupted = False

    def warm_up(self) -> None:
        """Compile all programs but those of evaluation."""
        p, n = self._shape
        runs = jax.tree.map(jnp.copy, self.runs)
        zeros = np.zeros((p, n, self._observation_size), np.float32)
        noise = self._programs.prepare(runs)
        self._programs.act(_acting(runs.learner.params), runs.learner.normalizer, zeros, noise, self._times[0])
        if self._config.normalize_observation or self._config.normalize_reward:
            reward = np.zeros(self._shape, np.float32)
            self._programs.receive(runs.learner.normalizer, reward, reward > 0, zeros, zeros, self.hypers)
        runs = self._programs.learn(runs, self._batch, self._empty_finished(), self.hypers)
        jax.block_until_ready(self._programs.log(runs, self._batch, self.hypers))

    def close(self) -> None:
        """Let go of the environments."""
        self._envs.close()
        if self._evaluator:
            self._evaluator.close()

    def _split(self, rows: np.ndarray) -> np.ndarray:
        """From one row per copy to `[P, copies of a run, ...]`."""
        return rows.reshape(self._shape[0], -1, *rows.shape[1:])

    def _empty_batch(self) -> Any:
        shape = (self._shape[0], self._config.n_steps, self._shape[1])
        columns: list[Any] = [
            np.zeros((*shape, self._observation_size), np.float32),
            np.zeros((*shape, self._action_size), np.float32),
            np.zeros(shape, np.float32),
            np.zeros((*shape, self._observation_size), np.float32),
            np.zeros(shape, bool),
            np.zeros(shape, bool),
        ]
        return Transition(*columns)

    def _empty_finished(self) -> Any:
        shape = (self._shape[0], self._config.n_steps, self._shape[1])
        columns: list[Any] = [np.zeros(shape, bool), np.zeros(shape, np.float32), np.zeros(shape, np.int32)]
        return Finished(*columns)


def _acting(params: Params) -> Params:
    """What acting needs: each array that a program is given costs time, and the critic is not asked."""
    return {name: value for name, value in params.items() if name != "critic"}
