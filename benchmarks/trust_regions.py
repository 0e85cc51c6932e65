"""What V-MPO and TRPO learn with each loss, beside PPO, at equal tuning; and whether the bounds on the KL hold.

8 environments × 64 steps, 5 epochs in minibatches of 128, a learning rate that falls to 0, k = 25 and the mean of the
bins as deterministic action. A method's eight draws are of the learning rate and of its own number at the same points
of a Latin hypercube: `max_kl`, PPO's `clip_range`, and for AWR, which is PPO with these weights, `temperature`. The
draw with the best mean on seeds 0 and 1 is trained on ten others, which is all that is told: the deterministic
policy's return after the last update, 20 episodes for each seed, and the divergence of updates over its bound, the
mean of a run.

On robots methods have the numbers of `benchmarks/ppo_scores.py`, and bins a head scale of 4. One seed of HalfCheetah
at 200,000 steps chooses among the same draws. Five others are told, a million steps of HalfCheetah and of Walker2d.

    python benchmarks/trust_regions.py [--out results/benchmarks/trust_regions.json]   # goes on from what is there
"""

import functools
import time

import numpy as np
from kept import interval, study
from scipy.stats import qmc

import galton

DRAWS, CHOSEN_ON, FRESH = 8, range(2), range(8000, 8010)
STEPS = {"bandit": 20_480, "lqr": 51_200, "acrobot": 102_400}
ROLLOUT = {"n_envs": 8, "n_steps": 64, "batch_size": 128, "gae_lambda": 0.95, "decay_steps": np.inf}
BINS = {"n_bins": 25, "deterministic_action": "mean"}
LOSSES = {
    "least squares": {"loss": "gaussian"},
    "HL-1-Hot": BINS | {"loss": "hl-one-hot"},
    "HL-Gauss": BINS | {"loss": "hl-gauss", "eta": 0.75},
    "centred HL-Gauss": BINS | {"loss": "hl-gauss-centred", "eta": 0.75},
}
ALGORITHMS = {
    "PPO": ({"algorithm": "ppo", "n_epochs": 5}, "clip_range", (0.05, 0.5)),
    "TRPO": ({"algorithm": "trpo", "n_critic_updates": 5}, "max_kl", (0.002, 0.1)),
    "V-MPO": ({"algorithm": "v-mpo", "n_epochs": 5}, "max_kl", (0.002, 0.1)),
    "AWR": ({"algorithm": "ppo", "weighting": "awr"}, "temperature", (0.1, 3)),
}
METHODS = [f"{algorithm}, {loss}" for algorithm in ("PPO", "TRPO", "V-MPO") for loss in LOSSES]

ROBOTS, ROBOT_STEPS, ROBOT_SEEDS = ("HalfCheetah-v5", "Walker2d-v5"), 1_000_000, range(8000, 8005)
CHOSEN_AT, CHOSEN_BY = 200_000, [100]
OF_VMPO = ("V-MPO, least squares", "V-MPO, HL-1-Hot", "V-MPO, HL-Gauss")
ROBOT_METHODS = ("TRPO, least squares", *OF_VMPO, "AWR, least squares")
ROBOT = {"n_steps": 256, "batch_size": 64, "normalize_observation": True, "normalize_reward": True, "box_units": 1}
OF_ROBOTS = {
    "least squares": {"log_std_init": -0.5},
    "HL-1-Hot": {"n_bins": 41, "head_scale": 4},
    "HL-Gauss": {"n_bins": 41, "head_scale": 4},
    "TRPO": {"n_critic_updates": 10},
    "V-MPO": {"n_epochs": 10},
    "AWR": {"n_epochs": 10},
}


def draws(algorithm):
    """The settings of each draw, each number `[8]`."""
    _, name, bounds = ALGORITHMS[algorithm]
    points = qmc.LatinHypercube(2, rng=np.random.default_rng(0)).random(DRAWS)
    low, high = np.array([(3e-4, 1e-2), bounds]).T
    rate, own = (low * (high / low) ** points).T
    return {"learning_rate": rate, name: own} | ({"max_kl_std": own / 10} if algorithm == "V-MPO" else {})


def trained(task, algorithm, loss, drawn, seeds, steps):
    """The last returns `[draws, seeds]`, and the mean divergence of updates over its bound, NaN for PPO."""
    n = len(drawn["learning_rate"])
    each = {name: np.repeat(np.float32(values), len(seeds)) for name, values in drawn.items()}
    robot = ROBOT | OF_ROBOTS[algorithm] | OF_ROBOTS[loss] if task in ROBOTS else {}
    agent = galton.make_agent(**ROLLOUT | LOSSES[loss] | ALGORITHMS[algorithm][0] | robot, **each)
    result = galton.train(task, agent, [*seeds] * n, steps, n_logs=10, n_eval_episodes=20)
    returns = np.where(result.diverged_at < 0, result.log.evaluation_return[:, -1], -np.inf)
    bounds = each.get("max_kl", np.full(len(returns), np.nan))
    kl = result.log.scalars["kl"].mean(1) / bounds if "max_kl" in drawn else bounds
    return returns.reshape(n, -1), kl.reshape(n, -1)


@functools.cache
def tuned(task, algorithm, loss):
    """The mean return of each draw; one robot's draw is chosen for all."""
    seeds, steps = (CHOSEN_BY, CHOSEN_AT) if task in ROBOTS else (CHOSEN_ON, STEPS[task])
    return trained(task, algorithm, loss, draws(algorithm), seeds, steps)[0].mean(1).round(3).tolist()


def judged(task, algorithm, loss):
    """The chosen draw, and what it does on the fresh seeds."""
    start = time.perf_counter()
    means = tuned(ROBOTS[0] if task in ROBOTS else task, algorithm, loss)
    chosen = {name: values[[np.argmax(means)]] for name, values in draws(algorithm).items()}
    fresh = (ROBOT_SEEDS, ROBOT_STEPS) if task in ROBOTS else (FRESH, STEPS[task])
    returns, kl = trained(task, algorithm, loss, chosen, *fresh)
    return {
        "draw": {name: float(value[0]) for name, value in chosen.items()},
        "tuned": means,
        "returns": np.float64(returns[0]).round(3).tolist(),
        "kl": np.float64(kl[0]).round(4).tolist() if "max_kl" in chosen else None,
        "minutes": round((time.perf_counter() - start) / 60, 1),
    }


def main():
    jobs = {
        (name, task): functools.partial(judged, task, *name.split(", "))
        for task in (*STEPS, *ROBOTS)
        for name in (ROBOT_METHODS if task in ROBOTS else METHODS)
    }
    tell = lambda line: f"{interval(line['returns'], 2)} | {line['kl'] and np.mean(line['kl'])} | {line['minutes']} min"  # noqa: E731
    study(__doc__, "trust_regions", jobs, tell)


if __name__ == "__main__":
    main()
