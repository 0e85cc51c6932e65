"""Which head comes back where the task changes? Five heads, each with the best of 12 draws, on four tasks that change.

A2C with a linear policy and k = 50. The bandit's optimum jumps from .5 to −.5 and back after each 1,000 updates of 5
steps, goes up and down as a cosine in as many, or walks .5; the regulator's inputs are reversed after each 1,600
updates of 8 · 25 steps. A head's draws are of the learning rate and of one number of its own, at the same twelve points
of a Latin hypercube. The draw with the best mean on seeds 0 to 2 is trained on 20 others, which is all that is told.

A return is told as its share of the way to the optimum, 1, from 0: that of random actions in the bandit, and of doing
nothing in the regulator. It is −1 where it is below that or the run has diverged. A score is the mean over training of
the deterministic policy's; a run is back where it is .9.

Where the task jumps there are two controls with the same draw: the task that stays, and the memory of Adam emptied at
each change. A third is a fresh start of equal length, which is the first phase: each later one is that task or its
mirror image, and no head knows the one from the other when it begins.

    python benchmarks/changing.py [--out results/benchmarks/changing.json]   # goes on from what is there
"""

import functools
import time

import jax
import numpy as np
from kept import study
from scipy.stats import qmc

import galton
from galton.envs import LQR, DriftingBandit, JaxTask, SwitchingLQR
from galton.training.population import populate
from galton_experiments.analysis import dynamic_regret, phases, recoveries

DRAWS, CHOSEN_ON, FRESH = 12, range(3), range(7000, 7020)
PHASES, LOGS, BACK = 4, 25, 0.9
"""Phases of a run, log points in each, and the share that counts as back."""

CENTRED = {"loss": "hl-gauss-centred", "eta": 4.48, "target_tails": "reflected"}
GAUSSIAN = {"loss": "gaussian", "log_std_init": float(np.log(0.5))}
BINS = {"n_bins": 50, "initial_policy": "gaussian", "deterministic_action": "mean"}
HEADS = {
    "Gaussian": (GAUSSIAN, "log_std_init", (0.2, 1.0)),
    "Gaussian, floor": (GAUSSIAN, "log_std_min", (0.05, 0.4)),
    "centred HL-Gauss, diffusion": (BINS | CENTRED, "diffusion", (0.03, 3.0)),
    "centred HL-Gauss": (BINS | CENTRED, "eta", (1.0, 8.0)),
    "HL-1-Hot": (BINS | {"loss": "hl-one-hot"}, "head_scale", (1.0, 8.0)),
}
"""Settings, and the number that is drawn with its bounds: where it is a logarithm, those of σ itself."""

BANDIT = {"n_steps": 5}, (3e-3, 1.0), 1_000
REGULATOR = {"n_steps": 25, "n_envs": 8}, (1e-3, 1e-1), 1_600
"""The rollout, the bounds of the learning rate and the updates of a phase."""
TASKS = {
    **{change: (BANDIT, DriftingBandit(change=change, period=5_000)) for change in ("jump", "sine", "walk")},
    "lqr": (REGULATOR, SwitchingLQR(period=40_000)),
}
STILL = {"jump": DriftingBandit(change="still"), "lqr": SwitchingLQR(period=10**9)}
NOTHING = {"lqr": LQR().rest_return}
"""The return that counts as 0 where it is not that of random actions."""


def draws(head, task):
    """The settings of each draw, each number `[12]`."""
    (_, rates, _), (_, name, bounds) = TASKS[task][0], HEADS[head]
    points = qmc.LatinHypercube(2, rng=np.random.default_rng(0)).random(DRAWS)
    low, high = np.array([rates, bounds]).T
    rate, own = (low * (high / low) ** points).T
    return {"learning_rate": rate, name: np.log(own) if name.startswith("log_") else own}


def trained(head, task, drawn, seeds, env=None, empties=False):
    """Shares `[R, L]` of the deterministic policy at each log point, the log's columns, and the steps of a copy."""
    (rollout, _, updates), own = TASKS[task]
    env, n = env or own, len(drawn["learning_rate"])
    each = {name: np.repeat(values, len(seeds)) for name, values in drawn.items()}
    agent = galton.make_agent(**(HEADS[head][0] | each), **rollout, net_arch=())
    population = populate(JaxTask(env), agent, [*seeds] * n)
    shares, logs = [], []
    worst, best = NOTHING.get(task, STILL["jump"].random_return), env.optimal_return
    for point in range(1, PHASES * LOGS + 1):
        population.advance(updates // LOGS)
        share = (population.evaluate(25 if task != "lqr" else 5).mean(1) - worst) / (best - worst)
        shares.append(np.where(population.diverged_at < 0, np.maximum(share, -1), -1))
        logs.append({name: np.asarray(values) for name, values in population.log().scalars.items()})
        if empties and point % LOGS == 0:
            learner = population.learner
            population.put(learner._replace(optimizer=jax.tree.map(np.zeros_like, learner.optimizer)))
    columns = {name: np.stack([log[name] for log in logs], 1) for name in ("env_regret", "entropy")}
    steps = np.arange(1, PHASES * LOGS + 1) * (updates // LOGS) * agent.rollout.n_steps
    return np.stack(shares, 1), columns, steps


def told(head, task, drawn, env=None, empties=False):
    """The entry of the file for one draw on the fresh seeds."""
    shares, columns, steps = trained(head, task, drawn, FRESH, env, empties)
    period = int(steps[-1]) // PHASES
    line = {
        "scores": shares.mean(1),
        "regret": dynamic_regret(columns["env_regret"], steps)[:, -1] / steps[-1],
        "phases": [phase.mean(1) for phase in phases(shares, steps, period)],
        "entropy_before": [phase[:, -1] for phase in phases(columns["entropy"], steps, period)],
        "curve": shares.mean(0),
    }
    line = {name: np.round(np.float64(values), 4).tolist() for name, values in line.items()}
    if task in STILL and env is None:
        times = recoveries(shares, steps, period, BACK)
        line["never_back"] = [len(each._right) / len(FRESH) for each in times]
        line["updates_until_back"] = [(each._uncensored // TASKS[task][0][0]["n_steps"]).tolist() for each in times]
    return line


def judged(head, task):
    """The chosen draw of a head on a task, what it does on the fresh seeds, and what it does in the controls."""
    start, drawn = time.perf_counter(), draws(head, task)
    tuned = trained(head, task, drawn, CHOSEN_ON)[0].mean(1).reshape(DRAWS, -1).mean(1)
    chosen = {name: values[[tuned.argmax()]] for name, values in drawn.items()}
    line = {
        "draw": {name: float(value[0]) for name, value in chosen.items()},
        "tuned": np.float64(tuned).round(4).tolist(),
    }
    line |= told(head, task, chosen)
    if task in STILL:
        line["no change"] = told(head, task, chosen, STILL[task])
        line["emptied"] = told(head, task, chosen, empties=True)
    return line | {"minutes": round((time.perf_counter() - start) / 60, 1)}


def main():
    jobs = {(head, task): functools.partial(judged, head, task) for task in TASKS for head in HEADS}
    study(__doc__, "changing", jobs, lambda line: f"{np.mean(line['scores']):.3f} | {line['minutes']} min")


if __name__ == "__main__":
    main()
