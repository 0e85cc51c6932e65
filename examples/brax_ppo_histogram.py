"""Galton's losses in Brax's PPO: a softmax over bins whose log_prob has the gradient of minus the loss.

    pip install 'galton[brax]'
    python examples/brax_ppo_histogram.py [--env inverted_pendulum] [--steps 200000]

Brax clips no gradient unless it is told to, and these losses want it.
"""

import argparse
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

if not hasattr(jax, "device_put_replicated"):  # Brax 0.14 asks for it, and JAX 0.10 took it away

    def replicated(tree, devices):
        return jax.tree.map(lambda x: jnp.stack([jnp.asarray(x)] * len(devices)), tree)

    jax.device_put_replicated = replicated

from brax import envs
from brax.training import distribution, networks
from brax.training.agents.ppo import networks as ppo_networks
from brax.training.agents.ppo import train as ppo

import galton
from galton.losses import HLGaussCentred, as_log_prob
from galton.policies import Histogram

LOSS = HLGaussCentred(eta=2.0, target_tails="reflected")


class Told(NamedTuple):
    """What Brax logs of a distribution, and sets its learning rate by where that is adaptive."""

    loc: jax.Array
    scale: jax.Array
    log_probs: jax.Array

    def kl_divergence(self, old):
        return (jnp.exp(old.log_probs) * (old.log_probs - self.log_probs)).sum((-1, -2))


class Bins(distribution.ParametricDistribution):
    """What Brax's PPO asks of a distribution, of bins in [−1, 1]. An action is its bin's center."""

    def __init__(self, event_size, n_bins=41):
        super().__init__(event_size * n_bins, None, 1, reparametrizable=False)
        self.bins = galton.Bins(-np.ones(event_size), np.ones(event_size), n_bins, "bounds")
        self.first = -((self.bins.centers / 0.6) ** 2) / 2  # a Gaussian of σ = .6 on the centers, to begin with

    def histogram(self, parameters):
        return Histogram(self.bins, self.first + parameters.reshape(*parameters.shape[:-1], *self.first.shape))

    def create_dist(self, parameters):
        found = self.histogram(parameters)
        return Told(found.mean(), found.std(), jax.nn.log_softmax(found.logits))

    def postprocess(self, event):
        return event

    def sample_no_postprocessing(self, parameters, seed):
        index = jax.random.categorical(seed, self.histogram(parameters).logits)
        return self.bins.decode(index)

    def mode(self, parameters):
        return self.histogram(parameters).mean()

    def log_prob(self, parameters, actions):
        return as_log_prob(LOSS, self.histogram(parameters), actions)

    def entropy(self, parameters, seed):
        return self.histogram(parameters).entropy()


def make_networks(observation_size, action_size, preprocess_observations_fn, hidden=(64, 64)):
    """Two MLPs, the actor's with k outputs for each dimension of the actions."""
    head = Bins(action_size)
    both = {"preprocess_observations_fn": preprocess_observations_fn, "hidden_layer_sizes": hidden}
    policy = networks.make_policy_network(head.param_size, observation_size, **both)
    return ppo_networks.PPONetworks(policy, networks.make_value_network(observation_size, **both), head)


def tell(steps, told):
    """Print the return of an evaluation."""
    print(f"{steps:>9,} steps: return {told['eval/episode_reward']:.1f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="inverted_pendulum")
    parser.add_argument("--steps", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    ppo.train(
        environment=envs.get_environment(options.env),
        num_timesteps=options.steps,
        episode_length=200,
        num_envs=64,
        batch_size=64,
        unroll_length=20,
        num_minibatches=8,
        num_updates_per_batch=4,
        learning_rate=1e-3,
        discounting=0.97,
        reward_scaling=0.1,
        normalize_observations=True,
        max_grad_norm=0.5,
        num_evals=5,
        num_eval_envs=16,
        seed=options.seed,
        network_factory=make_networks,
        progress_fn=tell,
    )


if __name__ == "__main__":
    main()
