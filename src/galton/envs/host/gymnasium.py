"""A Gymnasium environment: copies of it, stepped one after the other, every answer checked."""

import contextlib
import dataclasses
import functools
import sys
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Float, Integer

from galton.envs.host import masks
from galton.envs.host.actions import Actions
from galton.envs.host.answers import (
    FAULTS,
    LARGEST,
    as_float32,
    blame,
    one_flag,
    one_number,
    parts,
    shown,
    told,
    try_to_make,
)
from galton.envs.host.base import Steps
from galton.envs.host.carried import refuse_different, remember
from galton.envs.host.layers import layers_of
from galton.envs.host.moves import Moves, moves_of
from galton.envs.host.observations import Observations
from galton.envs.host.state import Env, get_state, is_monitor, is_restorable, set_state
from galton.errors import BrokenEnvironmentError, UsageError, require

_NAMELESS = ("<lambda>", "partial")
"""The names that stand for functions without one, until the environment that they make is known."""


class GymnasiumTask:
    """A Gymnasium environment: an id, a class or a function with its keyword arguments, or one that is there.

    Raises:
        UsageError: an id that Gymnasium doesn't know, a function that fails, spaces that Galton can't use.
    """

    n_threads = 1

    def __init__(self, source: str | Env | Callable[[], object], *, action_scale: float = 1.0, **kwargs: Any) -> None:
        self._given = source if isinstance(source, gymnasium.Env) else None
        self.given: int | None = None if self._given is None else 1
        self._made: list[weakref.ref[Env]] = []
        self._spare: list[Env] = []
        if isinstance(source, str):
            self.name: str = source
            make: Callable[..., object] = functools.partial(_make_named, source)
        else:
            make = functools.partial(_make_again, source) if isinstance(source, gymnasium.Env) else source
            if self._given is not None:
                (self._as_given,) = remember([layers_of(source)])
            self.name = getattr(source, "__name__", None) or type(getattr(source, "unwrapped", source)).__name__
        self._make = functools.partial(make, **kwargs)
        first = self._check(try_to_make(self.name, self._make)) if self._given is None else self._check(self._given)
        if self.name in _NAMELESS:
            self.name = type(first.unwrapped).__name__
        self._by_id = isinstance(source, str)
        with self._closing_at_failure([first]):
            self.actions = Actions(self.name, first.action_space, action_scale)
            mask = masks.first_of(self.name, first, self.actions.box)
            n_mask = 0 if mask is None else masks.n_entries(self.name, mask, self.actions.box)
            self.actions = dataclasses.replace(self.actions, n_mask=n_mask)
            self.observations = Observations(self.name, first.observation_space, n_mask)
        self._spare.append(first)
        if self._given is None:  # one that nobody came to need
            weakref.finalize(self, _close, self._spare).atexit = False

    @property
    def is_alone(self) -> bool:
        """True if it was given and is of no id, so that no other copy of it can be made."""
        return self._given is not None and self._given.spec is None

    def make(self, n_copies: int, n_threads: int = 1) -> "GymnasiumEnvs":
        """So many copies, in one thread; of an environment that was there, the first is itself."""
        envs: list[Env] = []
        with self._closing_at_failure(envs):
            envs.extend(self._spare.pop() if self._spare else self._make_another() for _ in range(n_copies))
            moves = () if self._by_id else moves_of(envs)  # what a function returns the user may hold too
        return GymnasiumEnvs(self, envs, moves)

    def _make_another(self) -> Env:
        env = self._check(try_to_make(self.name, self._make))
        with self._closing_at_failure([env]):
            if self._given is not None:
                refuse_different(self.name, layers_of(self._given), self._as_given, layers_of(env))
            for kind, first, other in (
                ("actions", self.actions.own, env.action_space),
                ("observations", self.observations.space, env.observation_space),
            ):
                require(first == other, f"{self.name}'s copies differ: one has {kind} {first}, another {other}")
        return env

    @contextlib.contextmanager
    def _closing_at_failure(self, envs: Sequence[Env]) -> Iterator[None]:
        """A time after which these environments are closed if it ends in an error; the user's own is not."""
        try:
            yield
        except BaseException:
            _close(env for env in envs if env is not self._given)
            raise

    def _check(self, env: object) -> Env:
        if not isinstance(env, gymnasium.Env):
            raise UsageError(
                f"{self.name} is {shown(env)}, not a gymnasium.Env; give a vector environment or a record itself, "
                "and for an environment of the old gym use shimmy"
            )
        with self._closing_at_failure([env]):
            self._check_spaces(env)
        require(
            all(earlier() is not env.unwrapped for earlier in self._made),
            f"{self.name} returned the same environment twice; it must make a new one at each call",
        )
        self._made = [earlier for earlier in self._made if earlier() is not None] + [weakref.ref(env.unwrapped)]
        return env

    def _check_spaces(self, env: Env) -> None:
        for name in ("action_space", "observation_space"):
            try:
                space = getattr(env, name, None)
            except FAULTS as error:
                raise UsageError(f"{self.name}'s {name} raised {told(error)}") from error
            require(
                isinstance(space, gymnasium.Space),
                f"{self.name}'s {name} is {shown(space)}; it must be a Gymnasium space",
            )


class GymnasiumEnvs:
    """M environments in a loop; those that Galton made are closed once nobody holds this any more."""

    def __init__(self, task: GymnasiumTask, envs: Sequence[Env], moves: Sequence[Moves]) -> None:
        self._name, self._actions, self._observations = task.name, task.actions, task.observations
        self._envs, self.moves = envs, moves
        self._n_steps = 0
        self._close = weakref.finalize(self, _close, [env for env in envs if env is not task._given])
        self._close.atexit = False

    @property
    def layers(self) -> list[list[Any]]:
        """For each copy its wrappers from the outside in, and the environment."""
        return [layers_of(env) for env in self._envs]

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin an episode in every copy, each with its own seed."""
        self._n_steps = 0
        return np.stack([self._reset(i, int(seed)) for i, seed in enumerate(seeds)])

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act, and reset where an episode ended."""
        self._n_steps += 1
        n = len(self._envs)
        final = np.ones((n, self._observations.size), self._observations.dtype)
        own = self._observations.size - self._observations.n_mask
        reward, terminated, truncated = np.empty(n, np.float32), np.empty(n, bool), np.empty(n, bool)
        raw: list[np.ndarray] = []
        following = final
        actions = self._actions.to_env(action)
        for i in range(n):
            where = self._where(i)
            observed, earned, ends, late, info = self._step(i, self._actions.one(actions, i), where)
            raw.append(self._observations.numbers(observed, where))
            with np.errstate(over="ignore", invalid="ignore"):  # looked at below
                final[i, :own] = raw[i].ravel()
            reward[i] = one_number(earned, "the reward", where)
            terminated[i] = one_flag(ends, "terminated", where)
            truncated[i] = one_flag(late, "truncated", where)
            over = terminated[i] or truncated[i]
            if own < final.shape[1] and not over:
                final[i, own:] = self._mask(i, info, where)
            if over:
                if not (np.abs(final[i]) <= LARGEST).all():  # before a reset may write over it
                    as_float32(raw[i], "the observation", where)
                following = final.copy() if following is final else following
                following[i] = self._reset(i, None)
            elif following is not final:
                following[i] = final[i]
        if not (np.abs(final) <= LARGEST).all():
            for i, values in enumerate(raw):
                as_float32(values, "the observation", self._where(i))
        return Steps(following, final, reward, terminated, truncated & ~terminated)

    def get_state(self) -> dict[str, np.ndarray] | None:
        """The states of environments with `get_state` and `set_state`, of their wrappers and their generators."""
        if not all(map(is_restorable, self._envs)):
            return None
        states = [get_state(env, self._where(i)) for i, env in enumerate(self._envs)]
        shapes = [{key: value.shape for key, value in state.items()} for state in states]
        for i, shape in enumerate(shapes):
            if shape != shapes[0]:
                raise BrokenEnvironmentError(f"{self._where(i)}: get_state returned {shape}, but copy 0 {shapes[0]}")
        return {key: np.stack([state[key] for state in states]) for key in states[0]}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Put every copy into the state that `get_state` told of it."""
        for i, env in enumerate(self._envs):
            self._reset(i, None)  # wrappers want one before the first step
            set_state(env, {key: rows[i] for key, rows in state.items()}, self._where(i))

    def close(self) -> None:
        """Close what Galton made; an environment that the user gave stays open."""
        self._close()

    def _step(self, i: int, action: Any, where: str) -> tuple[object, ...]:
        try:  # `blame` does the same, more slowly
            answer = self._envs[i].step(action)
        except FAULTS as error:
            raise BrokenEnvironmentError(f"{where}: step raised {told(error)}") from error
        return parts(answer, "observation, reward, terminated, truncated, info", "step", where)

    def _reset(self, i: int, seed: int | None) -> Float[np.ndarray, " o"]:
        where = self._where(i)
        with blame(f"{where}: reset"):
            answer = self._envs[i].reset(seed=seed) if seed is not None else self._envs[i].reset()
        observed, info = parts(answer, "observation, info", "reset", where)
        row = self._observations.flatten(observed, f"{where}: reset")
        return np.append(row, self._mask(i, info, where).astype(row.dtype)) if self._actions.n_mask else row

    def _mask(self, i: int, info: object, where: str) -> Float[np.ndarray, " n_mask"]:
        return masks.checked(masks.of_one(self._envs[i], info, where), self._actions.box, where)

    def _where(self, i: int) -> str:
        return f"{self._name}, copy {i}, step {self._n_steps}"


def _close(envs: Iterable[Env]) -> None:
    for env in envs:
        with contextlib.suppress(*FAULTS):
            env.close()


def _make_named(name: str, **kwargs: Any) -> object:
    """An environment of a Gymnasium id, or of module:Class."""
    try:
        return gymnasium.make(name, **kwargs)
    except gymnasium.error.UnregisteredEnv:
        module, _, maker = name.partition(":")
        made = getattr(sys.modules.get(module), maker, None) if maker else None
        if not callable(made):
            raise
        return made(**kwargs)


def _make_again(env: Env) -> Env:
    """Another copy of an environment that the user made; SB3's Monitor around it adds nothing to be copied."""
    while is_monitor(env):
        env = env.env  # type: ignore[attr-defined]
    try:
        if env.spec is not None:
            return gymnasium.make(env.spec)
        cause = ""
    except Exception as error:
        cause = f" ({told(error)})"
    raise ValueError(
        f"only one copy of it was given; give its id, or a function that makes it, or evaluate on another: "
        f"evaluate(env=...) or Evaluate(env=...){cause}"
    )
