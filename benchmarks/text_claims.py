"""Seven sentences of the paper's text by six small studies, on fresh seeds.

Where nothing else is said an agent is A2C with the settings that App. C.2's grid selected for the loss (WINNERS), but
that HL-Gauss has η = .25 on the LQR: the grid's choice there is .01, which is HL-1-Hot.

- sampling (footnote 3): actions at the bin's center, or uniform in the bin, with 5, 10 and 25 bins.
- exponential (footnote 2): the weight exp(A/τ), at most 20, in place of A, and nothing else changed.
- normalised (§4.3): the Gaussian's gradient with norm .5 and not only clipped, actor's and critic's joined or apart.
- bounds (§4.3, Propositions 1 and 2): both sides for each action that HalfCheetah is trained on, in three settings. Of
  HL-Gauss there is the usual one alone: the selected η is HL-1-Hot's.
- coarse (§7): A2C's preset of classification, whose target's width follows the policy's, with 3 to 25 bins.
- crossed (§5.2.3): a policy explores and learns, another learns from its data alone; and Gaussian Exploration.

    python -m benchmarks.text_claims [studies] [--out results/benchmarks/text_claims.json]   # goes on from there
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import optax

import galton
from benchmarks.kept import study
from galton.algorithms import actor_critic
from galton.algorithms.a2c import A2C
from galton.envs import JaxTask, make
from galton.losses import surrogate
from galton.optimizers import Adam
from galton.policies.exploration import init_clipped_gaussian_logits
from galton.presets import PRESETS
from galton.training.evaluate import evaluate
from galton.training.rollout import draw_noise, rollout, start_episodes
from studies.paper.gradients import measure

FIRST = 48_000
"""The first of the fresh seeds."""
WINNERS = {
    ("bandit", "hl-one-hot"): {"n_bins": 200, "learning_rate": 0.1},
    ("bandit", "hl-gauss"): {"n_bins": 50, "learning_rate": 0.1, "eta": 1.0},
    ("lqr", "gaussian"): {"learning_rate": 1e-3},
    ("lqr", "hl-one-hot"): {"n_bins": 50, "learning_rate": 1e-3},
    ("lqr", "hl-gauss"): {"n_bins": 100, "learning_rate": 1e-3, "eta": 0.25},
    ("HalfCheetah-v5", "gaussian"): {"learning_rate": 3e-4},
    ("HalfCheetah-v5", "hl-one-hot"): {"n_bins": 50, "learning_rate": 1e-3},
}
LENGTH = {"bandit": (2_000, 50), "lqr": (250_000, 10)}
"""The steps of a task and how many runs it has; on the LQR half of App. C.2's steps."""
BANDIT = {"n_steps": 5, "net_arch": ()}


def ends(env, n_runs, steps, n_logs=20, episodes=25, each=1, **words):
    """The last returns of training, of the most likely action and of the mean one, `[each][n_runs]`."""
    seeds = [*range(FIRST, FIRST + n_runs)] * each
    result = galton.train(
        env, galton.make_agent(**words), seeds, steps, n_logs=n_logs, n_eval_episodes=episodes, eval_mean=True
    )
    names = {"training": "training_return", "mode": "evaluation_return", "mean": "mean_action_return"}
    return {name: _rows(result.final(metric), each) for name, metric in names.items()}


def _rows(values, n):
    return np.float64(values).round(3).reshape(n, -1).tolist()


def on_task(task, loss, each=1, **words):
    """What the paper's agent ends with on a task, but for these words; `each` settings have a number in turn."""
    steps, n_runs = LENGTH[task]
    words = {name: np.repeat(word, n_runs) if isinstance(word, tuple) else word for name, word in words.items()}
    own = WINNERS[task, loss] | (BANDIT if task == "bandit" else {})
    return ends(task, n_runs, steps, each=each, loss=loss, **own | words)


TEMPERATURES = (0.3, 1.0, 3.0)
_NORMALISE, _ADAM = optax.normalize_by_update_norm(0.5), optax.scale_by_adam(eps=1e-5)


class Normalised(Adam):
    """Adam on the gradient over its norm, .5 long, as the clipped one is at most."""

    @property
    def transformation(self):
        return optax.chain(_NORMALISE, _ADAM)


class NormalisedApart(Adam):
    """The same with the gradients of actor and critic normalised each by itself."""

    @property
    def transformation(self):
        def of(params):
            return {name: jax.tree.map(lambda _, name=name: name == "critic", part) for name, part in params.items()}

        return optax.chain(optax.partition({True: _NORMALISE, False: _NORMALISE}, of), _ADAM)


class Measured(A2C):
    """A2C that tells both sides of Propositions 1 and 2 for the actions of each rollout, before it learns from them."""

    scalars = (*A2C.scalars, "above", "norm", "bound", "tightness", "norm_printed", "bound_printed")

    def update(self, agent, learner, batch, key):
        """The learner of A2C, and beside what it tells the means of norm / |A|, bound / |A| and norm / bound."""
        told = {"above": 0.0}
        readings = {"": "sigma^2", "_printed": "sigma"} if agent.loss.label == "Gaussian" else {"": "", "_printed": ""}
        for name, reading in readings.items():
            found = measure(agent, learner, batch, reading)
            own = jnp.maximum(jnp.abs(found.advantage), 1e-12)
            told |= {f"norm{name}": (found.norm / own).mean(), f"bound{name}": (found.bound / own).mean()}
            told["above"] += (found.norm > found.bound * (1 + 1e-5) + 1e-20).sum()
            told["tightness"] = (found.norm / jnp.maximum(found.bound, 1e-20)).mean()
        learner, scalars = super().update(agent, learner, batch, key)
        return learner, scalars | told


CHEETAH = "HalfCheetah-v5"


def bounds(loss, words):
    """Both sides of the propositions on HalfCheetah, means over training and how much the bounds vary in it."""
    agent = galton.make_agent(loss=loss, algorithm=Measured(), **words)
    seeds = range(FIRST, FIRST + 5)
    result = galton.train(CHEETAH, agent, seeds, 50_000, n_logs=25, n_eval_episodes=0)
    told = {name: np.float64(result.log.scalars[name]) for name in Measured.scalars[len(A2C.scalars) :]}
    updates = int(result.steps[0]) // agent.rollout.size
    return {
        "samples": int(result.steps[-1]) * len(seeds),
        "above": round(float(np.nansum(told.pop("above")) * updates)),
        **{name: curve.mean(1).round(4).tolist() for name, curve in told.items()},
        **{f"sd_{name}": told[name].std(1).round(4).tolist() for name in ("bound", "bound_printed")},
    }


PRESET = {
    **PRESETS["classification"]["a2c"].settings,
    "loss": "hl-gauss-centred",
    "deterministic_action": "mode",
}


def log_mass(distribution, bins, action):
    """The log-mass of the bins that hold an action: of a Gaussian what the box clips is in the first and the last."""
    if hasattr(distribution, "logits"):
        of_bins = jax.nn.log_softmax(distribution.logits)
    else:
        mean, std = distribution.mean[..., None], jnp.broadcast_to(distribution.std(), distribution.mean.shape)
        of_bins = jax.vmap(functools.partial(init_clipped_gaussian_logits, bins))(mean, std[..., None])
    return jnp.take_along_axis(of_bins, bins.encode(action)[..., None], -1)[..., 0].sum(-1)


def learns_from_others(agent, learner, batch, advantage, returns, log_mu, bins):
    """A2C's step on another policy's rollout, the loss weighted by the advantage and by the ratio, at most 1."""
    observation, action = actor_critic.flatten(batch.observation), actor_critic.flatten(batch.action)

    def objective(params):
        outputs, estimates = actor_critic.outputs(agent, params, observation)
        distribution = actor_critic.as_update_sees(agent, outputs, params, action)
        ratio = jnp.exp(jnp.minimum(log_mass(distribution, bins, action) - log_mu, 0.0))
        policy_loss = surrogate(advantage * jax.lax.stop_gradient(ratio), agent.loss(distribution, action))
        return policy_loss + agent.algorithm.vf_coef * agent.critic.loss(estimates, returns).mean()

    params, optimizer, _ = agent.optimizer.step(learner.params, learner.optimizer, jax.grad(objective)(learner.params))
    return learner._replace(params=params, optimizer=optimizer)


def exploring(agents, task, n_updates, key, first):
    """Train the first agent by A2C, and the others on its rollouts alone; the returns of each, sampling and not."""
    explorer, *learners = agents
    bins = galton.Bins(task.record.action_low, task.record.action_high, 50)
    start, training, scoring = jax.random.split(key, 3)

    def update(i, carry):
        episodes, (own, *others) = carry
        key = jax.random.fold_in(training, i)
        episodes, normalizer, batch, _, _ = rollout(task, explorer, own, episodes, draw_noise(key, task, explorer))
        own = own._replace(normalizer=normalizer)
        observation, following = actor_critic.flatten(batch.observation), actor_critic.flatten(batch.next_observation)
        values, next_values = (actor_critic.value(explorer, own.params, each) for each in (observation, following))
        advantage = actor_critic.advantages(explorer, values, next_values, batch)
        log_mu = log_mass(
            actor_critic.distribution(explorer, own.params, observation), bins, actor_critic.flatten(batch.action)
        )
        given = batch, advantage, advantage + values, log_mu, bins
        others = [learns_from_others(agent, of, *given) for agent, of in zip(learners, others, strict=True)]
        own, _ = explorer.algorithm.update(explorer, own, batch, key)
        return episodes, [own, *others]

    begun = start_episodes(start, task, explorer.rollout.n_envs), first
    _, trained = jax.lax.fori_loop(0, n_updates, update, begun)
    return [scores(agent, learner, task, scoring) for agent, learner in zip(agents, trained, strict=True)]


def scores(agent, learner, task, key):
    """The mean return of 100 episodes that sample, and of 100 of the most likely action."""
    whole = agent.replace(rollout=agent.rollout.replace(n_steps=task.record.max_episode_steps, n_envs=100))
    noise = draw_noise(key, task, whole)
    _, _, _, finished, _ = rollout(task, whole, learner, start_episodes(key, task, 100), noise)
    return finished.undiscounted_return[-1].mean(), evaluate(key, task, agent, learner, 100).mean()


LOSSES = ("gaussian", "hl-one-hot")


def crossed(explores):
    """The policy that explores the LQR, and those that learn from its data alone, by the loss of each."""
    task, (steps, n_runs) = JaxTask(make("lqr")), LENGTH["lqr"]
    agents = [galton.make_agent(loss=loss, **WINNERS["lqr", loss]).on(task.actions.box) for loss in (explores, *LOSSES)]

    def begin(key):
        keys = jax.random.split(key, len(agents))
        size = task.observations.size
        return [actor_critic.init(key, agent, size) for key, agent in zip(keys, agents, strict=True)]

    keys = jax.vmap(jax.random.key)(jnp.arange(FIRST, FIRST + n_runs))
    first = jax.jit(functools.partial(jax.lax.map, begin))(keys)
    train = functools.partial(exploring, agents, task, steps // agents[0].rollout.size)
    told = jax.jit(jax.vmap(train))(keys, first)
    return {
        learns: {"training": _rows(training, 1), "mode": _rows(mode, 1)}
        for learns, (training, mode) in zip(("itself", *LOSSES), told, strict=True)
    }


BANDIT_HEADS = (("bandit", "hl-one-hot"), ("bandit", "hl-gauss"))
EXPONENTIAL = {"each": len(TEMPERATURES), "weighting": "awr", "temperature": TEMPERATURES}
STUDIES = {
    "sampling": {
        f"{task}, {loss}, {k}, {how}": functools.partial(on_task, task, loss, n_bins=k, bin_sample=how)
        for task, loss in (*BANDIT_HEADS, ("lqr", "hl-one-hot"))
        for k in (5, 10, 25)
        for how in ("center", "uniform")
    },
    "exponential": {
        f"{task}, {loss}, {weight}": functools.partial(on_task, task, loss, **words)
        for task, loss in (*BANDIT_HEADS, ("lqr", "hl-one-hot"), ("lqr", "hl-gauss"))
        for weight, words in {"A": {}, "exp": EXPONENTIAL}.items()
    },
    "normalised": {
        name: functools.partial(ends, "lqr", 40, 500_000, loss="gaussian", optimizer=kind(**WINNERS["lqr", "gaussian"]))
        for name, kind in {"clipped": Adam, "normalised": Normalised, "normalised apart": NormalisedApart}.items()
    },
    "bounds": {
        f"{name}, {loss}": functools.partial(bounds, loss, words)
        for loss in ("gaussian", "hl-one-hot")
        for name, words in {
            "usual": {},
            "selected": WINNERS[CHEETAH, loss],
            "normalised": {"normalize_observation": True, "normalize_reward": True, "n_envs": 8},
        }.items()
    }
    | {"usual, hl-gauss": functools.partial(bounds, "hl-gauss", {})},
    "coarse": {
        f"{size[0]}, {k}": functools.partial(ends, *size, **PRESET | {"n_bins": k})
        for size in (("lqr", 10, 300_000, 10, 25), (CHEETAH, 5, 300_000, 5, 5))
        for k in (3, 5, 7, 11, 25)
    },
    "crossed": {
        **{f"{loss} explores": functools.partial(crossed, loss) for loss in LOSSES},
        "Gaussian Exploration": functools.partial(on_task, "lqr", "hl-one-hot", exploration="gaussian"),
        "Init Gaussian": functools.partial(on_task, "lqr", "hl-one-hot", initial_policy="gaussian"),
    },
}


def main():
    jobs = {(name, entry): run for name, entries in STUDIES.items() for entry, run in entries.items()}
    study(__doc__, "text_claims", jobs, lambda found: ", ".join(found))


if __name__ == "__main__":
    main()
