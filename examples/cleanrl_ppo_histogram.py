"""PPO in one file of PyTorch, as CleanRL writes it, with a softmax over bins in the place of the Gaussian.

    python examples/cleanrl_ppo_histogram.py --env-id Pendulum-v1 --total-timesteps 100000

Only three places know of bins: the actor's last layer, `Agent.policy`, and the settings in `Args`. Its γ, rate and
rollout are for Pendulum; elsewhere begin with γ .99 and 3e-4.
"""

import time
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import torch
import tyro
from torch import nn

from galton.torch import Histogram, initialize_


@dataclass
class Args:
    """The settings; those of the distribution come last."""

    env_id: str = "Pendulum-v1"
    seed: int = 1
    total_timesteps: int = 100_000
    learning_rate: float = 1e-3
    num_envs: int = 4
    num_steps: int = 512
    gamma: float = 0.9
    gae_lambda: float = 0.95
    num_minibatches: int = 32
    update_epochs: int = 10
    clip_coef: float = 0.2
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    n_bins: int = 41
    loss: str = "hl-gauss-centred"
    eta: float = 2.0


def make_env(env_id, gamma):
    """Make one environment with the wrappers of CleanRL's continuous PPO, but ClipAction: bins end at the bounds."""
    env = gym.wrappers.RecordEpisodeStatistics(gym.wrappers.FlattenObservation(gym.make(env_id)))
    env = gym.wrappers.TransformObservation(
        gym.wrappers.NormalizeObservation(env), lambda obs: np.clip(obs, -10, 10), None
    )
    return gym.wrappers.NormalizeReward(env, gamma=gamma)


def layer(n_in, n_out, gain=2**0.5):
    """Return a linear layer with orthogonal weights."""
    made = nn.Linear(n_in, n_out)
    nn.init.orthogonal_(made.weight, gain)
    nn.init.constant_(made.bias, 0.0)
    return made


class Agent(nn.Module):
    """An actor whose outputs are d · k logits, and a critic."""

    def __init__(self, envs, args):
        super().__init__()
        n_in, space = envs.single_observation_space.shape[0], envs.single_action_space
        self.shape = (space.shape[0], args.n_bins)
        self.bins = {"low": space.low, "high": space.high, "loss": args.loss, "eta": args.eta}
        self.critic = nn.Sequential(layer(n_in, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), layer(64, 1, 1.0))
        head = initialize_(nn.Linear(64, self.shape[0] * args.n_bins), args.n_bins)
        self.actor = nn.Sequential(layer(n_in, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), head)

    def policy(self, obs):
        """Return the distribution of actions in these states."""
        return Histogram(self.actor(obs).unflatten(-1, self.shape), **self.bins)


def advantages(rewards, values, next_values, terminated, done, args):
    """Return the generalised advantage estimates of a rollout, whose time limits keep the next state's value."""
    found, last = torch.zeros_like(rewards), 0.0
    for t in reversed(range(len(rewards))):
        delta = rewards[t] + args.gamma * next_values[t] * (1 - terminated[t]) - values[t]
        found[t] = last = delta + args.gamma * args.gae_lambda * (1 - done[t]) * last
    return found


def main(args):
    """Train, and print the mean return of the last hundred episodes."""
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)
    same_step = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}
    envs = gym.vector.SyncVectorEnv([lambda: make_env(args.env_id, args.gamma)] * args.num_envs, **same_step)
    agent = Agent(envs, args)
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)
    obs, returns, start = torch.Tensor(envs.reset(seed=args.seed)[0]), [], time.time()
    size = args.num_envs * args.num_steps

    for update in range(1, args.total_timesteps // size + 1):
        optimizer.param_groups[0]["lr"] = args.learning_rate * (1 - (update - 1) * size / args.total_timesteps)
        kept = []
        for _ in range(args.num_steps):
            with torch.no_grad():
                policy = agent.policy(obs)
                action = policy.sample()
                log_prob, value = policy.log_prob(action), agent.critic(obs).flatten()
                following, reward, terminated, truncated, infos = envs.step(action.numpy())
                final = np.stack(
                    [infos["final_obs"][i] if done else following[i] for i, done in enumerate(terminated | truncated)]
                )
                next_value = agent.critic(torch.Tensor(final)).flatten()
            returns += [infos["final_info"]["episode"]["r"][i] for i in np.flatnonzero(terminated | truncated)]
            numbers = (torch.Tensor(x) for x in (reward, terminated, terminated | truncated))
            kept.append((obs, action, log_prob, value, next_value, *numbers))
            obs = torch.Tensor(following)

        b_obs, b_actions, b_log_probs, b_values, b_next, rewards, ends, done = map(torch.stack, zip(*kept, strict=True))
        b_advantages = advantages(rewards, b_values, b_next, ends, done, args)
        b_returns = b_advantages + b_values
        rows = [x.flatten(0, 1) for x in (b_obs, b_actions, b_log_probs, b_advantages, b_returns)]

        for _ in range(args.update_epochs):
            for index in torch.randperm(size).chunk(args.num_minibatches):
                mb_obs, mb_actions, mb_log_probs, mb_advantages, mb_returns = (x[index] for x in rows)
                policy = agent.policy(mb_obs)
                ratio = (policy.log_prob(mb_actions) - mb_log_probs).exp()
                mb_advantages = (mb_advantages - mb_advantages.mean()) / (mb_advantages.std() + 1e-8)
                clipped = ratio.clamp(1 - args.clip_coef, 1 + args.clip_coef)
                pg_loss = -torch.min(mb_advantages * ratio, mb_advantages * clipped).mean()
                v_loss = 0.5 * (agent.critic(mb_obs).flatten() - mb_returns).pow(2).mean()
                loss = pg_loss - args.ent_coef * policy.entropy().mean() + args.vf_coef * v_loss
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), args.max_grad_norm)
                optimizer.step()

        mean = np.mean(returns[-100:]) if returns else float("nan")
        print(f"{update * size:>9,} steps, return {mean:,.1f}, {update * size / (time.time() - start):,.0f} steps/s")
    envs.close()
    return np.mean(returns[-100:])


if __name__ == "__main__":
    main(tyro.cli(Args))
