"""The records that everything shares. Shapes: T steps, N environments, o observation and d action entries."""

from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from galton.fields import AtLeast, Within

Params = dict[str, Any]
"""A nested dictionary of arrays."""
Scalar = Float[Array, ""]
Count = Annotated[int, AtLeast(1)]
"""A number of things of which there must be at least one."""
Rule = Literal["mode", "mean", "median"]
"""The rule by which a softmax policy that does not explore chooses its action."""


Number = float | Float[Array, "*runs"]
"""One number, or one for each run."""
NotNegative = Annotated[Number, Within(lambda x: np.isfinite(x) & (x >= 0), "finite, and 0 or more")]
Bonus = Annotated[Number | None, Within(lambda x: np.isfinite(x) & (x >= 0), "finite, and 0 or more")]
"""The weight of a term that no program has where the weight is 0 in every run."""
Finite = Annotated[Number, Within(np.isfinite, "finite")]
Positive = Annotated[Number, Within(lambda x: np.isfinite(x) & (x > 0), "finite, and greater than 0")]
Share = Annotated[Number, Within(lambda x: (x >= 0) & (x <= 1), "between 0 and 1")]


class Transition(NamedTuple):
    """One step, or with leading axes `[T, N]` a rollout of them."""

    observation: Float[Array, "*batch o"]
    """As the policy saw it, normalised where that is asked for."""
    action: Float[Array, "*batch d"]
    """As sampled, before the environment clips it."""
    reward: Float[Array, "*batch"]
    """As the critic learns it, scaled where that is asked for."""
    next_observation: Float[Array, "*batch o"]
    """The observation that the step led to, before any reset."""
    terminated: Bool[Array, "*batch"]
    """The task ended: the next state has no value."""
    truncated: Bool[Array, "*batch"]
    """The time limit cut the episode: the next state keeps its value."""


class Learner(NamedTuple):
    """All that a run has learnt, and the optimizer's memory and the statistics with it."""

    params: Params
    """`actor` and `critic` networks, and for the Gaussian `log_std` `[d]`."""
    optimizer: PyTree[Array]
    """Adam's count of steps and its moments, shaped like params, or what another optimizer keeps."""
    normalizer: Any
    """Statistics of observations and rewards, a Normalizer."""
    memory: dict[str, PyTree[Array]]
    """The memory that parts keep between updates beside these, by the agent's field: `algorithm` and `entropy`."""

    def remembering(self, **memory: PyTree[Array]) -> "Learner":
        """The same learner whose parts remember this."""
        return self._replace(memory=self.memory | memory)
