"""What each head does on the drifting bandit: where the optimum jumps, where it walks, and where it stays.

A2C as in App. C.2 with batches of 5, a linear policy and k = 50; 4,000 updates, the optimum jumps from .5 to −.5 and
back after each 1,000, or walks .5 in as many. The learning rate of each head and change, of six, is the one with the
best mean on seeds 0 to 14; what is told is of 20 other seeds. The score is the deterministic policy's mean return over
training, whose optimum is 1. A run is back after a jump where that return is .9 at a log point, of which there are 200.

    python benchmarks/drifting.py [--out results/benchmarks/drifting.json]
"""

import argparse
import json
from pathlib import Path

import numpy as np
from scipy import stats

import galton
from galton.envs import DriftingBandit
from galton_experiments.analysis import recoveries

UPDATES, BATCH, LOGS, BACK = 4_000, 5, 200, 0.9
RATES = (3e-3, 1e-2, 3e-2, 1e-1, 3e-1, 1.0)
CHOSEN_ON, FIRST, N = range(15), 6000, 20
CENTRED = {"loss": "hl-gauss-centred", "eta": 4.48, "target_tails": "reflected"}
GAUSSIAN = {"loss": "gaussian", "log_std_init": -0.7}
HEADS = {
    "centred HL-Gauss, diffusion 1": CENTRED | {"diffusion": 1.0},
    "centred HL-Gauss, diffusion .1": CENTRED | {"diffusion": 0.1},
    "Gaussian, σ ≥ .2": GAUSSIAN | {"log_std_min": float(np.log(0.2))},
    "Gaussian, σ ≥ .1": GAUSSIAN | {"log_std_min": float(np.log(0.1))},
    "Gaussian, entropy bonus .03": GAUSSIAN | {"ent_coef": 0.03},
    "centred HL-Gauss, entropy bonus .1": CENTRED | {"ent_coef": 0.1},
    "Gaussian": GAUSSIAN,
    "smoothed softmax": {"loss": "hl-one-hot", "policy": "smoothed", "eta": 4.48, "target_tails": "reflected"},
    "centred HL-Gauss": CENTRED,
    "HL-1-Hot": {"loss": "hl-one-hot"},
    "HL-Gauss, η .75": {"loss": "hl-gauss", "eta": 0.75},
}


def curves(head, change, rates, seeds):
    """The deterministic policy's return at each log point, less the noise that the reward has, `[rates, seeds, L]`."""
    ours = {"n_bins": 50, "initial_policy": "gaussian", "deterministic_action": "mean"}
    bins = {} if head["loss"] == "gaussian" else ours
    agent = galton.make_agent(learning_rate=np.repeat(rates, len(seeds)), n_steps=BATCH, net_arch=(), **(bins | head))
    env = DriftingBandit(change=change, period=UPDATES // 4 * BATCH, noise_std=0.2)
    result = galton.train(env, agent, [*seeds] * len(rates), UPDATES * BATCH, n_logs=LOGS, n_eval_episodes=25)
    returns = np.where(result.diverged_at[:, None] < 0, result.log.evaluation_return, -9.0)
    return result.steps, returns.reshape(len(rates), len(seeds), -1)


def judged(head, change):
    """The chosen rate, the score of each fresh seed, and the updates until each is back after each jump."""
    _, tried = curves(head, change, RATES, CHOSEN_ON)
    rate = RATES[int(tried.mean((1, 2)).argmax())]
    steps, found = curves(head, change, (rate,), range(FIRST, FIRST + N))
    line = {"rate": rate, "returns": found[0].mean(-1).round(4).tolist()}
    if change == "jump":
        after = recoveries(found[0], steps, UPDATES // 4 * BATCH, BACK)
        line["updates_until_back"] = [(times._uncensored / BATCH).tolist() for times in after]
        line["never_back"] = [len(times._right) / N for times in after]
    return line


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/drifting.json"))
    options = parser.parse_args()
    found = {}
    for name, head in HEADS.items():
        found[name] = {change: judged(head, change) for change in ("jump", "walk", "still")}
        told = []
        for line in found[name].values():
            returns = np.array(line["returns"])
            spread = stats.t.ppf(0.975, N - 1) * stats.sem(returns)
            told.append(f"{returns.mean():.3f} ± {spread:.3f} ({line['rate']:g})")
        print(f"| {name} | " + " | ".join(told) + f" | {found[name]['jump']['never_back']} |", flush=True)
        options.out.write_text(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()
