"""A softmax over bins in one action dimension after the other, each of which knows the ones before it."""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtri
from jaxtyping import Array, Bool, Float

from galton.policies.binned import HistogramPolicy
from galton.policies.histogram import Histogram
from galton.types import Count, Params

PREFIXES = 32
"""Actions that entropy and standard deviation are means over."""


@dataclasses.dataclass(frozen=True)
class Autoregressive:
    """Π_l softmax(z_l + V_l tanh(f + Σ_{j<l} E_j[a_j's bin])) over the bins of each dimension l; the first has z alone.

    Losses see the softmaxes after an action's own entries, `given`.
    """

    first: Histogram
    """The softmaxes of the logits z."""
    features: Float[Array, "*batch m"]
    """f, which the network gives."""
    embedding: Float[Array, "e k m"]
    """E, for each dimension but the last, e = d − 1."""
    readout: Float[Array, "e m k"]
    """V, for each dimension but the first."""

    def given(self, action: Float[Array, "*batch d"]) -> Histogram:
        """The independent softmaxes of each dimension after the entries of this action before it."""
        index = self.first.bins.encode(action)[..., :-1]
        seen = jnp.cumsum(self.embedding[jnp.arange(len(self.embedding)), index], -2)
        hidden = jnp.tanh(self.features[..., None, :] + seen)
        more = jnp.einsum("...em,emk->...ek", hidden, self.readout)
        return dataclasses.replace(self.first, logits=self.first.logits.at[..., 1:, :].add(more))

    def sample(self, noise: Float[Array, "*batch n"]) -> Float[Array, "*batch d"]:
        """An action, from the noise that HistogramPolicy.noise drew for this configuration."""
        d = self.first.logits.shape[-2]
        return self._one_by_one(lambda i, own: own.sample(noise[..., i::d]))

    def deterministic_action(self) -> Float[Array, "*batch d"]:
        """Each dimension's mode, mean or median after the ones before it."""
        return self._one_by_one(lambda _, own: own.deterministic_action())

    def log_prob(self, action: Float[Array, "*batch d"]) -> Float[Array, "*batch"]:
        """Σ_l log π(a_l | a_1, …, a_(l − 1))."""
        return self.given(action).log_prob(action)

    def at_edge(self, action: Float[Array, "*batch d"]) -> Bool[Array, "*batch d"]:
        """Return True for entries in the first or last bin of a dimension, or beyond."""
        return self.first.at_edge(action)

    def entropy(self) -> Float[Array, "*batch"]:
        """An estimate of the entropy: the mean of Σ_l H(· | a_1, …, a_(l − 1)) over 32 actions.

        There is no closed form. The actions are the same stratified draws each time. An update takes the entropy
        of what `given` makes of its own actions instead.
        """
        return self._of_actions(Histogram.entropy).mean(0)

    def std(self) -> Float[Array, "*batch d"]:
        """An estimate of the standard deviation, over the same actions, by the law of total variance."""
        mean, std = self._of_actions(lambda own: (own.mean(), own.std()))
        return jnp.sqrt((std**2).mean(0) + mean.var(0))

    def _one_by_one(self, choose: Callable[[int, Histogram], Float[Array, "*batch 1"]]) -> Float[Array, "*batch d"]:
        """The action whose entry i is chosen from the softmax of dimension i after the entries before it."""
        hidden, entries = self.features, list[Array]()
        for i in range(self.first.logits.shape[-2]):
            logits = self.first.logits[..., i : i + 1, :]
            if i:
                logits = logits + (jnp.tanh(hidden) @ self.readout[i - 1])[..., None, :]
            own = dataclasses.replace(self.first, bins=self.first.bins.only(i), logits=logits)
            entries.append(choose(i, own))
            if i < len(self.embedding):
                hidden = hidden + self.embedding[i][own.bins.encode(entries[-1])[..., 0]]
        return jnp.concatenate(entries, -1)

    def _of_actions(self, tell: Callable[[Histogram], Any]) -> Any:
        """The softmaxes after each of 32 actions tell this; one after the other, since they need much memory."""
        normal = self.first.choices.exploration == "gaussian"

        def of_one(u: Float[Array, " d"]) -> Any:
            noise = jnp.broadcast_to(ndtri(u) if normal else u, self.first.logits.shape[:-1])
            alone = dataclasses.replace(self.first, choices=self.first.choices._replace(bin_sample="center"))
            return tell(self.given(dataclasses.replace(self, first=alone).sample(noise)))

        return jax.lax.map(of_one, jnp.asarray(stratified(self.first.logits.shape[-2])))


def stratified(d: int) -> Float[np.ndarray, "n d"]:
    """Points of a Latin hypercube: each dimension has one in the middle of every one of 32 equal parts."""
    rng = np.random.default_rng(0)
    return np.stack([(rng.permutation(PREFIXES) + 0.5) / PREFIXES for _ in range(d)], -1)


class AutoregressivePolicy(HistogramPolicy):
    """The network gives d · k logits z and m features f: dimension l has z_l + V_l tanh(f + Σ_{j<l} E_j[a_j]).

    So any dependence between dimensions can be learned (Metz et al., 2019), in the form of NADE (Larochelle and Murray,
    2011): E_j[a_j] is a vector of the bin of the action's entry j. E and V are parameters beside the network. V starts
    at 0, and the policy as the independent softmaxes; E at standard normal numbers, the same in every run.
    """

    label: ClassVar[str] = "autoregressive softmax"

    prefix_width: Count = 64
    """The number of features m through which a dimension knows the ones before it."""

    @property
    def n_outputs(self) -> int:
        """The k logits of each action dimension, and then the features."""
        return super().n_outputs + self.prefix_width

    def init(self) -> tuple[Float[Array, " n_outputs"], Params]:
        """The softmax policy's first logits, features 0, V = 0 and E from a fixed key."""
        first, params = super().init()
        d, k, m = len(self.low), self.n_bins, self.prefix_width
        params["embedding"] = jax.random.normal(jax.random.key(0), (d - 1, k, m))
        return jnp.concatenate([first, jnp.zeros(m)]), params | {"readout": jnp.zeros((d - 1, m, k))}

    def distribution(self, outputs: Float[Array, "*batch n_outputs"], params: Params) -> Autoregressive:  # type: ignore[override]
        """The softmaxes of these logits and features, with the parameters E and V."""
        logits, features = jnp.split(outputs, [super().n_outputs], -1)
        return Autoregressive(super().distribution(logits, params), features, params["embedding"], params["readout"])

    def head_rates(self, distribution: Histogram) -> Float[Array, " n_outputs"] | None:
        """The rates of the softmax policy, and 1 for the features."""
        rates = super().head_rates(distribution)
        return None if rates is None else jnp.concatenate([rates, jnp.ones(self.prefix_width)])
