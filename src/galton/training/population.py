"""What `train` and `A2C` need of R runs that are trained side by side, wherever their environments live."""

from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from galton.training.state import Log
from galton.types import Hypers, Learner


@runtime_checkable
class Population(Protocol):
    """R runs of one Config. All arrays that go in or out are numpy's, with a leading axis R."""

    compile_seconds: float

    @property
    def step(self) -> int:
        """Environment steps of each run so far."""

    @property
    def learner(self) -> Learner:
        """What the runs have learnt."""

    @property
    def diverged_at(self) -> Int[np.ndarray, " R"]:
        """The step where a run's gradient was not finite, −1 while there is none."""

    def set_hypers(self, hypers: Hypers) -> None:
        """Go on with other numbers."""

    def advance(self, n_updates: int) -> None:
        """Train all runs. The results do not depend on how training is cut into calls.

        Raises:
            BrokenEnvironmentError: by its name; the learner stays what the last update made it.
        """

    def log(self) -> Log:
        """Of the updates since the last log; without evaluation."""

    def evaluate(self, n_episodes: int) -> Float[np.ndarray, "R n_episodes"]:
        """Undiscounted returns of whole episodes without exploration; training is not touched by it."""

    def snapshot(self) -> dict[str, Any]:
        """A pytree of arrays from which `restore` goes on exactly.

        Where the environments can't give their states its entry `environments` is missing, and `restore` begins new
        episodes.
        """

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go back to a snapshot of a population of the same shape."""

    def close(self) -> None:
        """Let go of environments that this population made."""
