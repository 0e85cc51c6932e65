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

import argparse
import json
import time
from pathlib import Path

import numpy as np
from scipy import stats
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


def judged(task, algorithm, loss, on_robot):
    """The chosen draw, and what it does on the fresh seeds; `on_robot` is what the first robot told, if any did."""
    start, drawn = time.perf_counter(), draws(algorithm)
    if on_robot is None:
        where = (ROBOTS[0], CHOSEN_BY, CHOSEN_AT) if task in ROBOTS else (task, CHOSEN_ON, STEPS[task])
        tuned = trained(where[0], algorithm, loss, drawn, *where[1:])[0].mean(1).round(3).tolist()
    else:
        tuned = on_robot["tuned"]
    chosen = {name: values[[np.argmax(tuned)]] for name, values in drawn.items()}
    fresh = (ROBOT_SEEDS, ROBOT_STEPS) if task in ROBOTS else (FRESH, STEPS[task])
    returns, kl = trained(task, algorithm, loss, chosen, *fresh)
    return {
        "draw": {name: float(value[0]) for name, value in chosen.items()},
        "tuned": tuned,
        "returns": np.float64(returns[0]).round(3).tolist(),
        "kl": np.float64(kl[0]).round(4).tolist() if "max_kl" in chosen else None,
        "minutes": round((time.perf_counter() - start) / 60, 1),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/trust_regions.json"))
    parser.add_argument("--tasks", nargs="+", default=[*STEPS, *ROBOTS], help="all, where none are named")
    options = parser.parse_args()
    found = json.loads(options.out.read_text()) if options.out.exists() else {}
    for task in options.tasks:
        for name in ROBOT_METHODS if task in ROBOTS else METHODS:
            if task not in found.setdefault(name, {}):
                found[name][task] = judged(
                    task, *name.split(", "), found[name].get(ROBOTS[0]) if task in ROBOTS else None
                )
                options.out.write_text(json.dumps(found) + "\n")
            line = found[name][task]
            spread = stats.t.ppf(0.975, len(line["returns"]) - 1) * stats.sem(line["returns"])
            told = f"{np.mean(line['returns']):.2f} ± {spread:.2f}"
            print(
                f"| {task} | {name} | {told} | {line['kl'] and np.mean(line['kl'])} | {line['minutes']} min |",
                flush=True,
            )


if __name__ == "__main__":
    main()
