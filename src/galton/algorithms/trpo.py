"""Trust region policy optimisation with the semantics of sb3-contrib's TRPO (Schulman et al., 2015), for any loss.

The policy makes one step on a rollout: along F⁻¹ g, where g is the gradient of the surrogate mean(A · exp(ℓ_old − ℓ))
and F the policy's Fisher matrix, as far as the mean KL divergence may go, and back from there until the surrogate has
grown. ℓ is the loss, so that for a negative log-likelihood (the Gaussian's, HL-1-Hot) this is TRPO to the letter; for a
histogram target the ratio is that of what the loss measures, as PPO's "smoothed" one is. The critic makes steps of its
own, on minibatches.

F v is Jᵀ H J v, with the Jacobian J of what the policy is made of, its outputs and its own parameters, and there the
Hessian H of the KL divergence, whose gradient is 0 where it begins: diag π − ππᵀ for a softmax, 1/σ² and 2 for a
Gaussian's mean and log σ. The network is linearised once for all steps of the conjugate gradients.
"""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax.scipy.sparse.linalg import cg
from jaxtyping import Array, Bool, Float, Int, Key

from galton.algorithms import actor_critic, minibatches
from galton.algorithms.actor_critic import flatten
from galton.algorithms.base import Agent, Algorithm, Scalars
from galton.fields import Within
from galton.types import Count, Learner, NotNegative, Number, Params, Positive, Scalar, Transition

ShareBelow1 = Annotated[Number, Within(lambda x: (x > 0) & (x < 1), "greater than 0, and less than 1")]


class TRPO(Algorithm):
    """A step of the policy within a bound on its mean KL divergence, and steps of the critic, per rollout `[T, N]`."""

    name: ClassVar[str] = "trpo"
    label: ClassVar[str] = "TRPO"
    scalars: ClassVar[tuple[str, ...]] = (*actor_critic.SCALARS, "kl", "step_share")
    defaults: ClassVar[Mapping[str, Any]] = {
        "learning_rate": 1e-3,
        "n_steps": 2048,
        "batch_size": 128,
        "gae_lambda": 0.95,
        "vf_coef": 1.0,
        "normalize_advantage": True,
        "max_grad_norm": 1e9,
    }
    log_interval: ClassVar[int] = 1
    side_by_side: ClassVar[bool] = False

    max_kl: Positive = 0.01
    """The mean KL divergence that an update of the policy may have, δ; of a Gaussian in V-MPO that of its mean."""
    cg_max_steps: Count = 15
    """The most steps of the conjugate gradients that solve F x = g."""
    cg_damping: NotNegative = 0.1
    """A multiple of the identity that is added to F."""
    line_search_max_iter: Count = 10
    """The most step sizes that are tried."""
    line_search_shrinking_factor: ShareBelow1 = 0.8
    """The ratio of a step size to the one before it."""
    n_critic_updates: Count = 10
    """The critic's passes over each rollout."""
    batch_size: Count = 64
    """Steps in each minibatch, of the critic's; it divides n_steps · n_envs."""

    def update(self, agent: Agent, learner: Learner, batch: Transition, key: Key[Array, ""]) -> tuple[Learner, Scalars]:
        """The learner after the policy's step and the critic's, and what they tell."""
        return self.fit(agent, learner, batch, minibatches.orders(key, self.n_critic_updates, batch.reward.size))

    def fit(
        self, agent: Agent, learner: Learner, batch: Transition, orders: Int[Array, "updates B"]
    ) -> tuple[Learner, Scalars]:
        """The same with the orders in which the critic sees the rows of each pass."""
        observation, next_observation, action = map(flatten, (batch.observation, batch.next_observation, batch.action))
        values = actor_critic.value(agent, learner.params, observation)
        next_values = actor_critic.value(agent, learner.params, next_observation)
        advantage = actor_critic.advantages(agent, values, next_values, batch)
        params, told = self._policy_step(agent, learner.params, observation, action, agent.credit.weights(advantage))
        learner = learner._replace(params=params)
        finite = jnp.isfinite(told["grad_norm"])
        learner, of_critic = self._critic_steps(agent, learner, observation, advantage + values, orders, finite)
        return learner, told | of_critic | {"grad_norm": jnp.hypot(told["grad_norm"], of_critic["grad_norm"])}

    def at(self, step: Scalar, frozen: Bool[Array, ""]) -> "TRPO":
        """The same algorithm, whose policy stays where it is in a frozen run."""
        return self.replace(max_kl=jnp.where(frozen, 0.0, self.max_kl))

    def check(self, agent: Agent) -> None:
        """Raise UsageError for a policy that can't tell its divergence, or minibatches that don't divide a rollout."""
        actor_critic.require_kl(agent)
        minibatches.require_whole(agent, self.batch_size)

    def _policy_step(
        self,
        agent: Agent,
        params: Params,
        observation: Float[Array, "B o"],
        action: Float[Array, "B d"],
        weight: Float[Array, " B"],
    ) -> tuple[Params, Scalars]:
        """The parameters after the step, the critic's as they were."""
        own = {name: part for name, part in params.items() if name != "critic"}
        old: Any = actor_critic.as_update_sees(agent, *_seen(agent, own, observation), action)
        target = agent.loss.target(old, action)
        sampled = minibatches.loss(agent, old, action, target)

        def surrogate(own: Params) -> tuple[Scalar, Scalar]:
            new = actor_critic.as_update_sees(agent, *_seen(agent, own, observation), action)
            gain = jnp.mean(weight * jnp.exp(sampled - minibatches.loss(agent, new, action, target)))
            bonus, regularizer = self.ent_coef, agent.loss.regularizer(new)
            gain = gain if bonus is None else gain + bonus * jnp.mean(new.entropy())
            return gain if regularizer is None else gain - jnp.mean(regularizer), jnp.mean(old.kl(new))

        (before, _), gradient = jax.value_and_grad(surrogate, has_aux=True)(own)
        product = fisher(agent, own, observation, action, self.cg_damping)
        direction, _ = cg(product, gradient, tol=0.0, atol=1e-5, maxiter=self.cg_max_steps)
        curvature = optax.tree.vdot(direction, product(direction))
        longest = jnp.sqrt(2 * self.max_kl / jnp.maximum(curvature, 1e-30))

        def tried(step: Step) -> Step:
            share = step.share * jnp.where(step.tries == 0, 1.0, self.line_search_shrinking_factor)
            moved = jax.tree.map(lambda p, x: p + share * longest * x, own, direction)
            gain, kl = surrogate(moved)
            return Step(step.tries + 1, share, moved, kl, (kl < self.max_kl) & (gain > before))

        first = Step(jnp.int32(0), jnp.ones_like(before), own, jnp.zeros_like(before), jnp.array(False))
        found = jax.lax.while_loop(lambda s: (s.tries < self.line_search_max_iter) & ~s.is_good, tried, first)
        kept = jax.tree.map(lambda new, old: jnp.where(found.is_good, new, old), found.params, own)
        return kept | {"critic": params["critic"]}, {
            "entropy": jnp.mean(old.entropy()),
            "grad_norm": optax.tree.norm(gradient),
            "policy_loss": -jnp.mean(weight),
            "kl": jnp.where(found.is_good, found.kl, 0.0),
            "step_share": jnp.where(found.is_good, found.share, 0.0),
        }

    def _critic_steps(
        self,
        agent: Agent,
        learner: Learner,
        observation: Float[Array, "B o"],
        returns: Float[Array, " B"],
        orders: Int[Array, "updates B"],
        going: Bool[Array, ""],
    ) -> tuple[Learner, Scalars]:
        own = actor_critic.apart(agent, observation)[0]

        def step(carry: tuple[Learner, Array], rows: tuple[Array, Array]) -> tuple[tuple[Learner, Array], Any]:
            learner, going = carry

            def objective(params: Params) -> Scalar:
                return jnp.mean(agent.critic.loss(agent.network(params["critic"], rows[0]), rows[1]))

            value_loss, gradient = jax.value_and_grad(objective)(learner.params)
            gradient = jax.tree.map(lambda g: self.vf_coef * g, gradient)
            params, optimizer, norm = agent.optimizer.step(learner.params, learner.optimizer, gradient)
            moved = learner._replace(params=learner.params | {"critic": params["critic"]}, optimizer=optimizer)
            learner = jax.tree.map(lambda new, kept: jnp.where(going, new, kept), moved, learner)
            return (learner, going & jnp.isfinite(norm)), (value_loss, norm)

        (learner, _), (losses, norms) = jax.lax.scan(
            lambda carry, order: step(carry, (own[order], returns[order])),
            (learner, going),
            orders.reshape(-1, self.batch_size),
        )
        return learner, {"value_loss": losses.mean(), "grad_norm": norms.mean()}


class Step(NamedTuple):
    """A step size that was tried last."""

    tries: Array
    share: Scalar
    """Of the longest step."""
    params: Params
    kl: Scalar
    is_good: Bool[Array, ""]


def _seen(agent: Agent, own: Params, observation: Float[Array, "B o"]) -> tuple[Float[Array, "B n_outputs"], Params]:
    """A policy makes its distributions of these: the network's outputs, and its own parameters."""
    return actor_critic.actor_outputs(agent, own, observation), {name: own[name] for name in own if name != "actor"}


def fisher(
    agent: Agent,
    own: Params,
    observation: Float[Array, "B o"],
    action: Float[Array, "B d"],
    damping: float | Scalar = 0.0,
) -> Callable[[Params], Params]:
    """(F + damping · I) v for a v like the policy's parameters, where F is the mean Fisher matrix of these states.

    Where dimensions depend on others it is that of the distributions given these actions, whose mean it is.
    """
    seen, pulled = jax.vjp(lambda own: _seen(agent, own, observation), own)
    pushed = jax.linear_transpose(lambda slope: pulled(slope)[0], seen)  # networks have no forward mode of their own
    old: Any = actor_critic.as_update_sees(agent, *seen, action)
    slope = jax.grad(lambda seen: jnp.mean(old.kl(actor_critic.as_update_sees(agent, seen[0], seen[1], action))))

    def product(v: Params) -> Params:
        curved = jax.jvp(slope, (seen,), pushed(v))[1]
        return jax.tree.map(lambda f, x: f + damping * x, pulled(curved)[0], v)

    return product
