"""Credits make of an advantage the weight of its action's loss.

A new way is a class of this kind, with the settings that it needs, and a line in CREDITS.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from galton.parts import Part
from galton.types import Positive

Rows = Float[Array, " B"]


def standardise(advantage: Rows) -> Rows:
    """Mean 0 and standard deviation 1 in this batch, as SB3's `normalize_advantage`."""
    return (advantage - advantage.mean()) / (advantage.std(ddof=1) + 1e-8)


def better_half(advantage: Rows) -> Bool[Array, " B"]:
    """The better half of actions has True: the middle one of an odd number too, and all that equal its worst."""
    # An advantage that a program computes twice may differ in its last digit: only what was sorted is compared.
    ordered, rows = jax.lax.sort_key_val(advantage, jnp.arange(len(advantage)))
    return jnp.zeros(len(advantage), bool).at[rows].set(ordered >= ordered[len(advantage) // 2])


class Credit(Part):
    """The usual weight, the advantage A itself."""

    label: ClassVar[str] = "advantage"
    is_signed: ClassVar[bool] = True
    """True if a weight may be negative."""

    normalize_advantage: bool = False
    """Standardise the advantages of each batch."""

    def weights(self, advantage: Rows) -> Rows:
        """The weight of each action's loss, from the advantages of a batch."""
        return self.of_standardised(standardise(advantage) if self.normalize_advantage else advantage)

    def of_standardised(self, advantage: Rows) -> Rows:
        """The same from advantages that are standardised already where they are to be."""
        return advantage


class PositiveCredit(Credit):
    """A positive weight that grows with the advantage."""

    is_signed: ClassVar[bool] = False

    temperature: Positive = 1.0
    """The advantage that makes a weight e times as large, in the advantage's units."""


class AWR(PositiveCredit):
    """Advantage-weighted regression: min(exp(A / temperature), 20) (Peng et al., 2019)."""

    label: ClassVar[str] = "AWR"
    LARGEST: ClassVar[float] = 20.0
    """As in its authors' experiments."""

    def of_standardised(self, advantage: Rows) -> Rows:
        """Each weight grows exponentially with its advantage, up to LARGEST."""
        return jnp.exp(jnp.minimum(advantage / self.temperature, np.log(self.LARGEST)))


class VMPO(PositiveCredit):
    """V-MPO: the softmax of A / temperature over the better half of the batch, 0 for the others (Song et al., 2020).

    It is multiplied by B, so that the mean over the batch is V-MPO's sum. Of an odd number of rows the middle one is
    among the better, and so is what equals the worst of them.
    """

    label: ClassVar[str] = "V-MPO"

    def of_standardised(self, advantage: Rows) -> Rows:
        """The better half shares B by a softmax; the others get nothing."""
        return len(advantage) * jax.nn.softmax(advantage / self.temperature, where=better_half(advantage))


CREDITS: dict[str, type[Credit]] = {"advantage": Credit, "awr": AWR, "v-mpo": VMPO}
"""The value of the word `weighting` chooses one of these."""
