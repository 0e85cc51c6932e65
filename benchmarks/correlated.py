"""What each head reaches where the best action dimensions depend on each other, beside what a factored policy can.

A2C with an entropy bonus α trains on the xor bandit and on the ridge bandit (`galton.envs.XorBandit`, `RidgeBandit`),
with a policy that is the same in every state. The score is E r + α H of the policy at the end, exactly: over bins by
enumeration, of Gaussians in closed form. Beside it are the optimum of all policies and that of factored ones. On the
ridge the entropy of bins is told as a density's. A Gaussian has no optimum on the xor bandit, whose box doesn't bound
its entropy. Ten fresh seeds for each.

On HalfCheetah PPO trains with the numbers of the preset "gaussian", and bins, 41 from bound to bound, with a head scale
of 4. Told are the returns of training and of the deterministic policy, by the mode, of five fresh seeds.

    python benchmarks/correlated.py [--out results/benchmarks/correlated.json]   # goes on from what is there
"""

import jax
import jax.numpy as jnp
import numpy as np
from kept import interval, study

import galton
from galton.algorithms import actor_critic
from galton.envs import RidgeBandit, XorBandit
from galton.presets import PRESETS

ALPHA = {"xor-bandit": 0.25, "ridge-bandit": 0.1}
ENVS = {"xor-bandit": XorBandit(), "ridge-bandit": RidgeBandit(across=16.0)}
K = {"xor-bandit": 10, "ridge-bandit": 25}
SEEDS, STEPS = range(7000, 7010), 200_000
A2C = {"n_steps": 200, "net_arch": (), "learning_rate": 0.03, "decay_steps": STEPS}
ONE_HOT = {"loss": "hl-one-hot"}
CENTRED = {"loss": "hl-gauss-centred", "eta": 1.0, "target_tails": "reflected"}
HEADS = {
    "gaussian": {"loss": "gaussian", "log_std_init": -1.0},
    "full-gaussian": {"loss": "gaussian", "policy": "full-gaussian", "log_std_init": -1.0},
    **{
        f"{policy}, {loss['loss']}": loss | {"policy": policy}
        for policy in ("histogram", "joint", "autoregressive")
        for loss in (ONE_HOT, CENTRED)
    },
}

ROBOT, ROBOT_SEEDS, ROBOT_STEPS = "HalfCheetah-v5", range(7000, 7005), 300_000
PPO = {"algorithm": "ppo"} | PRESETS["gaussian"]["ppo"].settings
BINS = ONE_HOT | {"n_bins": 41, "bin_centers": "bounds", "head_scale": 4.0, "initial_policy": "clipped-gaussian"}
ON_ROBOT = {
    "gaussian": {"loss": "gaussian"},
    "full-gaussian": {"loss": "gaussian", "policy": "full-gaussian"},
    "histogram, hl-one-hot": BINS,
    "autoregressive, hl-one-hot": BINS | {"policy": "autoregressive"},
}


def returns(head):
    """The last returns of training and of the deterministic policy on the robot, for each seed."""
    agent = galton.make_agent(**PPO | head)
    result = galton.train(ROBOT, agent, [*ROBOT_SEEDS], ROBOT_STEPS, n_logs=10, n_eval_episodes=20)
    metrics = {"training": "training_return", "deterministic": "evaluation_return"}
    return {name: np.float64(result.final(metric)).round(1).tolist() for name, metric in metrics.items()}


def values(name, head, seeds, **words):
    """E r + α H of each seed's policy after training."""
    env, alpha = ENVS[name], ALPHA[name]
    bins = {} if head["loss"] == "gaussian" else {"n_bins": K[name]}
    agent = galton.make_agent(**A2C | head | bins | {"ent_coef": alpha} | words)
    result = galton.train(env, agent, list(seeds), STEPS, n_logs=1, n_eval_episodes=0)
    agent = agent.on(galton.parts.Box.of(env.action_low, env.action_high))
    tell = _of_bins if bins else _of_gaussian
    of_one = jax.jit(lambda params: tell(env, alpha, actor_critic.distribution(agent, params, jnp.ones((1, 1)))))
    return np.asarray(jax.lax.map(of_one, result.learner.params), np.float64)


def _of_bins(env, alpha, distribution):
    """By enumeration; on the ridge with the entropy of the density that is uniform in each bin."""
    centers = jnp.asarray(galton.Bins(env.action_low, env.action_high, K[_name(env)]).centers)
    cells = jnp.stack(jnp.meshgrid(*centers, indexing="ij"), -1).reshape(-1, 1, env.d)
    log_prob = jax.vmap(distribution.log_prob)(cells)[:, 0]
    of_bins = (jnp.exp(log_prob) * (env.worth(cells[:, 0]) - alpha * log_prob)).sum()
    return of_bins + alpha * env.d * np.log(2 / K[_name(env)]) * isinstance(env, RidgeBandit)


def _of_gaussian(env, alpha, distribution):
    """E r is −½ (tr QΣ + δᵀQδ) with the mean's distance δ from c."""
    covariance = jnp.diag(distribution.std()[0] ** 2)
    if hasattr(distribution, "factor"):
        covariance = distribution.factor @ distribution.factor.T
    curvature, apart = jnp.asarray(env.curvature), distribution.mean[0] - env.center
    cost = jnp.trace(curvature @ covariance) + apart @ curvature @ apart
    return -0.5 * cost + alpha * distribution.entropy()[0]


def _name(env):
    return next(name for name, own in ENVS.items() if own == env)


def bounds(name):
    """The optimum of all policies, and that of factored ones."""
    given = (ALPHA[name], K[name]) if name == "xor-bandit" else (ALPHA[name],)
    return ENVS[name].soft_optimum(*given), ENVS[name].factored_optimum(*given)


def tell(found):
    """The bound, or the means with their intervals."""
    if isinstance(found, dict):
        return " | ".join(interval(of, 0) for of in found.values())
    return interval(found, 4) if isinstance(found, list) else f"{found:.4f}"


def main():
    jobs = {}
    for name in ENVS:
        for place, bound in enumerate(("optimum", "factored")):
            jobs[name, bound] = lambda name=name, place=place: bounds(name)[place]
        for head, words in HEADS.items():
            if name != "xor-bandit" or words["loss"] != "gaussian":
                jobs[name, "values", head] = lambda name=name, words=words: values(name, words, SEEDS).round(5).tolist()
    for head, words in ON_ROBOT.items():
        jobs[ROBOT, head] = lambda words=words: returns(words)
    study(__doc__, "correlated", jobs, tell)


if __name__ == "__main__":
    main()
