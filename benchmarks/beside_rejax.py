"""What rejax's PPO and Galton's learn on gymnax's Pendulum with the same settings.

Both have 8 copies and rollouts of 256 steps each, minibatches of 64, ten epochs, rate 1e-3, γ .95, λ .95, clip .2, no
entropy bonus, no clipping of gradients, value losses clipped too, two hidden layers of 64 tanh units, and normalised
observations and rewards. rejax takes time limits for terminations. The deterministic policy plays 32 episodes in the
end. Run it where `make bench` installs rejax:

    .venv-rejax/bin/python benchmarks/beside_rejax.py [--seeds 10] [--out results/benchmarks/beside_rejax.json]
"""

import argparse
import json
from pathlib import Path

import jax
import numpy as np
from rejax import PPO
from rejax.evaluate import evaluate
from scipy import stats

import galton

FIRST_SEED, STEPS, N_EPISODES = 7000, 204_800, 32


def of_rejax(seeds):
    """The final return of rejax's PPO for each seed."""
    algorithm = PPO.create(
        env="Pendulum-v1",
        agent_kwargs={"activation": "tanh", "hidden_layer_sizes": (64, 64)},
        total_timesteps=STEPS,
        eval_freq=STEPS,
        skip_initial_evaluation=True,
        num_envs=8,
        num_steps=256,
        num_epochs=10,
        num_minibatches=32,
        learning_rate=1e-3,
        gamma=0.95,
        reward_normalization_discount=0.95,
        gae_lambda=0.95,
        ent_coef=0.0,
        normalize_observations=True,
        normalize_rewards=True,
    )

    def final_return(algorithm, state, key):
        def act(observation, _):
            normalised = algorithm.normalize_obs(state.obs_rms_state, observation)[None]
            params = state.actor_ts.params
            return algorithm.actor.apply(params, normalised, method=lambda actor, x: actor._action_dist(x).mean())[0]

        limit = algorithm.env_params.max_steps_in_episode
        return evaluate(act, key, algorithm.env, algorithm.env_params, N_EPISODES, limit)[1].mean()

    algorithm = algorithm.replace(eval_callback=final_return)
    return [float(jax.jit(algorithm.train)(jax.random.key(seed))[1][-1]) for seed in seeds]


def of_galton(seeds):
    """The final return of Galton's PPO for each seed."""
    agent = galton.make_agent(
        algorithm="ppo",
        loss="gaussian",
        kernel_init="lecun",
        n_envs=8,
        n_steps=256,
        batch_size=64,
        n_epochs=10,
        learning_rate=1e-3,
        gamma=0.95,
        gae_lambda=0.95,
        clip_range_vf=0.2,
        max_grad_norm=1e9,
        normalize_observation=True,
        normalize_reward=True,
    )
    result = galton.train("gymnax:Pendulum-v1", agent, seeds, STEPS, n_logs=1, n_eval_episodes=N_EPISODES)
    return result.log.evaluation_return[:, -1].tolist()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/beside_rejax.json"))
    options = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + options.seeds)
    found = {"seeds": [*seeds]}
    for name, learn in (("rejax", of_rejax), ("Galton", of_galton)):
        found[name] = [round(value, 2) for value in learn(seeds)]
        spread = stats.t.ppf(0.975, len(seeds) - 1) * stats.sem(found[name])
        least, most = min(found[name]), max(found[name])
        print(f"| {name} | {np.mean(found[name]):,.1f} ± {spread:,.1f} | {least:,.1f} to {most:,.1f} |")
    options.out.write_text(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()
