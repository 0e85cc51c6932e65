"""Gradient norms and their bounds on networks met in training, sample by sample (§4.3, Apps A and B)."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow as pa
from jaxtyping import Array, Float, Key

from galton import make_agent
from galton.algorithms import Agent, actor_critic
from galton.envs import JaxTask, make
from galton.losses import LOSSES, surrogate
from galton.networks import mlp
from galton.policies import Distribution, Gaussian
from galton.tasks import TASKS
from galton.theory import gradient_bound, output_lipschitz, regression_bound
from galton.training import populate
from galton.training.rollout import EpisodeState, draw_noise, rollout
from galton.types import Learner, Params, Transition
from studies.paper.sweeps import Budget

READINGS = {"sigma^2": 2, "sigma": 1}
"""The power of σ that divides the Gaussian's squared error: its log-likelihood's, and the one that §4.3 prints."""
ETAS = {"hl-gauss-centred": 2.0}
"""The η of losses that are not measured at the default one."""
FACTORS = {"gaussian": (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001), "hl-gauss": (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)}
"""The factors that make trained policies ever sharper: of σ, or of the logits."""


class Effort(NamedTuple):
    """A budget decides how much is trained and looked at."""

    tasks: tuple[str, ...]
    losses: tuple[str, ...]
    seeds: int
    steps: int
    points: int
    """Looks at each run, the first before any update; the times of the others grow geometrically."""


EFFORTS: dict[Budget, Effort] = {
    "smoke": Effort(("mountain-car",), ("gaussian", "hl-gauss"), seeds=1, steps=400, points=2),
    "small": Effort(("mountain-car", "lqr"), tuple(LOSSES), seeds=4, steps=50_000, points=12),
    "grid": Effort(("mountain-car", "lqr"), tuple(LOSSES), seeds=6, steps=500_000, points=20),
    "paper": Effort(("mountain-car", "lqr"), tuple(LOSSES), seeds=6, steps=500_000, points=20),
}
"""Compiling takes the smoke test's time, some ten seconds a loss: it has one loss of each proposition."""


class Sample(NamedTuple):
    """A sample is what is measured of one sampled action, or a column of it for each field."""

    advantage: Float[Array, "*batch"]
    sigma: Float[Array, "*batch"]
    """The policy's standard deviation in this state, mean over action dimensions."""
    last_factor: Float[Array, "*batch"]
    """Σ|q − π| or |a − μ|, summed over action dimensions; of the centred loss Σ|q − Kᵀπ|."""
    lipschitz: Float[Array, "*batch"]
    feature_norm: Float[Array, "*batch"]
    norm: Float[Array, "*batch"]
    """The norm of the gradient of advantage · loss in θ, by automatic differentiation."""
    bound: Float[Array, "*batch"]
    """The right side of eq. 7 or 8, summed over action dimensions."""


def sample_loss(agent: Agent, reading: str, distribution: Distribution, action: Float[Array, " d"]) -> Float[Array, ""]:
    """Return the loss that the advantage weights; with the reading "sigma" it is what §4.3 prints, (a − μ)² / 2σ."""
    if reading == "sigma":
        assert isinstance(distribution, Gaussian)
        loss: Array = ((action - distribution.mean) ** 2 / (2 * distribution.std())).sum()
        return loss
    return agent.loss(distribution, action)


def sample_gradient(
    loss: Callable[[Array], Array], actor: list[Params], observation: Float[Array, " o"], advantage: Float[Array, ""]
) -> tuple[list[Params], Float[Array, " n_outputs"]]:
    """The gradient of advantage · loss(outputs) in θ, all of the actor but its last bias, and the outputs."""

    def weighted(theta: list[Params]) -> tuple[Array, Array]:
        outputs = mlp(theta, observation)
        return surrogate(advantage, loss(outputs)), outputs

    gradient, outputs = jax.grad(weighted, has_aux=True)(actor)
    return [*gradient[:-1], {"kernel": gradient[-1]["kernel"]}], outputs


def measure(agent: Agent, learner: Learner, batch: Transition, reading: str) -> Sample:
    """Both sides for each of the B = T · N actions of a rollout `[T, N]`."""
    params, actor = learner.params, learner.params["actor"]
    observation, next_observation, action = map(
        actor_critic.flatten, (batch.observation, batch.next_observation, batch.action)
    )
    values, next_values = (actor_critic.value(agent, params, each) for each in (observation, next_observation))
    advantage = actor_critic.advantages(agent, values, next_values, batch)

    def one(observation: Array, action: Array, advantage: Array) -> Sample:
        def loss(outputs: Array) -> Array:
            return sample_loss(agent, reading, agent.policy.distribution(outputs, params), action)

        gradient, outputs = sample_gradient(loss, actor, observation, advantage)
        norm = jnp.sqrt(sum(jnp.vdot(leaf, leaf) for leaf in jax.tree.leaves(gradient)))
        lipschitz, f = output_lipschitz(actor, observation), agent.network.features(actor, observation)
        distribution = agent.policy.distribution(outputs, params)
        if isinstance(distribution, Gaussian):
            last_factor = jnp.abs(action - distribution.mean).sum()
            of_dimension = functools.partial(regression_bound, advantage, lipschitz, f)
            bound = jax.vmap(of_dimension)(action, distribution.mean, distribution.std() ** READINGS[reading]).sum()
        else:
            slope = jax.grad(loss)(outputs)
            last_factor, bound = jnp.abs(slope).sum(), gradient_bound(advantage, lipschitz, f, slope)
        return Sample(advantage, distribution.std().mean(), last_factor, lipschitz, jnp.linalg.norm(f), norm, bound)

    return jax.vmap(one)(observation, action, advantage)


def sharpen(learner: Learner, factor: float) -> Learner:
    """The same with σ times the factor; of a softmax it is the logits, by the last layer."""
    params = dict(learner.params)
    if "log_std" in params:
        params["log_std"] = params["log_std"] + np.float32(np.log(factor))
    else:
        params["actor"] = [*params["actor"][:-1], jax.tree.map(lambda x: x * np.float32(factor), params["actor"][-1])]
    return learner._replace(params=params)


def collect(budget: Budget) -> pa.Table:
    """Train each loss as in the paper and measure fresh rollouts on the way; then those of ever sharper policies.

    A row per sample: task, loss, reading ("" where there is only one), seed, step, sample, swept and factor (whether
    the policy was made sharper, and by which of FACTORS), and the fields of Sample.
    """
    effort = EFFORTS[budget]
    return pa.concat_tables(_collect(task, loss, effort) for task in effort.tasks for loss in effort.losses)


def _collect(task: str, loss: str, effort: Effort) -> pa.Table:
    env = JaxTask(make(TASKS[task].env))
    plain = make_agent(loss=loss, **({"eta": ETAS[loss]} if loss in ETAS else {}))
    agent = plain.on(env.actions.box)
    readings = list(READINGS) if loss == "gaussian" else [""]

    def look(run: tuple[Key[Array, ""], Learner, EpisodeState]) -> dict[str, Sample]:
        key, learner, episodes = run
        _, _, batch, _, _ = rollout(env, agent, learner, episodes, draw_noise(key, env, agent))
        return {reading: measure(agent, learner, batch, reading) for reading in readings}

    look_at_all = jax.jit(functools.partial(jax.lax.map, look))
    tables: list[pa.Table] = []

    def record(factor: float | None) -> None:
        learner = population.learner if factor is None else sharpen(population.learner, factor)
        key = jax.random.fold_in(jax.random.key(effort.seeds), len(tables))  # of a seed that no run has
        runs = jax.random.split(key, effort.seeds), learner, population.snapshot()["environments"]
        found = look_at_all(runs)
        for reading in readings:
            samples = found[reading]
            seed, sample = np.indices(samples.norm.shape)
            same = {"task": task, "loss": loss, "reading": reading, "step": population.step}
            same |= {"swept": factor is not None, "factor": factor or 1.0}
            columns = {name: np.full(seed.size, value) for name, value in same.items()}
            columns |= {"seed": seed.ravel(), "sample": sample.ravel()}
            tables.append(pa.table(columns | {name: np.ravel(x) for name, x in samples._asdict().items()}))

    growing = np.geomspace(effort.steps // agent.rollout.n_steps, 1, effort.points - 1).round().astype(int)
    population = populate(env, plain, range(effort.seeds))
    try:
        for n_updates in np.diff(sorted({0, *growing.tolist()}), prepend=0):
            population.advance(int(n_updates))
            record(None)
        for factor in FACTORS.get(loss, ()):
            record(factor)
    finally:
        population.close()
    return pa.concat_tables(tables)
