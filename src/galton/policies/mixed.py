"""A policy for actions of numbers and choices: any head for the numbers, and beside it a softmax over each choice."""

import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key, PyTree

from galton.errors import require
from galton.parts import Box
from galton.policies.base import Distribution, Family, MovesOutputs, Policy, Sequential
from galton.policies.binned import HistogramPolicy
from galton.policies.histogram import NOWHERE
from galton.types import Params, Rule

Part = tuple[Any, tuple[int, ...]]
"""A distribution, and the places of its entries in the action."""


@dataclasses.dataclass(frozen=True)
class Mixed:
    """A product of distributions, each of some entries of the action."""

    parts: Sequence[Part]

    def sample(self, noise: Sequence[PyTree[Array]]) -> Float[Array, "*batch d"]:
        """An action, each part's of its own noise."""
        return self._whole([part.sample(own) for (part, _), own in zip(self.parts, noise, strict=True)])

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """The sum of the parts' log-probabilities."""
        return self._sum([part.log_prob(action[..., np.array(places)]) for part, places in self.parts])

    def log_prob_of_bins(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """The same of parts that are all histograms."""
        return self._sum([part.log_prob_of_bins(action[..., np.array(places)]) for part, places in self.parts])

    def given(self, action: Float[Array, "*batch d"]) -> "Mixed":
        """The same, with the dimensions of a sequential part given the action's."""
        found = ((part, places, action[..., np.array(places)]) for part, places in self.parts)
        return Mixed([(part.given(own) if isinstance(part, Sequential) else part, at) for part, at, own in found])

    def entropy(self) -> Float[Array, "*batch"]:
        """The sum of the parts' entropies."""
        return self._sum([part.entropy() for part, _ in self.parts])

    def kl(self, other: "Mixed") -> Float[Array, "*batch"]:
        """The sum of the parts' divergences."""
        return self._sum([own.kl(of_other) for (own, _), (of_other, _) in zip(self.parts, other.parts, strict=True)])

    def kl_parts(self, other: "Mixed") -> dict[str, Float[Array, "*batch"]]:
        """The parts' own, those of one name added up."""
        found: dict[str, Float[Array, "*batch"]] = {}
        for (own, _), (of_other, _) in zip(self.parts, other.parts, strict=True):
            for name, part in own.kl_parts(of_other).items():
                found[name] = found[name] + part if name in found else part
        return found

    def std(self) -> Float[Array, "*batch d"]:
        """The standard deviation of each entry."""
        return self._whole([part.std() for part, _ in self.parts])

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Return True for numbers at the edge of their box."""
        return self._whole([part.at_edge(action[..., np.array(places)]) for part, places in self.parts])

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """The action taken without exploration: the parts', of a choice the most likely value."""
        return self._whole([part.deterministic_action() for part, _ in self.parts])

    def _whole(self, found: Sequence[Array]) -> Array:
        """The entries in the action's order."""
        places = np.concatenate([np.array(places) for _, places in self.parts])
        return jnp.concatenate(found, -1)[..., np.argsort(places)]

    def _sum(self, found: Sequence[Array]) -> Array:
        return jnp.stack(found).sum(0)


class MixedPolicy(Policy):
    """The network gives the outputs of the numbers' head, and then a logit for each value of each choice."""

    label: ClassVar[str] = "mixed"

    numbers: Policy = HistogramPolicy()
    """The head of the numbers; it has no box where all entries are choices."""
    of_choices: HistogramPolicy = HistogramPolicy()
    """The softmaxes over the values of the choices, on a box of these alone."""

    @property
    def family(self) -> Family:  # type: ignore[override]
        """The family of the numbers' head."""
        return self.numbers.family

    @property
    def has_kl(self) -> bool:  # type: ignore[override]
        """True if the numbers' head has one."""
        return self.numbers.has_kl

    @property
    def head(self) -> Policy:
        """The head of the numbers."""
        return self.numbers

    @property
    def _parts(self) -> list[tuple[Policy, tuple[int, ...]]]:
        numbers = [(self.numbers, self._box.numbers)] if self._box.numbers else []
        return [*numbers, (self.of_choices, self._box.choices)]

    def head_rates(self, distribution: Mixed) -> Float[Array, " n_outputs"] | None:
        """The numbers' own, and 1 for choices."""
        rates = self.numbers.head_rates(distribution.parts[0][0]) if self._box.numbers else None
        return None if rates is None else jnp.concatenate([rates, jnp.ones(self.of_choices.n_outputs)])

    @property
    def uniform_entropy(self) -> float:
        """The mean over all entries."""
        return sum(part.uniform_entropy * len(places) for part, places in self._parts) / len(self._box.low)

    @property
    def sizes(self) -> tuple[int, ...]:
        """The outputs of all numbers together, and then the logits of each choice."""
        return (self.numbers.n_outputs if self._box.numbers else 0, *self.of_choices.sizes)

    def acting_by(self, rule: Rule) -> "MixedPolicy":
        """The policy whose numbers' deterministic action is this one; a choice's is always its most likely value."""
        numbers = self.numbers.acting_by(rule)
        return self if numbers is self.numbers else self.replace(numbers=numbers)

    @property
    def n_outputs(self) -> int:
        """The outputs of the numbers' head, and a logit for each value of each choice."""
        return sum(part.n_outputs for part, _ in self._parts)

    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """The numbers' first outputs and parameters; choices are uniform."""
        first = [part.init() for part, _ in self._parts]
        return jnp.concatenate([outputs for outputs, _ in first]), first[0][1]

    @property
    def noise_marginals(self) -> tuple[PyTree[str], ...]:
        """The marginals of the numbers' noise where there are numbers, and of the choices'."""
        return tuple(getattr(part, "noise_marginals") for part, _ in self._parts)  # noqa: B009

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> tuple[PyTree[Array], ...]:
        """The noise of each part, of a key of its own."""
        return tuple(part.noise(jax.random.fold_in(key, i), shape) for i, (part, _) in enumerate(self._parts))

    def moved(self, outputs: Float[Array, "*batch n_outputs"], key: Key[Array, ""]) -> Float[Array, "*batch n_outputs"]:
        """The outputs as an update is to see them, where the numbers' head moves its own."""
        if not (self._box.numbers and isinstance(self.numbers, MovesOutputs)):
            return outputs
        own, others = jnp.split(outputs, [self.numbers.n_outputs], -1)
        return jnp.concatenate([self.numbers.moved(own, key), others], -1)

    def masked(
        self, outputs: Float[Array, "*batch n_outputs"], mask: Float[Array, "*batch m"]
    ) -> Float[Array, "*batch n_outputs"]:
        """The outputs of the choices far below 0 for values that the mask forbids."""
        own, others = jnp.split(outputs, [outputs.shape[-1] - mask.shape[-1]], -1)
        return jnp.concatenate([own, jnp.where(mask > 0, others, NOWHERE)], -1)

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Distribution:
        """The product of the parts' distributions."""
        sizes = [part.n_outputs for part, _ in self._parts]
        split = jnp.split(outputs, np.cumsum(sizes)[:-1], -1)
        found = zip(self._parts, split, strict=True)
        return Mixed([(part.distribution(own, params), places) for (part, places), own in found])


def acting_on(policy: Policy, box: Box) -> Policy:
    """The policy for actions in a box: its own, beside softmaxes where it has no bins for choices itself."""
    if type(policy) is HistogramPolicy or not (box.n_values or box.n_mask):
        return policy.on(box)
    if isinstance(policy, MixedPolicy):
        return acting_on(policy.numbers, box)
    numbers = policy.on(box.only(box.numbers)) if box.numbers else policy
    require(
        box.n_mask in (0, sum(box.n_values)),
        f"the environment's action mask has {box.n_mask} entries, some of bins; policy 'histogram' alone can have that",
    )
    of_choices = HistogramPolicy(box=box.only(box.choices)._replace(n_mask=box.n_mask))
    return MixedPolicy(box=box, head_scale=policy.head_scale, numbers=numbers, of_choices=of_choices)
