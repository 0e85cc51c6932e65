"""V-MPO, on-policy maximum a posteriori policy optimisation (Song et al., 2020), for any loss.

Each minibatch of a rollout weights the losses of its better half by ψ = softmax(A / η), and the policy is trained on
these as on examples: Σ ψ · loss, the paper's weighted classification (§8) with weights that are never negative. Two
more terms of the objective learn how far that goes.

- The temperature η: η ε_η + η log mean exp(A / η) over the better half, whose minimum is where ψ has the divergence ε_η
  from equal weights (eq. 4 there).
- The multipliers α: α (ε − sg[KL]) + sg[α] KL of the sampling policy from the one in training (eq. 5 there). A
  Gaussian's mean and σ have one each; a softmax over bins has one, for its KL divergence is a closed form in one piece.

The dual variables log η and log α have an Adam of their own, so that they never leave the positive numbers.

Multipliers hold a bound in the mean at best. So the actor's part of an update that ends out of bounds is shortened,
along the line from the old parameters, until all divergences are in theirs. This is ours.
"""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Key, PyTree

from galton.algorithms import actor_critic, credit, minibatches
from galton.algorithms.actor_critic import Objective, flatten
from galton.algorithms.base import Agent, Algorithm, Scalars
from galton.errors import require
from galton.types import Count, Learner, Params, Positive, Scalar, Transition

Duals = dict[str, Any]
"""The logarithms of the temperature and of each multiplier, scalars: `temperature` and `multipliers`."""


class Memory(NamedTuple):
    """V-MPO remembers this between two updates."""

    duals: Duals
    optimizer: Any
    """The state of their Adam."""


class Rows(NamedTuple):
    """A rollout as training data, a row per transition, all fixed before the first step."""

    observation: Float[Array, "B o"]
    action: Float[Array, "B d"]
    advantage: Float[Array, " B"]
    returns: Float[Array, " B"]
    outputs: Float[Array, "B n_outputs"]
    """The actor's, under the parameters that sampled the rollout."""


class Step(NamedTuple):
    """A share of the actor's step that was tried last."""

    share: Scalar
    over: Scalar
    """The largest divergence over its bound."""
    kl: Scalar


class VMPO(Algorithm):
    """n_epochs passes over a rollout `[T, N]`, each in minibatches of batch_size in an order drawn from the key."""

    name: ClassVar[str] = "v-mpo"
    label: ClassVar[str] = "VMPO"
    scalars: ClassVar[tuple[str, ...]] = (
        *actor_critic.SCALARS,
        "kl",
        "step_share",
        "vmpo_temperature",
        "kl_multiplier",
    )
    defaults: ClassVar[Mapping[str, Any]] = {"learning_rate": 3e-4, "n_steps": 2048, "gae_lambda": 0.95}
    log_interval: ClassVar[int] = 1
    side_by_side: ClassVar[bool] = False

    n_epochs: Count = 10
    """The number of passes over each rollout."""
    batch_size: Count = 64
    """Steps in each minibatch; it divides n_steps · n_envs."""
    max_kl: Positive = 0.01
    """The mean KL divergence that an update of the policy may have, δ; of a Gaussian in V-MPO that of its mean."""
    max_kl_std: Positive = 5e-4
    """The same of a Gaussian's σ, where V-MPO bounds it apart from that of the mean."""
    weights_kl: Positive = 0.1
    """The divergence of the better half's weights from equal ones that the temperature is learnt for, ε_η."""
    dual_learning_rate: Positive = 0.1
    """Adam's step size for the logarithms of temperature and multipliers."""

    def init(self, agent: Agent, params: Params) -> Memory:
        """Temperature and multipliers of 1."""
        outputs, action = (jnp.zeros((1, n)) for n in (agent.policy.n_outputs, len(agent.low)))
        policy: Any = actor_critic.as_update_sees(agent, outputs, params, action)
        names = jax.eval_shape(lambda: policy.kl_parts(policy))
        duals = {"temperature": jnp.zeros(()), "multipliers": {name: jnp.zeros(()) for name in names}}
        return Memory(duals, _ADAM.init(duals))

    def update(self, agent: Agent, learner: Learner, batch: Transition, key: Key[Array, ""]) -> tuple[Learner, Scalars]:
        """The learner after all minibatches, and what they tell, means over them."""
        observation, next_observation, action = map(flatten, (batch.observation, batch.next_observation, batch.action))
        old = learner.params
        outputs, estimates = actor_critic.outputs(agent, old, observation)
        values = agent.critic.value(estimates)
        next_values = actor_critic.value(agent, old, next_observation)
        advantage = actor_critic.advantages(agent, values, next_values, batch)
        rows = Rows(observation, action, advantage, advantage + values, outputs)

        def epoch(carry: tuple[Learner, Array], order: Array) -> tuple[tuple[Learner, Array], dict[str, Array]]:
            batches = jax.tree.map(lambda x: x[order.reshape(-1, self.batch_size)], rows)
            return jax.lax.scan(lambda carry, rows: self._minibatch(agent, old, carry, rows), carry, batches)

        orders = minibatches.orders(key, self.n_epochs, len(advantage))
        (learner, _), told = jax.lax.scan(epoch, (learner, jnp.array(True)), orders)
        params, of_step = self._shortened(agent, old, learner.params, rows)
        return learner._replace(params=params), {name: values.mean() for name, values in told.items()} | of_step

    def check(self, agent: Agent) -> None:
        """Raise UsageError for a policy that can't tell its divergence, or minibatches that don't divide a rollout."""
        actor_critic.require_kl(agent)
        minibatches.require_whole(agent, self.batch_size)
        require(self.batch_size > 1, "batch_size is 1; V-MPO learns from the better half of a minibatch: raise it")

    def _shortened(self, agent: Agent, old: Params, new: Params, rows: Rows) -> tuple[Params, Scalars]:
        """The new parameters, or where these are out of bounds the actor's at a share of its step that is not."""
        sampling: Any = actor_critic.as_update_sees(agent, rows.outputs, old, rows.action)

        def moved(share: Scalar) -> Params:
            return optax.incremental_update(new, old, share) | {"critic": new["critic"]}

        def tried(share: Scalar) -> Step:
            params = moved(share)
            outputs = actor_critic.actor_outputs(agent, params, rows.observation)
            distribution: Any = actor_critic.as_update_sees(agent, outputs, params, rows.action)
            parts = sampling.kl_parts(distribution)
            over = [part.mean() / (self.max_kl_std if name == "std" else self.max_kl) for name, part in parts.items()]
            return Step(share, jnp.stack(over).max(), sampling.kl(distribution).mean())

        def shorter(step: Step) -> Step:  # near the old policy a divergence grows like the square of a step
            return tried(step.share * jnp.sqrt(0.95 / step.over))

        first = tried(jnp.ones(()))
        step = jax.lax.while_loop(lambda step: (step.over > 1) & (step.share > 1e-6), shorter, first)
        return moved(step.share), {"kl": step.kl, "step_share": step.share}

    def _minibatch(
        self, agent: Agent, old: Params, carry: tuple[Learner, Array], rows: Rows
    ) -> tuple[tuple[Learner, Array], Scalars]:
        """One step, unless a gradient before it was not finite: (learner, going) → the same, and what it tells."""
        learner, going = carry
        memory: Memory = learner.memory["algorithm"]
        advantage = agent.credit.weights(rows.advantage)

        def objective(both: tuple[Params, Duals]) -> tuple[Array, Objective]:
            params, duals = both
            outputs, estimates = actor_critic.outputs(agent, params, rows.observation)
            distribution = actor_critic.as_update_sees(agent, outputs, params, rows.action)
            sampling: Any = actor_critic.as_update_sees(agent, rows.outputs, old, rows.action)
            of_temperature, weight = temperature_loss(duals["temperature"], advantage, self.weights_kl)
            parts = {name: part.mean() for name, part in sampling.kl_parts(distribution).items()}
            of_kl = multiplier_loss(duals["multipliers"], parts, {"std": self.max_kl_std}, self.max_kl)
            loss, critic_loss = agent.loss(distribution, rows.action), agent.critic.loss(estimates, rows.returns)
            own = actor_critic.objective(agent, learner, distribution, loss, weight, critic_loss)
            return own.total + of_temperature + of_kl, own

        both = learner.params, memory.duals
        (gradient, of_duals), own = jax.grad(objective, has_aux=True)(both)
        learner, of_step = actor_critic.step(agent, learner, gradient, own, going)
        going &= jnp.isfinite(of_step["grad_norm"])
        move, adam = _ADAM.update(of_duals, memory.optimizer)
        moved = jax.tree.map(lambda dual, by: dual - self.dual_learning_rate * by, memory.duals, move)
        multipliers = jnp.stack(jax.tree.leaves(memory.duals["multipliers"]))
        told = {"vmpo_temperature": jnp.exp(memory.duals["temperature"]), "kl_multiplier": jnp.exp(multipliers).mean()}
        return (learner.remembering(algorithm=Memory(moved, adam)), going), of_step | told


_ADAM = optax.scale_by_adam()
"""The step of the dual variables is made by this."""


def temperature_loss(
    log_temperature: Float[Array, ""], advantage: Float[Array, " B"], weights_kl: Float[Array, ""] | float
) -> tuple[Float[Array, ""], Float[Array, " B"]]:
    """η ε_η + η log mean exp(A / η) over the better half, and the weights B ψ, through which no gradient flows."""
    temperature = jnp.exp(log_temperature)
    better = credit.better_half(advantage)
    log_mean = jax.nn.logsumexp(advantage / temperature, where=better) - jnp.log(better.sum())
    weight = credit.VMPO(temperature=jax.lax.stop_gradient(temperature)).of_standardised(advantage)
    return temperature * (weights_kl + log_mean), weight


def multiplier_loss(
    log_multipliers: dict[str, Float[Array, ""]],
    kl: dict[str, Float[Array, ""]],
    bounds: Mapping[str, Any],
    bound: Float[Array, ""] | float,
) -> Float[Array, ""]:
    """Σ α (ε − sg[KL]) + sg[α] KL, where some divergences have bounds ε of their own."""
    fixed = jax.lax.stop_gradient
    multipliers: PyTree[Array] = jax.tree.map(jnp.exp, log_multipliers)
    terms = [
        alpha * (bounds.get(name, bound) - fixed(kl[name])) + fixed(alpha) * kl[name]
        for name, alpha in multipliers.items()
    ]
    return jnp.stack(terms).sum()
