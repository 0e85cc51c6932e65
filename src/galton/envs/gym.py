"""Any Gymnasium environment: copies of it, stepped one after the other, every answer checked."""

import contextlib
import functools
import json
import weakref
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.wrappers import TimeLimit
from jaxtyping import Float, Integer

from galton.envs.base import Steps
from galton.envs.spaces import ActionBox, Observations, as_float32, as_numbers, shown
from galton.errors import BrokenEnvironmentError, UsageError, require

Env = gymnasium.Env[Any, Any]


class GymnasiumTask:
    """A Gymnasium environment by what makes it: an id, a function, or one that is already there.

    Args:
        source: an id (`module:Id` imports the module first), a function without arguments that returns an
            environment, or an environment.
        kwargs: for `gymnasium.make`, where source is an id.

    Raises:
        UsageError: an id that Gymnasium doesn't know, a function that fails, spaces that Galton can't use.
    """

    n_threads = 1

    def __init__(self, source: str | Env | Callable[[], Env], **kwargs: Any) -> None:
        self.given: int | None = 1 if isinstance(source, gymnasium.Env) else None
        self._given = source if isinstance(source, gymnasium.Env) else None
        self._spare: list[Env] = []
        self._made: list[weakref.ref[Env]] = []
        if isinstance(source, str):
            self.name: str = source
            self._make: Callable[[], Any] = functools.partial(gymnasium.make, source, **kwargs)
        else:
            require(not kwargs, f"env_kwargs is {kwargs}; it goes with an id, not with an environment that is there")
            self._make = source if callable(source) else functools.partial(_make_again, source)
            self.name = getattr(source, "__name__", None) or type(getattr(source, "unwrapped", source)).__name__
        first = self._try_to_make() if self._given is None else self._check(self._given)
        self._spare.append(first)
        self.action_space: Any = first.action_space
        self.observation_space: Any = first.observation_space
        self._actions = ActionBox(self.name, self.action_space)
        self._observations = Observations(self.name, self.observation_space)

    def make(self, n_copies: int, n_threads: int = 1) -> "GymnasiumEnvs":
        """That many copies, in one thread; of an environment that was there, the first is itself."""
        del n_threads
        envs = [self._spare.pop() if self._spare else self._make_another() for _ in range(n_copies)]
        return GymnasiumEnvs(self.name, envs, self._actions, self._observations, self._given)

    def _make_another(self) -> Env:
        env = self._try_to_make()
        for kind, first, other in (
            ("actions", self.action_space, env.action_space),
            ("observations", self.observation_space, env.observation_space),
        ):
            require(first == other, f"{self.name}'s copies differ: one has {kind} {first}, another {other}")
        return env

    def _try_to_make(self) -> Env:
        try:
            env = self._make()
        except Exception as error:
            raise UsageError(f"environment is {self.name!r}, which can't be made: {_told(error)}") from error
        return self._check(env)

    def _check(self, env: Any) -> Env:
        require(
            isinstance(env, gymnasium.Env),
            f"{self.name} is {shown(env)}, not a gymnasium.Env; for an environment of the old gym use shimmy",
        )
        for name in ("action_space", "observation_space"):
            try:
                space = getattr(env, name, None)
            except Exception as error:
                raise UsageError(f"{self.name}'s {name} raised {_told(error)}") from error
            require(
                isinstance(space, gymnasium.Space),
                f"{self.name}'s {name} is {shown(space)}; it must be a Gymnasium space",
            )
        require(
            all(made() is not env.unwrapped for made in self._made),
            f"{self.name} returned the same environment twice; it must make a new one at each call",
        )
        self._made = [made for made in self._made if made() is not None] + [weakref.ref(env.unwrapped)]
        return env


class GymnasiumEnvs:
    """M environments in a loop; `given` is not closed with the others."""

    def __init__(
        self, name: str, envs: Sequence[Env], actions: ActionBox, observations: Observations, given: Env | None
    ) -> None:
        self._name, self._envs, self._actions, self._observations = name, envs, actions, observations
        self._given = given
        self._n_steps = 0

    def reset(self, seeds: Integer[np.ndarray, " M"]) -> Float[np.ndarray, "M o"]:
        """Begin episodes."""
        self._n_steps = 0
        return np.stack([self._reset(i, int(seed)) for i, seed in enumerate(seeds)])

    def step(self, action: Float[np.ndarray, "M d"]) -> Steps:
        """Act, and reset where an episode ended."""
        self._n_steps += 1
        n = len(self._envs)
        final = np.empty((n, self._observations.size), np.float32)
        reward, terminated, truncated = np.empty(n, np.float32), np.empty(n, bool), np.empty(n, bool)
        raw: list[np.ndarray] = []
        following = final
        actions = self._actions.to_env(action)
        for i, env in enumerate(self._envs):
            where = self._where(i)
            try:
                answer = env.step(actions[i, ...])  # of a box without axes, an array too
            except Exception as error:
                raise BrokenEnvironmentError(f"{where}: step raised {_told(error)}") from error
            if not (isinstance(answer, tuple) and len(answer) == 5):
                raise BrokenEnvironmentError(
                    f"{where}: step returned {shown(answer)}; it must return "
                    "(observation, reward, terminated, truncated, info)"
                )
            raw.append(self._observations.numbers(answer[0], where))
            with np.errstate(over="ignore", invalid="ignore"):  # looked at below
                final[i] = raw[i].ravel()
            reward[i] = _reward(answer[1], where)
            terminated[i] = _flag(answer[2], "terminated", where)
            truncated[i] = _flag(answer[3], "truncated", where)
            if terminated[i] or truncated[i]:
                following = final.copy() if following is final else following
                following[i] = self._reset(i, None)
            elif following is not final:
                following[i] = final[i]
        if not np.isfinite(final).all():
            for i, values in enumerate(raw):
                as_float32(values, "the observation", self._where(i))
        return Steps(following, final, reward, terminated, truncated & ~terminated)

    def get_state(self) -> dict[str, np.ndarray] | None:
        """The states of environments with `get_state` and `set_state`, their time limits and their generators."""
        if not all(hasattr(env.unwrapped, "get_state") and hasattr(env.unwrapped, "set_state") for env in self._envs):
            return None
        rows: dict[str, list[np.ndarray]] = {}
        for i, env in enumerate(self._envs):
            with _blame(f"{self._where(i)}: get_state"):
                state = env.unwrapped.get_state()  # type: ignore[attr-defined]
            if not isinstance(state, dict):
                raise BrokenEnvironmentError(
                    f"{self._where(i)}: get_state returned {shown(state)}, not a dict of arrays"
                )
            own: dict[str, np.ndarray] = {}
            for key, value in state.items():
                numbers = as_numbers(value)
                if numbers is None:
                    raise BrokenEnvironmentError(
                        f"{self._where(i)}: get_state's {key!r} is {shown(value)}, not numbers"
                    )
                own[f"state/{key}"] = numbers
            own["elapsed_steps"] = np.array([limit._elapsed_steps or 0 for limit in _time_limits(env)], np.int64)
            with _blame(f"{self._where(i)}: np_random"):
                own["generator"] = generator_state(env.unwrapped.np_random)
            first = {key: values[0].shape for key, values in rows.items()}
            shapes = {key: value.shape for key, value in own.items()}
            if rows and shapes != first:
                raise BrokenEnvironmentError(f"{self._where(i)}: get_state returned {shapes}, but copy 0 {first}")
            for key, value in own.items():
                rows.setdefault(key, []).append(value)
        return {key: np.stack(values) for key, values in rows.items()}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """Go on from there."""
        own = {key.removeprefix("state/"): value for key, value in state.items() if key.startswith("state/")}
        for i, env in enumerate(self._envs):
            self._reset(i, None)  # wrappers want one before the first step
            with _blame(f"{self._where(i)}: set_state"):
                env.unwrapped.set_state({key: value[i] for key, value in own.items()})  # type: ignore[attr-defined]
            for limit, elapsed in zip(_time_limits(env), state["elapsed_steps"][i], strict=True):
                limit._elapsed_steps = int(elapsed)
            set_generator_state(env.unwrapped.np_random, state["generator"][i])

    def close(self) -> None:
        """Close what Galton made; an environment that the user gave stays open."""
        for env in self._envs:
            if env is not self._given:
                with contextlib.suppress(Exception):  # nothing is wanted of it any more
                    env.close()

    def _reset(self, i: int, seed: int | None) -> Float[np.ndarray, " o"]:
        where = self._where(i)
        with _blame(f"{where}: reset"):
            answer = self._envs[i].reset(seed=seed) if seed is not None else self._envs[i].reset()
        if not (isinstance(answer, tuple) and len(answer) == 2):
            raise BrokenEnvironmentError(f"{where}: reset returned {shown(answer)}; it must return (observation, info)")
        return self._observations.flatten(answer[0], f"{where}: reset")

    def _where(self, i: int) -> str:
        return f"{self._name}, copy {i}, step {self._n_steps}"


def generator_state(generator: np.random.Generator) -> np.ndarray:
    """A generator's state as bytes of JSON, for a checkpoint."""
    return np.frombuffer(
        json.dumps(generator.bit_generator.state, default=np.ndarray.tolist).encode().ljust(512), np.uint8
    )


def set_generator_state(generator: np.random.Generator, state: np.ndarray) -> None:
    """Undo `generator_state`."""
    generator.bit_generator.state = json.loads(state.tobytes())


@contextlib.contextmanager
def _blame(where: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        raise BrokenEnvironmentError(f"{where} raised {_told(error)}") from error


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _make_again(env: Env) -> Env:
    """Another copy of an environment that the user made."""
    if env.spec is None:
        raise ValueError("only one copy of it was given; give its id, or a function that makes it")
    made: Env = gymnasium.make(env.spec)
    return made


def _reward(value: Any, where: str) -> Any:
    if isinstance(value, float) and -_LARGEST <= value <= _LARGEST:  # np.float64 is one; NaN is not between
        return value
    number = as_numbers(value)
    if number is None or number.size != 1:
        raise BrokenEnvironmentError(f"{where}: the reward is {shown(value)}; it must be one number")
    return as_float32(number.reshape(()), "the reward", where)[()]


_LARGEST = float(np.finfo(np.float32).max)


def _flag(value: Any, name: str, where: str) -> bool:
    if value is True or value is False:
        return value
    scalar = value[()] if isinstance(value, np.ndarray) and value.shape == () else value
    if not isinstance(scalar, bool | np.bool):
        raise BrokenEnvironmentError(f"{where}: {name} is {shown(value)}; it must be True or False")
    return bool(scalar)


def _time_limits(env: Env) -> list[Any]:
    """The TimeLimit wrappers around an environment."""
    found = []
    while env is not env.unwrapped:
        if isinstance(env, TimeLimit):
            found.append(env)
        env = env.env  # type: ignore[attr-defined]
    return found
