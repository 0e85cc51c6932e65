"""What V-MPO and TRPO learn with each loss, beside PPO, at equal tuning; and whether the bounds on the KL hold.

8 environments × 64 steps, 5 epochs in minibatches of 128, a learning rate that falls to 0, k = 25 and the mean of the
bins as deterministic action. A method's eight draws are of the learning rate and of its own bound (`max_kl`; PPO's
`clip_range`), at the same points of a Latin hypercube. The draw with the best mean on seeds 0 and 1 is trained on ten
others, which is all that is told: the deterministic policy's return after the last update, 20 episodes for each seed,
and the divergence of updates over its bound, the mean of a whole run.

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
STEPS = {"bandit": 20_480, "lqr": 51_200}
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
}
METHODS = {f"{algorithm}, {loss}": (algorithm, loss) for algorithm in ALGORITHMS for loss in LOSSES}


def draws(algorithm):
    """The settings of each draw, each number `[8]`."""
    _, name, bounds = ALGORITHMS[algorithm]
    points = qmc.LatinHypercube(2, rng=np.random.default_rng(0)).random(DRAWS)
    low, high = np.array([(3e-4, 1e-2), bounds]).T
    rate, own = (low * (high / low) ** points).T
    return {"learning_rate": rate, name: own} | ({"max_kl_std": own / 10} if algorithm == "V-MPO" else {})


def trained(task, algorithm, loss, drawn, seeds):
    """The last returns `[draws, seeds]`, and the mean divergence of updates over its bound, NaN for PPO."""
    n = len(drawn["learning_rate"])
    each = {name: np.repeat(np.float32(values), len(seeds)) for name, values in drawn.items()}
    agent = galton.make_agent(**ROLLOUT, **LOSSES[loss], **ALGORITHMS[algorithm][0], **each)
    result = galton.train(task, agent, [*seeds] * n, STEPS[task], n_logs=10, n_eval_episodes=20)
    returns = np.where(result.diverged_at < 0, result.log.evaluation_return[:, -1], -np.inf)
    bounds = each.get("max_kl", np.full(len(returns), np.nan))
    kl = result.log.scalars["kl"].mean(1) / bounds if algorithm != "PPO" else bounds
    return returns.reshape(n, -1), kl.reshape(n, -1)


def judged(task, algorithm, loss):
    """The chosen draw, and what it does on the fresh seeds."""
    start, drawn = time.perf_counter(), draws(algorithm)
    tuned = trained(task, algorithm, loss, drawn, CHOSEN_ON)[0].mean(1)
    chosen = {name: values[[tuned.argmax()]] for name, values in drawn.items()}
    returns, kl = trained(task, algorithm, loss, chosen, FRESH)
    return {
        "draw": {name: float(value[0]) for name, value in chosen.items()},
        "tuned": tuned.round(3).tolist(),
        "returns": np.float64(returns[0]).round(3).tolist(),
        "kl": np.float64(kl[0]).round(4).tolist() if algorithm != "PPO" else None,
        "minutes": round((time.perf_counter() - start) / 60, 1),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/trust_regions.json"))
    options = parser.parse_args()
    found = json.loads(options.out.read_text()) if options.out.exists() else {}
    for task in STEPS:
        for name, method in METHODS.items():
            if task not in found.setdefault(name, {}):
                found[name][task] = judged(task, *method)
                options.out.write_text(json.dumps(found) + "\n")
            line = found[name][task]
            spread = stats.t.ppf(0.975, len(FRESH) - 1) * stats.sem(line["returns"])
            told = f"{np.mean(line['returns']):.2f} ± {spread:.2f}"
            print(
                f"| {task} | {name} | {told} | {line['kl'] and np.mean(line['kl'])} | {line['minutes']} min |",
                flush=True,
            )


if __name__ == "__main__":
    main()
