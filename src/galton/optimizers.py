"""Optimizers by name: how a gradient moves parameters, its clipping and its learning rate included.

A new one is a class of this kind, with the settings that it needs, and a line in OPTIMIZERS; any Optax transformation
will do.
"""

import abc
from typing import Annotated, Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Bool, Float, Int

from galton.errors import require
from galton.fields import Within
from galton.parts import Part, Schedule
from galton.types import NotNegative, Number, Params, Positive, Share

State = Any
"""An optimizer remembers this between two steps."""


class Optimizer(Part, abc.ABC):
    """An optimizer clips a gradient, makes a step of it, and follows the learning rate down."""

    learning_rate: NotNegative = 7e-4
    """The step size, at the start of training."""
    decay_steps: Annotated[Number, Within(lambda x: x >= 0, "0 or more, or inf for all steps that are trained")] = 0.0
    """The learning rate falls linearly to 0 over so many environment steps; 0: it stays. inf: over all that are
    trained, which `learn` and `train` know; in each call of `learn` anew."""
    max_grad_norm: Positive = 0.5
    """The gradient, actor's and critic's joined unless clip_separately says otherwise, is scaled down to this norm."""
    clip_separately: bool = False
    """Scale the gradients of actor and critic down to max_grad_norm each, not the two joined."""

    fixed: ClassVar[tuple[str, ...]] = ("decay_steps",)

    @property
    @abc.abstractmethod
    def transformation(self) -> optax.GradientTransformation:
        """The step that is made of a clipped gradient, before the learning rate scales it and its sign turns."""

    def _counted(self, params: Params) -> optax.GradientTransformation:
        """The same, with a count of steps where it keeps none of these parameters."""
        own = self.transformation
        knows = bool(_counts(jax.eval_shape(own.init, params)))
        return own if knows else optax.chain(own, optax.scale_by_schedule(lambda _: 1.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        scheduled = isinstance(self.learning_rate, Schedule) and np.any(self.decay_steps)
        require(not scheduled, f"decay_steps is {self.decay_steps} beside a schedule of learning_rate; leave it at 0")

    def init(self, params: Params) -> State:
        """The state before the first step."""
        return self._counted(params).init(params)

    def step(self, params: Params, state: State, gradient: Params) -> tuple[Params, State, Float[Array, ""]]:
        """One step along the gradient, clipped; also the gradient's norm before that, of all of it.

        A gradient that is not finite moves no parameter; the norm tells.
        """
        grad_norm = optax.tree.norm(gradient)
        finite = jnp.isfinite(grad_norm)
        learning_rate = jnp.where(finite, self.learning_rate, 0.0)
        move, state = self._counted(params).update(self._clipped(gradient, finite), state, params)
        return jax.tree.map(lambda p, s: p - learning_rate * s, params, move), state, grad_norm

    def _clipped(self, gradient: Params, finite: Bool[Array, ""]) -> Params:
        of_critic = {"critic": gradient["critic"]}
        of_actor = {name: part for name, part in gradient.items() if name != "critic"}
        clipped: Params = {}
        for part in (of_actor, of_critic) if self.clip_separately else (gradient,):
            scale = jnp.minimum(1.0, self.max_grad_norm / (optax.tree.norm(part) + 1e-6))
            clipped |= jax.tree.map(lambda g, scale=scale: jnp.where(finite, scale * g, 0.0), part)
        return clipped

    def at(self, step: Float[Array, ""], frozen: Bool[Array, ""]) -> "Optimizer":
        """The optimizer of the update at this step; that of a frozen run moves nothing."""
        return self.replace(learning_rate=jnp.where(frozen, 0.0, self.learning_rate * self.remaining(step)))

    def remaining(self, step: Float[Array, ""] | float) -> Float[Array, ""]:
        """The share of the learning rate that is left at this step: 1 − step / decay_steps, or 1 without a decay.

        As in Stable-Baselines3 the steps of the rollout that is learnt from count, so the last update's is 0.
        """
        decays = jnp.asarray(self.decay_steps) > 0
        return jnp.where(decays, jnp.maximum(1 - step / jnp.where(decays, self.decay_steps, 1.0), 0.0), 1.0)

    def falling(self, begin: int, end: float, rollout: int) -> "Optimizer":
        """The optimizer whose learning rate falls from one step to another if it falls over all that is trained.

        An update's rate is that of its rollout's first step, so that the last one, which may be the only one, learns
        too: rate · (end − first step) / (end − begin).
        """
        last, over_all = end + rollout, np.isinf(self.decay_steps)
        if not np.any(over_all) or np.isinf(end):
            return self
        rate, steps = (np.asarray(number, np.float32) for number in (self.learning_rate, self.decay_steps))
        return self.replace(
            learning_rate=rate * np.where(over_all, np.float32(last / (end - begin)), np.float32(1)),
            decay_steps=np.where(over_all, np.float32(last), steps),
        )


class Adam(Optimizer):
    """Adam (Kingma & Ba, 2015) with Stable-Baselines3's ε."""

    label: ClassVar[str] = "Adam"

    @property
    def transformation(self) -> optax.GradientTransformation:
        """Optax's `scale_by_adam` makes the step, with ε = 1e-5."""
        return _ADAM


class AdamW(Optimizer):
    """Adam with decoupled weight decay (Loshchilov & Hutter, 2019), of all parameters."""

    label: ClassVar[str] = "AdamW"

    weight_decay: NotNegative = 0.01
    """The share of each parameter that a step of rate 1 takes away."""

    @property
    def transformation(self) -> optax.GradientTransformation:
        """Adam's step, and the share of the parameters."""
        return optax.chain(_ADAM, optax.add_decayed_weights(self.weight_decay))


class RMSprop(Optimizer):
    """RMSprop as TensorFlow and Stable-Baselines3's A2C have it: ε = 1e-5 under the root, and moments begin at 1."""

    label: ClassVar[str] = "RMSprop"

    rms_decay: Share = 0.99
    """The share of the mean square that stays after each step."""

    @property
    def transformation(self) -> optax.GradientTransformation:
        """The gradient over the root of its mean square."""
        return optax.scale_by_rms(self.rms_decay, 1e-5, initial_scale=1.0, eps_in_sqrt=True)


_ADAM = optax.scale_by_adam(b1=0.9, b2=0.999, eps=1e-5)


OPTIMIZERS: dict[str, type[Optimizer]] = {"adam": Adam, "adamw": AdamW, "rmsprop": RMSprop}


def count(state: State) -> Int[Array, ""]:
    """The steps that an optimizer has taken, by its state: a number of its own for each minibatch of a run."""
    taken: Int[Array, ""] = _counts(state)[0]
    return taken


def _counts(state: State) -> list[Any]:
    return [found for _, found in optax.tree.get_all_with_path(state, "count")]
