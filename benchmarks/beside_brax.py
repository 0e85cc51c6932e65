"""What Brax's PPO and Galton's learn on a task of Brax's with the same settings.

Both have 64 copies and rollouts of 160 steps each, minibatches of 1,280, four epochs, rate 1e-3, γ .97, λ .95, clip .3,
entropy .01, gradients clipped to .5, two hidden layers of 64 SiLU units, normalised observations, and a Gaussian
squashed by tanh whose σ depends on the state. Brax cuts advantages off after 20 steps and computes them anew in each
minibatch. The deterministic policy plays 32 episodes of 200 steps in the end. Run it where `make test-others` installs:

    .venv-others/bin/python benchmarks/beside_brax.py [--seeds 5] [--out results/benchmarks/beside_brax.jsonl]
"""

import argparse
import functools
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

import galton

TASKS = {"inverted_double_pendulum": 409_600, "reacher": 819_200}
FIRST_SEED, LENGTH, N_EPISODES = 7000, 200, 32


def mend_jax():
    """Give back what Brax 0.14 asks for, and JAX 0.10 took away."""
    if not hasattr(jax, "device_put_replicated"):
        jax.device_put_replicated = lambda tree, devices: jax.tree.map(
            lambda x: jnp.stack([jnp.asarray(x)] * len(devices)), tree
        )


def of_brax(task, seeds):
    """The final return of Brax's PPO for each seed."""
    mend_jax()
    from brax import envs
    from brax.training.agents.ppo import networks
    from brax.training.agents.ppo import train as ppo

    sizes = {"policy_hidden_layer_sizes": (64, 64), "value_hidden_layer_sizes": (64, 64)}
    for seed in seeds:
        told = []
        ppo.train(
            environment=envs.get_environment(task),
            num_timesteps=TASKS[task],
            episode_length=LENGTH,
            num_envs=64,
            batch_size=64,
            unroll_length=20,
            num_minibatches=8,
            num_updates_per_batch=4,
            learning_rate=1e-3,
            discounting=0.97,
            entropy_cost=0.01,
            clipping_epsilon=0.3,
            normalize_observations=True,
            max_grad_norm=0.5,
            num_evals=2,
            num_eval_envs=N_EPISODES,
            deterministic_eval=True,
            seed=seed,
            network_factory=functools.partial(networks.make_ppo_networks, **sizes),
            progress_fn=lambda _, metrics, told=told: told.append(float(metrics["eval/episode_reward"])),
        )
        yield told[-1]


def of_galton(task, seeds):
    """The final return of Galton's PPO for each seed, one after the other as Brax's."""
    agent = galton.make_agent(
        algorithm="ppo",
        loss="gaussian",
        policy="squashed-gaussian",
        state_dependent_std=True,
        log_std_init=-0.37,
        activation="silu",
        kernel_init="lecun",
        n_envs=64,
        n_steps=160,
        batch_size=1280,
        n_epochs=4,
        learning_rate=1e-3,
        gamma=0.97,
        gae_lambda=0.95,
        ent_coef=0.01,
        clip_range=0.3,
        vf_coef=0.25,
        normalize_observation=True,
        resets="first",
    )
    env = galton.envs.find(f"brax:{task}", max_episode_steps=LENGTH)
    for seed in seeds:
        result = galton.train(env, agent, [seed], TASKS[task], n_logs=1, n_eval_episodes=N_EPISODES)
        yield float(result.log.evaluation_return[0, -1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--tasks", nargs="+", default=[*TASKS])
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/beside_brax.jsonl"))
    options = parser.parse_args()
    lines = [*map(json.loads, options.out.read_text().splitlines())] if options.out.exists() else []
    for task in options.tasks:
        for name, learn in (("Brax", of_brax), ("Galton", of_galton)):
            known = {line["seed"] for line in lines if (line["task"], line["library"]) == (task, name)}
            seeds = [seed for seed in range(FIRST_SEED, FIRST_SEED + options.seeds) if seed not in known]
            start = time.perf_counter()
            for seed, found in zip(seeds, learn(task, seeds), strict=True):
                line = {"task": task, "library": name, "seed": seed, "return": round(found, 3)}
                line |= {"seconds": round(time.perf_counter() - start, 1)}
                start = time.perf_counter()
                lines.append(line)
                with options.out.open("a") as file:
                    file.write(json.dumps(line) + "\n")
    for task in options.tasks:
        for name in ("Brax", "Galton"):
            own = [line["return"] for line in lines if (line["task"], line["library"]) == (task, name)]
            spread = stats.t.ppf(0.975, len(own) - 1) * stats.sem(own)
            print(f"| {task} | {name} | {np.mean(own):,.1f} ± {spread:,.1f} | {min(own):,.1f} to {max(own):,.1f} |")


if __name__ == "__main__":
    main()
