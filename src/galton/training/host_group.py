"""The training loop on environments outside JAX: P runs that one thread steps together on one device."""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree, UInt

from galton.algorithms import Agent
from galton.envs.host.base import Steps
from galton.envs.host.carried import go_on, remember
from galton.envs.host.moves import Watch
from galton.envs.host.statistics import MOMENTS, scaling_rewards, set_moments, statistics_of, unscaled
from galton.envs.task import Task
from galton.errors import BrokenEnvironmentError, DivergenceError, SharedEnvironment
from galton.normalization import Normalizer, from_origin_on_host, in_new_episodes
from galton.parts import at
from galton.policies.correlation import nothing_before
from galton.training.evaluate import LIMIT_IT, LONG
from galton.training.host_evaluation import Evaluator
from galton.training.host_programs import host_programs
from galton.training.log import Finished, Log
from galton.training.run import RunState, Snapshot, Tree, in_steps, over_all, reseeded, restored, stored
from galton.training.yardsticks import Yardsticks
from galton.types import Learner, Params, Rule, Transition

Shape = tuple[int, int, int]
"""P runs, T steps, N copies."""


class Group:
    """P runs with N copies of the task each, stepped and trained together; the agent's numbers are `[P]` each."""

    def __init__(
        self, task: Task, agent: Agent, seeds: UInt[np.ndarray, " P"], device: jax.Device, n_threads: int
    ) -> None:
        self._task, self._agent = task, agent
        self._device, self._seeds = device, seeds
        self._shape = (len(seeds), agent.rollout.n_envs)
        self._whole = (len(seeds), agent.rollout.n_steps, agent.rollout.n_envs)
        self._sizes = task.observations.size, len(agent.low)
        self._programs, self._acting = (host_programs(jax.tree.structure(each)) for each in (agent, at(agent, 0.0)))
        self._is_scheduled = self._acting is not self._programs
        self._normalizes = agent.rollout.normalize_observation or agent.rollout.normalize_reward
        self.evaluator = Evaluator(task, len(seeds), n_threads)
        self._interrupted = False
        """True if an exception left the environments in the middle of a rollout."""
        self._observation = np.zeros((*self._shape, self._sizes[0]), np.float32)
        self._length = np.zeros(self._shape, np.int32)
        self._numbers = self._place(jax.tree.leaves(agent))
        self._batch = _empty_batch(self._whole, *self._sizes)
        self.environments = task.make(len(seeds) * agent.rollout.n_envs, n_threads)
        self._watch = Watch(self.environments.moves)
        layers = self.environments.layers  # looked through once, and not before each update
        self._scaled = layers if any(map(scaling_rewards, layers)) else []

    def begin(self) -> None:
        """Make the runs, with their parameters and their first noise."""
        with jax.default_device(self._device):
            self.runs: RunState = self._place(
                self._programs.begin(self._numbers, self._sizes[0], jnp.asarray(self._seeds))
            )
            self._times = [jnp.int32(t) for t in range(self._agent.rollout.n_steps)]
            correlation = self._agent.rollout.noise_correlation
            self._noise = self._place(nothing_before(self._agent.policy, self._shape, correlation))

    def reset(self) -> None:
        """Begin the first episodes of training, whose observations the statistics count."""
        self._start(self.environments.reset(_environment_seeds(self._seeds, self._shape[1], 0)))
        self._at_first = remember(self.environments.layers)
        if self._agent.rollout.normalize_observation:
            n_in = self._sizes[0] - self._agent.box.n_mask
            origin = self._place(self._observation[:, 0, :n_in].astype(np.float32))
            learner = self.runs.learner._replace(normalizer=self.runs.learner.normalizer._replace(origin=origin))
            self.runs = self.runs._replace(learner=learner)
            self.runs = self._programs.observe(self.runs, self._from_origin(self._observation))

    def decay_over(self, begin: int, end: float) -> None:
        """Let learning rates that fall over all that is trained (decay_steps = inf) fall from one step to another."""
        self._numbers = self._place(jax.tree.leaves(over_all(self._agent, begin, end)))

    @property
    def step(self) -> int:
        """The environment steps that each run has taken."""
        return int(in_steps(self._agent, self.runs.updates[0]))

    @property
    def diverged_at(self) -> Int[np.ndarray, " P"]:
        """The step where a run's gradient was not finite, −1 while there is none."""
        return in_steps(self._agent, self.runs.diverged_at)

    @property
    def _now(self) -> PyTree[Array]:
        """The numbers of what acts: those of schedules are what they are at this step."""
        return self._programs.now(self._numbers, self.runs.updates) if self._is_scheduled else self._numbers

    def warm_up(self) -> None:
        """Compile what training runs, by a first call of each program on numbers of no meaning."""
        p, n = self._shape
        runs = jax.tree.map(jnp.copy, self.runs)
        zeros = np.zeros((p, n, self._sizes[0]), np.float32)
        noise = self._programs.prepare(self._numbers, runs)
        params = _acting(runs.learner.params)
        before, reward = self._noise_before(), np.zeros(self._shape, np.float32)
        normalizer, t = runs.learner.normalizer, self._times[0]
        self._acting.act(self._now, params, normalizer, zeros, noise, t, *before)
        if self._normalizes:
            received = reward, reward > 0, zeros, zeros
            self._acting.receive(self._now, normalizer, *received)
            self._acting.receive_and_act(self._now, params, normalizer, noise, t, *before, *received)
        runs = self._programs.learn(self._numbers, runs, normalizer, self._batch, _empty_finished(self._whole))
        jax.block_until_ready(self._programs.log(self._numbers, runs, self._batch))

    def advance(self, n_updates: int) -> None:
        """The training loop: act for n_steps steps, then learn from them."""
        if self._interrupted:
            self._start_anew()
        elif self._watch.others_moved():
            warnings.warn(
                f"{self._task.name} was reset or stepped by somebody else since training left it at step "
                f"{self.step:,}, and training begins a new episode there; give whoever evaluates an "
                "environment of its own",
                SharedEnvironment,
                stacklevel=2,
            )
            self._start_anew()
        self._interrupted, longest = True, self._length.max()
        with unscaled(self._scaled) as self._as_given:
            for _ in range(n_updates):
                normalizer, self._batch, finished = self._rollout()
                self.runs = self._programs.learn(self._numbers, self.runs, normalizer, self._batch, finished)
        self._interrupted = False
        if longest < LONG <= self._length.max():
            warnings.warn(
                f"an episode of {self._task.name} has lasted {LONG:,} steps and goes on. Without a time limit training "
                f"may never see a return; {LIMIT_IT}",
                stacklevel=2,
            )

    def _rollout(self) -> tuple[Normalizer, Transition, Finished]:
        """T steps of the P · N environments, numpy arrays `[P, T, N, ...]`, and the normaliser after them."""
        batch, finished = _empty_batch(self._whole, *self._sizes), _empty_finished(self._whole)
        noise, learner = self._programs.prepare(self._numbers, self.runs), self.runs.learner
        programs, now, params, normalizer = self._acting, self._now, _acting(learner.params), learner.normalizer
        moved, last = self._from_origin(self._observation), len(self._times) - 1
        acted = programs.act(now, params, normalizer, moved, noise, self._times[0], *self._noise_before())
        for t in range(last + 1):
            sampled, normalised, self._noise = acted
            action = np.asarray(sampled)
            observation = moved if normalised is None else np.asarray(normalised)
            steps = Steps(*map(self._split, self._step(action.reshape(-1, action.shape[-1]))))
            done = self._count(finished, t, steps)
            self._observation, moved = steps.observation, self._from_origin(steps.observation)
            final = self._from_origin(steps.final_observation) if done.any() else moved
            if not self._normalizes:
                reward = steps.reward
                if t < last:
                    device_t = self._times[t + 1]
                    acted = programs.act(now, params, normalizer, moved, noise, device_t, *self._noise_before())
            elif t < last:
                received = steps.reward, done, final, moved
                going_on = normalizer, noise, self._times[t + 1], *self._noise_before()
                (normalizer, reward, final), acted = programs.receive_and_act(now, params, *going_on, *received)
            else:
                normalizer, reward, final = programs.receive(now, normalizer, steps.reward, done, final, moved)
            values = (observation, action, reward, final, steps.terminated, steps.truncated)
            for column, value in zip(batch, values, strict=True):
                column[:, t] = value
        return normalizer, batch, finished

    def _noise_before(self) -> tuple[PyTree[Array], np.ndarray | tuple[()]]:
        """The noise that the next goes on from and where it begins anew; nothing where noise is not correlated."""
        return self._noise, () if self._agent.rollout.noise_correlation is None else self._length == 0

    def _step(self, action: np.ndarray) -> Steps:
        """Act in the environments, if they are where the last step left them."""
        if self._watch.others_moved():
            raise BrokenEnvironmentError(
                f"{self._task.name} was reset or stepped by somebody else in the middle of a rollout; give each its own"
            )
        try:
            steps = self.environments.step(action)
        except BrokenEnvironmentError as error:
            if np.isfinite(action).all():
                raise
            raise DivergenceError(
                f"{self._task.name} could not take the policy's action, which was not finite, in the update after step "
                f"{self.step:,}; the model keeps what it had learnt. An observation beyond 1e19 overflows the "
                "statistics that normalise it: bound it in the environment"
            ) from error
        self._watch.renew()
        return steps

    def _count(self, finished: Finished, t: int, steps: Steps) -> np.ndarray:
        """Write lengths and returns of the episodes after step t, and return which have ended `[P, N]`."""
        done = np.asarray(steps.terminated | steps.truncated)
        self._length += 1
        self._return += self._split(self._as_given(steps.reward.reshape(-1)))
        for column, value in zip(finished, (done, self._return, self._length), strict=True):
            column[:, t] = value
        if done.any():
            self._length[done] = 0
            self._return[done] = 0.0
        return done

    def log(self, begin_next: bool = True) -> Log:
        """The log of the updates since the last one, each number `[P]`."""
        runs, log = self._programs.log(self._numbers, self.runs, self._batch)
        if begin_next:
            self.runs = runs
        return log

    def evaluate(self, n_episodes: int, rule: Rule | None = None) -> Float[np.ndarray, "P n_episodes"]:
        """Undiscounted returns of whole episodes of the deterministic policy."""
        learner, structure = self.runs.learner, jax.tree.structure(at(self._agent.acting_by(rule), 0.0))
        now, exploit = self._now, host_programs(structure).exploit

        def act(observation: np.ndarray) -> np.ndarray:
            action = np.asarray(exploit(now, learner, self._from_origin(self._split(observation))))
            return action.reshape(len(observation), -1)

        seeds = _environment_seeds(self._seeds, n_episodes, 1, self.step)
        return self._split(self.evaluator.evaluate(self.environments.layers, self._at_first, seeds, act))

    def yardsticks(self) -> Yardsticks:
        """The returns of doing nothing and of random actions, on the copies that evaluation plays on."""
        return self.evaluator.yardsticks(self.environments.layers, self._at_first, self._agent.box)

    def put(self, learner: Learner) -> None:
        """Go on with something else learnt, each leaf `[P, ...]`."""
        never = jnp.full_like(self.runs.diverged_at, -1)
        self.runs = self.runs._replace(learner=self._place(learner), diverged_at=never)

    def reseed(self, seeds: UInt[np.ndarray, " P"]) -> None:
        """Draw all that is random from here on from other seeds; environments go on with their own generators."""
        self._seeds = seeds
        self.runs = self._place(reseeded(self.runs, seeds))

    def snapshot(self) -> Snapshot:
        """The snapshot that `restore` goes on from; without `environments` where they can't tell their states."""
        own: dict[str, Any] = {"observation": self._observation, "length": self._length, "return": self._return}
        if self._agent.rollout.noise_correlation is not None:
            own["noise"] = jax.tree.map(np.asarray, self._noise)
        state = None if self._interrupted or self._watch.others_moved() else self._state()
        snapshot: Snapshot = {"run": jax.tree.map(np.asarray, stored(self._agent, self.runs))}
        if state is not None:
            snapshot["environments"] = own | {key: self._split(value) for key, value in state.items()}
        if statistics := self._statistics():
            snapshot["statistics"] = statistics
        return snapshot

    def _statistics(self) -> dict[str, np.ndarray]:
        """The running statistics of the environments' wrappers, each `[P, N, ...]`."""
        of_copies = [statistics_of(layers) for layers in self.environments.layers]
        return {
            f"{place}/{name}": self._split(np.array([getattr(own[place], name) for own in of_copies]))
            for place in (of_copies[0] if of_copies else ())
            for name in MOMENTS
        }

    def _state(self) -> dict[str, np.ndarray] | None:
        """The state of the environments; None, with a warning, where one that is broken or closed can't tell it."""
        try:
            return self.environments.get_state()
        except BrokenEnvironmentError as error:
            warnings.warn(f"{error}; so this is without the environments, and goes on in new episodes", stacklevel=2)
            return None

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot; without states, to the start of new episodes with the normaliser as it was."""
        self.runs = self._place(restored(self._agent, snapshot["run"]))
        if "environments" not in snapshot:
            told = {name: np.concatenate(value) for name, value in snapshot.get("statistics", {}).items()}
            for i, layers in enumerate(self.environments.layers if told else ()):
                for place, statistics in statistics_of(layers).items():
                    moments = {name: told[f"{place}/{name}"][i] for name in MOMENTS if f"{place}/{name}" in told}
                    set_moments(statistics, moments)
            self._start_anew()
            return
        self._interrupted = False
        state = dict(snapshot["environments"])
        self._observation, self._length, self._return = (
            np.array(state.pop(name)) for name in ("observation", "length", "return")
        )
        self._noise = self._place(state.pop("noise", ()))
        self.environments.set_state({key: np.concatenate(value) for key, value in state.items()})
        self._watch.begin()

    def close(self) -> None:
        """Let go of the environments, those of evaluation too."""
        self._watch.end()
        self.environments.close()
        self.evaluator.close()

    def _from_origin(self, observation: Float[np.ndarray, "P n o"]) -> Float[np.ndarray, "P n o"]:
        """Observations as the programs take them."""
        return from_origin_on_host(self.runs.learner.normalizer, observation)

    def _start_anew(self) -> None:
        """Begin new episodes in the middle of a run, with seeds that its step decides."""
        self.runs = self.runs._replace(learner=in_new_episodes(self.runs.learner))
        for layers in self.environments.layers:
            go_on(layers, layers)
        self._start(self.environments.reset(_environment_seeds(self._seeds, self._shape[1], 2, self.step)))
        self._interrupted = False

    def _start(self, observation: np.ndarray) -> None:
        self._observation = self._split(observation)
        self._length, self._return = np.zeros(self._shape, np.int32), np.zeros(self._shape)
        self._watch.begin()

    def _place(self, tree: Tree) -> Tree:
        return jax.device_put(tree, self._device)

    def _split(self, rows: np.ndarray) -> np.ndarray:
        """One row per copy as an array `[P, copies of a run, ...]`."""
        n_runs = self._shape[0]
        return rows.reshape(n_runs, len(rows) // n_runs, *rows.shape[1:])


def _acting(params: Params) -> Params:
    """The parameters that acting needs: each array given to a program costs time, and the critic is not asked."""
    return {name: value for name, value in params.items() if name != "critic"}


def _empty_batch(shape: Shape, o: int, d: int) -> Transition:
    """Room for the transitions of a rollout, each array `[P, T, N, ...]`."""
    numbers = (np.zeros((*shape, *entries), np.float32) for entries in ((o,), (d,), (), (o,)))
    return Transition._make([*numbers, np.zeros(shape, bool), np.zeros(shape, bool)])


def _empty_finished(shape: Shape) -> Finished:
    """Room for what a rollout tells of its episodes, each array `[P, T, N]`."""
    return Finished._make([np.zeros(shape, dtype) for dtype in (bool, np.float32, np.int32)])


def _environment_seeds(seeds: UInt[np.ndarray, " P"], n: int, *purpose: int) -> UInt[np.ndarray, " M"]:
    """Seeds for n copies of each run: for training (0), evaluation at a step (1, step) or new episodes (2, step)."""
    sequences: list[Any] = [np.random.SeedSequence((int(seed), *purpose)) for seed in seeds]
    return np.concatenate([sequence.generate_state(n) for sequence in sequences])
