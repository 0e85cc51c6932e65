"""Who moves an environment: how training notices that somebody else reset or stepped what it trains on.

An environment that the user made may be in other hands too: in an `evaluate_policy(model, env)`, in a second model, in
the user's own loop. So its methods count their calls, on the object itself, below all wrappers: whoever finds more
calls than its own knows that the episode is no longer the one that it left.
"""

import functools
import weakref
from collections.abc import Callable, Iterable, Sequence
from typing import Any

_MOVING = ("reset", "step", "set_state", "reset_async", "step_async")
_FORWARDING = ("call", "call_async", "env_method")
"""Methods of vector environments that call one of their copies' methods by its name."""


class Moves:
    """The count of the resets and steps of one environment, and who trains on it.

    A copy of the environment, pickled or deep, begins with a count of its own.
    """

    def __init__(self) -> None:
        self.count = 0
        self.watch: weakref.ref[Watch] | None = None

    def __reduce__(self) -> tuple[type["Moves"], tuple[()]]:
        return Moves, ()

    @property
    def are_watched(self) -> bool:
        """True if somebody who is still there trains on the environment."""
        return self.watch is not None and self.watch() is not None


class Watch:
    """Training's own count of its environments' moves, by which it knows whether somebody else moved them."""

    def __init__(self, moves: Sequence[Moves]) -> None:
        self._moves, self._seen = moves, 0

    def begin(self) -> None:
        """Take the environments as they are now; they are training's until `end`, or until another watch begins."""
        for moves in self._moves:
            moves.watch = weakref.ref(self)
        self.renew()

    def end(self) -> None:
        """Let go of the environments."""
        for moves in self._moves:
            if moves.watch and moves.watch() is self:
                moves.watch = None

    def renew(self) -> None:
        """Take the environments as they are now."""
        self._seen = self._count()

    def others_moved(self) -> bool:
        """True if they were reset or stepped since they were taken as they were."""
        return self._count() != self._seen

    def _count(self) -> int:
        return sum(moves.count for moves in self._moves)


def moves_of(envs: Iterable[Any]) -> list[Moves]:
    """The counts of these environments' moves, below all wrappers; they are kept from now on."""
    return [_counted(env.unwrapped) for env in envs]


class _Counting:
    """A method of an environment that counts its calls."""

    def __init__(self, name: str, method: Callable[..., Any], moves: Moves) -> None:
        functools.update_wrapper(self, method)
        self.method, self.moves = method, moves
        self.forwards = name in _FORWARDING

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        if not self.forwards or arguments[:1] in (("reset",), ("step",)):
            self.moves.count += 1
        return self.method(*arguments, **keywords)


def _counted(env: Any) -> Moves:
    """The count of one environment's moves; its methods keep it from now on."""
    own = vars(env)  # written to directly, since the environment's class may refuse or forward new attributes
    known = own.get("reset")
    if isinstance(known, _Counting):
        return known.moves
    moves = Moves()
    for name in (*_MOVING, *_FORWARDING):
        method = getattr(env, name, None)
        if callable(method):
            own[name] = _Counting(name, method, moves)
    return moves
