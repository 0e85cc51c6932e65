"""An entropy that is held: a bonus in units of the advantage, whose multiplier follows a target.

The surrogate mean(weight · loss) gets the bonus α · std(weight) · H. A reward that is c times as large makes both c
times as large, so that the same α means the same in every unit of reward.

The entropy is told as a share of the box, which means the same for every policy and in every number of dimensions:
e^(H/d) / k, or of a density e^(h/d) / (high − low). It is 1 for the uniform policy.

α is the multiplier of the constraint that the entropy equals its target, so it may have either sign. With the nats m
that a dimension's entropy is short of the target it is

    α = 0.2 · sinh(dual + 10 m), from entropy_alpha_min to 100, and dual ← dual + entropy_rate · m after each
    gradient step whose α was not at the bound already.

The dual variable climbs as that of soft actor-critic does (Haarnoja et al., 2018). By itself it would swing, for the
entropy needs many steps to follow; the part that is proportional to m damps it (Stooke et al., 2020). The sinh lets α
grow tenfold where the policy is about to collapse, and pass through 0. Against entropy α never outweighs the
advantages with the usual least α of −1: the policy narrows towards what they prefer. With a least α of 0 the entropy
may be anything above its target, the constraint of soft actor-critic. Neither Adam nor the clipping of gradients knows
of the dual variable.
"""

from typing import Annotated, Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from galton.errors import require
from galton.fields import Within
from galton.parts import Part
from galton.policies import Distribution, Policy
from galton.types import NotNegative, Number, Positive, Scalar

SCALE, GAIN = 0.2, 10.0
"""α with nothing in the sinh but 1, nearly, and how much a nat that is missing adds there."""
MOST = 100.0
"""The greatest α, however far the entropy is below its target."""
REACH = float(np.arcsinh(MOST / SCALE))
"""The bound of the dual variable either way: the value at which it alone makes α equal MOST."""

Dual = Any
"""The dual variable; () where no entropy is held."""


def log_share(policy: Policy, entropy: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """The logarithm of the share of the box that a uniform policy with this entropy fills in each dimension."""
    return entropy / len(policy.low) - policy.uniform_entropy


class Entropy(Part):
    """No entropy is held: the bonus has the weight ent_coef alone."""

    label: ClassVar[str] = "free"
    scalars: ClassVar[tuple[str, ...]] = ()
    """The names of what is told of a step."""

    def check(self, rows: int, remedy: str) -> None:
        """Raise UsageError unless a gradient step has rows enough."""

    def init(self) -> Dual:
        """The first dual variable."""
        return ()

    def at(self, step: Float[Array, ""], frozen: Bool[Array, ""]) -> "Entropy":
        """The entropy to hold at the update at this step; a frozen run's dual variable stays."""
        return self

    def coefficient(
        self,
        ent_coef: Number | None,
        policy: Policy,
        dual: Dual,
        distribution: Distribution,
        weight: Float[Array, " B"],
    ) -> Number | None:
        """The weight of the entropy in a gradient step; None is 0."""
        return ent_coef

    def follow(self, policy: Policy, dual: Dual, entropy: Scalar, going: Bool[Array, ""]) -> Dual:
        """The dual variable after a step at this entropy."""
        return dual

    def told(self, policy: Policy, dual: Dual, entropy: Scalar) -> dict[str, Scalar]:
        """The numbers that are told of a step, under the names of `scalars`."""
        return {}


class HeldEntropy(Entropy):
    """The policy's entropy is held: a bonus of weight α · std(weight) joins the fixed one, and α follows a target."""

    label: ClassVar[str] = "held"
    scalars: ClassVar[tuple[str, ...]] = ("entropy_share", "entropy_alpha")
    fixed: ClassVar[tuple[str, ...]] = ("entropy_start", "entropy_end", "entropy_steps")

    entropy_start: Positive = 0.5
    """The target at the start, as the share of the box that a uniform policy of that entropy would fill in each
    dimension: e^(H/d) / k for a histogram, e^(h/d) / (high − low) for a density."""
    entropy_end: Positive = 0.05
    """The target in the end, as such a share."""
    entropy_steps: NotNegative = 500_000.0
    """Environment steps in which the target goes from start to end, linearly in its logarithm; 0: it stays."""
    entropy_rate: Positive = 0.02
    """The step size of what decides α, per gradient step and nat that the entropy of a dimension is off its target."""
    entropy_alpha_min: Annotated[Number, Within(lambda x: np.isfinite(x) & (x <= 0), "finite, and 0 or less")] = -1.0
    """The least α. Below 0 a policy that is wider than its target is narrowed; with 0 the target is a floor, above
    which the policy is left alone."""

    def check(self, rows: int, remedy: str) -> None:
        """Raise UsageError unless a gradient step has rows enough for a standard deviation of advantages."""
        require(rows > 1, f"entropy_target needs more than one step in each gradient step: raise {remedy}")

    def init(self) -> Dual:
        """The first dual variable, 0."""
        return jnp.zeros(())

    def at(self, step: Float[Array, ""], frozen: Bool[Array, ""]) -> "HeldEntropy":
        """The hold whose target at the start is that of this step."""
        start, steps = jnp.asarray(self.entropy_start), jnp.asarray(self.entropy_steps)
        done = jnp.where(steps > 0, jnp.minimum(step / jnp.where(steps > 0, steps, 1.0), 1.0), 0.0)
        target = start * (self.entropy_end / start) ** done
        return self.replace(entropy_start=target, entropy_rate=jnp.where(frozen, 0.0, self.entropy_rate))

    def missing(self, policy: Policy, entropy: Scalar) -> Scalar:
        """The nats that the entropy of a dimension is short of its target; negative above it."""
        return jnp.log(self.entropy_start) - log_share(policy, entropy)

    def alpha(self, policy: Policy, dual: Dual, entropy: Scalar) -> Scalar:
        """The multiplier of a gradient step, at the entropy before it."""
        inside = jnp.clip(dual + GAIN * self.missing(policy, entropy), -20.0, 20.0)
        return jnp.clip(SCALE * jnp.sinh(inside), self.entropy_alpha_min, MOST)

    def coefficient(
        self,
        ent_coef: Number | None,
        policy: Policy,
        dual: Dual,
        distribution: Distribution,
        weight: Float[Array, " B"],
    ) -> Number:
        """The fixed weight plus α · std(weight). No gradient flows through it."""
        entropy = jax.lax.stop_gradient(distribution.entropy().mean())
        held = self.alpha(policy, dual, entropy) * weight.std()
        return held if ent_coef is None else ent_coef + held

    def follow(self, policy: Policy, dual: Dual, entropy: Scalar, going: Bool[Array, ""]) -> Dual:
        """The dual variable after a step of dual ascent on the policy's mean entropy.

        It stays where `going` is False, and where α is at the bound to which it would go on.
        """
        short, now = self.missing(policy, entropy), self.alpha(policy, dual, entropy)
        spent = jnp.where(short > 0, now >= MOST, now <= self.entropy_alpha_min)
        moved = jnp.clip(dual + self.entropy_rate * short, -REACH, REACH)
        return jnp.where(going & ~spent, moved, dual)

    def told(self, policy: Policy, dual: Dual, entropy: Scalar) -> dict[str, Scalar]:
        """The entropy's share of the box, and α."""
        share = jnp.exp(log_share(policy, entropy))
        return {"entropy_share": share, "entropy_alpha": self.alpha(policy, dual, entropy)}


ENTROPIES: dict[bool, type[Entropy]] = {False: Entropy, True: HeldEntropy}
"""The value of the word `entropy_target` chooses one of these."""
