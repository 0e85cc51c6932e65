"""A task can be trained on; no copy of it exists yet."""

from typing import Protocol, runtime_checkable

from galton.envs.host.actions import Actions
from galton.envs.host.base import HostEnvironments
from galton.envs.host.observations import Observations
from galton.envs.host.space_json import to_json
from galton.errors import require


@runtime_checkable
class Task(Protocol):
    """A task is what `galton.envs.find` makes of any environment: a JaxTask, or one whose steps go through Python.

    Its spaces are checked: Galton can use them.
    """

    @property
    def name(self) -> str:
        """The name that messages and files have for it."""

    @property
    def actions(self) -> Actions:
        """The actions that policies take, as the environment has them and as a vector."""

    @property
    def observations(self) -> Observations:
        """The observations that a copy shows."""

    @property
    def n_threads(self) -> int:
        """The number of threads that may step different copies at once."""

    @property
    def given(self) -> int | None:
        """The number of copies that the user gave ready-made, which then are all; None if `make` makes them."""

    def make(self, n_copies: int, n_threads: int = 1) -> HostEnvironments:
        """So many copies to step from Python, on so many threads.

        Raises:
            UsageError: more than there are.
        """


def check_same_spaces(task: Task, actions: Actions, observations: Observations) -> None:
    """Raise UsageError unless an environment has the spaces of the model's own."""
    for kind, own, other in (("actions", actions, task.actions), ("observations", observations, task.observations)):
        same = to_json(own.space) == to_json(other.space)  # the order of a Dict's keys matters too
        require(same, f"env has {kind} {other.space}; the model's are {own.space}")
    told = f"env tells masks of {task.actions.n_mask} entries, and the model's has {actions.n_mask}"
    require(task.actions.n_mask == actions.n_mask, told)


def check_copies(task: Task, n_envs: int) -> None:
    """Raise UsageError for another number of copies than was given ready-made."""
    require(
        task.given in (None, n_envs),
        f"n_envs is {n_envs}, but {'one environment was' if task.given == 1 else f'{task.given} were'} given; "
        "leave n_envs out, or give an id or a function that makes the environment",
    )
