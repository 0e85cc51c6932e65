"""rejax's PPO set up as A2C on its own Mountain Car, many runs under vmap: one epoch, one minibatch, 20 steps.

Runs in an environment of its own (`make bench` makes it): it prints the steps per second of each slice that it is asked
for, one line of standard input each.
"""

import sys
import time

import jax
import jax.numpy as jnp
from rejax import PPO

RUNS, STEPS = 128, 4_000


def main():
    algorithm = PPO.create(
        env="MountainCarContinuous-v0",
        agent_kwargs={"activation": "tanh", "hidden_layer_sizes": (64, 64)},
        total_timesteps=STEPS,
        eval_freq=STEPS,
        skip_initial_evaluation=True,
        num_envs=1,
        num_steps=20,
        num_epochs=1,
        num_minibatches=1,
        learning_rate=7e-4,
        max_grad_norm=0.5,
        gae_lambda=1.0,
        ent_coef=0.0,
    ).replace(eval_callback=lambda *_: jnp.zeros(()))  # no evaluation
    train = jax.jit(jax.vmap(algorithm.train))
    keys = jax.random.split(jax.random.key(0), RUNS)
    jax.block_until_ready(train(keys))
    print("ready", flush=True)
    for _ in sys.stdin:
        start = time.perf_counter()
        jax.block_until_ready(train(keys))
        print(RUNS * STEPS / (time.perf_counter() - start), flush=True)


if __name__ == "__main__":
    main()
