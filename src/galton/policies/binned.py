"""Policies over bins: the network gives the logits of one softmax per action dimension (§4.1)."""

import functools
import math
from typing import Annotated, ClassVar, Literal, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from galton.bins import Bins, Centers, PlacedBins, UnevenBins, stacked
from galton.errors import require
from galton.fields import AtLeast
from galton.parts import Box
from galton.policies.base import Family, Marginal, Policy
from galton.policies.exploration import init_clipped_gaussian_logits, init_gaussian_logits
from galton.policies.gaussian import Floor, Units, units_of
from galton.policies.histogram import NOWHERE, BinSample, Choices, Exploration, Histogram
from galton.policies.per_entry import Entry, etas, read, resolved
from galton.types import Finite, Params, Rule

PolicyT = TypeVar("PolicyT", bound="BinnedPolicy")
HistogramT = TypeVar("HistogramT", bound="HistogramPolicy")


class BinnedPolicy(Policy):
    """Policies over bins have this in common, before each makes its logits of the network's outputs."""

    family: ClassVar[Family] = "histogram"
    has_kl: ClassVar[bool] = True

    n_bins: Annotated[int, AtLeast(2)] = 100
    """Bins per action dimension, k (§4.1)."""
    bin_centers: Centers = "inside"
    """The bins are all of one width, so that their centers lie inside the box (§4.1), or the first and last center
    are the box's bounds, so that the bins at the ends are half as wide."""
    exploration: Exploration = "softmax"
    """The distribution to sample from: the policy's own, or the Gaussian with its moments (§5.2.3)."""
    bin_sample: BinSample = "center"
    """The action taken for a sampled bin: its center (§4.1), or any in it, drawn uniformly (footnote 3)."""
    deterministic_action: Rule = "mode"
    """The action without exploration."""
    log_std_init: Finite = 0.0
    """log σ of the Gaussian that it may start like."""
    log_std_min: Floor = -math.inf
    """A floor under it."""
    box_units: Units = 0.0
    """1: the policy's Gaussian is in units of the box; 0: in the environment's own."""

    def on(self: PolicyT, box: Box) -> PolicyT:
        """The policy for actions in this box.

        Raises:
            UsageError: a box that can't be cut into so many bins.
        """
        policy = super().on(box)
        _ = policy.bins
        return policy

    @property
    def bins(self) -> Bins:
        """The bins of the box."""
        return self._made_bins()

    def _made_bins(self, ordered: tuple[str, ...] = (), per_entry: tuple[str, ...] = ()) -> Bins:
        precision = jax.dtypes.canonicalize_dtype(np.float64).name
        return _bins(self._box, self.n_bins, self.bin_centers, ordered, per_entry, precision)

    @property
    def choices(self) -> Choices:
        """Return the choices that its distributions leave open."""
        return Choices(self.exploration, self.bin_sample, self.deterministic_action, self._box.n_mask > 0)

    @property
    def uniform_entropy(self) -> float:
        """The logarithm of the number of bins, the mean over dimensions."""
        bins = self.bins
        return float(np.log(bins.sizes if isinstance(bins, UnevenBins) else float(self.n_bins)).mean())

    @property
    def noise_marginals(self) -> Marginal:
        """Normal where a Gaussian explores, else uniform."""
        return "normal" if self.exploration == "gaussian" else "uniform"

    def noise(self, key: Key[Array, ""], shape: tuple[int, ...]) -> Float[Array, "*batch n"]:
        """Uniform, two per dimension where the place in the bin is drawn too; normal where a Gaussian explores."""
        d = len(self._box.low)
        if self.exploration == "gaussian":
            return jax.random.normal(key, (*shape, d))
        return jax.random.uniform(key, (*shape, d if self.bin_sample == "center" else 2 * d))


class HistogramPolicy(BinnedPolicy):
    """The network gives d · k logits."""

    label: ClassVar[str] = "softmax"

    initial_policy: Literal["uniform", "gaussian", "clipped-gaussian"] = "uniform"
    """The policy starts uniform, like the Gaussian policy inside its box ("Init Gaussian", §5.2.3), or like the actions
    that the environment makes of the Gaussian policy's: clipped, with the tails in the first and last bin."""
    ordered: tuple[str, ...] = ()
    """The choices whose values have an order, by name or place: a wide target then reaches neighbouring values of them,
    as it reaches neighbouring bins of a number."""
    per_entry: tuple[str, ...] = ()
    """The settings that single entries of the action have for themselves, each as entry.setting=value with a name, a
    place or * for all numbers; the settings are n_bins, bin_centers, initial_policy and eta. bin_centers may be
    "mu-law" here, or the centers themselves. `n_bins=(5, 9)` and `eta={"wheel": 2.0}` say the same."""
    head_rate: Literal["constant", "per-std"] = "constant"
    """The last layer's learning rate: the others', or that over 0.8 σ with the policy's own standard deviation in each
    dimension, in half-widths of the box and a bin or more. Under Adam and with wide targets the mean then moves about
    as far as a Gaussian's. TRPO's step has no rate, and takes no notice of it."""

    @property
    def bins(self) -> Bins:
        """The bins of the box, and a bin for each value of a choice."""
        return self._made_bins(self.ordered, self.per_entry)

    @property
    def n_outputs(self) -> int:
        """The k logits of each action dimension."""
        return sum(self.sizes)

    @property
    def sizes(self) -> tuple[int, ...]:
        """The logits of each action dimension."""
        bins = self.bins
        return bins.sizes if isinstance(bins, UnevenBins) else (bins.n_bins,) * len(bins.centers)

    def init(self) -> tuple[Float[Array, " dk"], Params]:
        """Uniform, or as the Gaussian policy starts with the same numbers; every choice is uniform."""
        shift, scale = (jnp.reshape(x, (-1, 1)) for x in units_of(self, self.box_units))
        std = scale * jnp.exp(jnp.maximum(self.log_std_init, self.log_std_min))
        if not isinstance(self.bins, UnevenBins):
            return started(self.initial_policy, self.bins, shift, std).ravel(), {}
        d = len(self.sizes)
        at = zip(*(jnp.broadcast_to(x, (d, 1)) for x in (shift, std)), strict=True)
        rows = zip(self.bins.dimensions, self.sizes, self.bins.is_choice, self.entries, at, strict=True)
        first = [
            jnp.zeros(size)
            if is_choice or isinstance(bins, tuple)
            else started(own.initial_policy, bins, *where).ravel()
            for bins, size, is_choice, own, where in rows
        ]
        return jnp.concatenate(first), {}

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The settings of each entry of the action, its own or the policy's."""
        return resolved(self.per_entry, self._box, Entry(self.n_bins, self.bin_centers, self.initial_policy))

    def distribution(self, outputs: Float[Array, "*batch dk"], params: Params) -> Histogram:
        """Softmax policies with these logits."""
        return Histogram(self.bins, self.by_dimension(outputs), self.choices)

    def check_own(self) -> None:
        """Raise UsageError for a setting of a single entry that is none."""
        for word in self.per_entry:
            read(word)

    def on(self: HistogramT, box: Box) -> HistogramT:
        """The policy for actions in this box.

        Raises:
            UsageError: a box that can't be cut into so many bins, or choices or masks that don't go with a setting.
        """
        for name in ("ordered", "per_entry"):
            told = f"{name} is {getattr(self, name)}; it goes with policy 'histogram', not {self.label!r}"
            require(not getattr(self, name) or type(self) is HistogramPolicy, told)
        for name in self.ordered:
            of_name = box.called(name)
            told = f"ordered names {name!r}, which is no choice of the action; its entries are {', '.join(box.told)}"
            require(bool(of_name) and set(of_name) <= set(box.choices), told)
        policy = super().on(box)
        for name in ("exploration", "bin_sample") if box.n_values or box.n_mask or self.per_entry else ():
            value, usual = getattr(self, name), getattr(HistogramPolicy, name)
            told = f"{name} is {value!r}; where actions are choices or masked, or bins differ, leave it at {usual!r}"
            require(value == usual, told)
        require(
            all(n in (0, size) for n, size in zip(box.mask_sizes, policy.sizes, strict=True)),
            f"n_bins is {self.n_bins}, and the environment's action mask has {box.n_mask} entries, which are "
            f"{max(box.mask_sizes)} for each number; make n_bins that",
        )
        return policy

    def masked(self, outputs: Float[Array, "*batch dk"], mask: Float[Array, "*batch m"]) -> Float[Array, "*batch dk"]:
        """The logits, far below 0 for values that the mask forbids; entries that it has nothing of stay as they are."""
        of_entry = jnp.split(mask, np.cumsum(self._box.mask_sizes)[:-1], -1)
        whole = [
            own if own.shape[-1] else jnp.ones((*mask.shape[:-1], size))
            for own, size in zip(of_entry, self.sizes, strict=True)
        ]
        return jnp.where(jnp.concatenate(whole, -1) > 0, outputs, NOWHERE)

    def head_rates(self, distribution: Histogram) -> Float[Array, " dk"] | None:
        """√(π/2) half-widths over σ, the mean of the batch's, for all bins of a dimension; 1 for a choice's values.

        They have no gradient.
        """
        if self.head_rate == "constant":
            return None
        std = jnp.maximum(distribution.std(), distribution.bins.width).reshape(-1, len(self.low)).mean(0)
        rates = math.sqrt(math.pi / 2) * (self.high - self.low) / 2 / jax.lax.stop_gradient(std)
        if isinstance(self.bins, UnevenBins):
            rates = jnp.where(self.bins.is_choice, 1.0, rates)
        return jnp.repeat(rates, np.array(self.sizes), total_repeat_length=sum(self.sizes))

    def by_dimension(self, outputs: Float[Array, "*batch dk"]) -> Float[Array, "*batch d k"]:
        """The network's outputs with an axis for the action dimensions and one for the bins."""
        if not isinstance(self.bins, UnevenBins):
            return outputs.reshape(*outputs.shape[:-1], *self.bins.centers.shape)
        found = jnp.split(outputs, np.cumsum(self.sizes)[:-1], -1)
        return stacked(found, self.bins.n_bins, NOWHERE)


def started(initial_policy: str, bins: Bins, shift: Float[Array, "*d 1"], std: Float[Array, "*d 1"]) -> Array:
    """The first logits of some dimensions' bins; bins that were placed have a Gaussian's by their widths too."""
    if initial_policy == "uniform":
        return jnp.zeros(bins.centers.shape)
    if initial_policy == "clipped-gaussian":
        return init_clipped_gaussian_logits(bins, shift, std)
    wide = np.log(np.diff(bins.edges) / bins.width) if isinstance(bins, PlacedBins) else 0.0
    return init_gaussian_logits(bins, shift, std) + wide


@functools.lru_cache(maxsize=256)
def _bins(
    box: Box,
    n_bins: int,
    bin_centers: Centers,
    ordered: tuple[str, ...],
    per_entry: tuple[str, ...],
    precision: str,
) -> Bins:
    del precision  # in which they are made
    low, high = box.arrays()
    if not box.n_values and not per_entry:
        return Bins(low, high, n_bins, bin_centers)
    entries, n_values = resolved(per_entry, box, Entry(n_bins, bin_centers)), box.n_values or (0,) * len(low)
    places = [i for name in ordered for i in box.called(name) if n_values[i] > 1]
    parts: list[Bins | tuple[float, int]] = []
    for i, (a, b, n) in enumerate(zip(map(float, low), map(float, high), n_values, strict=True)):
        of_order = Bins(a, b, n, "bounds") if i in places else (a, n)
        parts.append(of_order if n else entries[i].bins(a, b))
    return UnevenBins(parts, places, etas(entries))
