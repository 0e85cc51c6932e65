"""Settings under one name: what to train with where no loss is named, and what papers train with."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from galton.errors import require, require_word

GAUSSIAN, CLASSIFICATION, RN_D = "gaussian", "classification", "rn-d"
PLAYGROUND, PAPER = "playground", "paper"
RECOMMENDED = "recommended"
"""The name of the preset of classification up to 0.2.0.dev0, in commands and files."""


class Preset(NamedTuple):
    """A preset changes some of an algorithm's defaults."""

    name: str
    """Its key in PRESETS."""
    loss: Any = "hl-gauss"
    """A key of LOSSES, or a loss itself."""
    settings: Mapping[str, object] = {}
    """Settings by name. With another number of environments than its n_envs, n_steps changes so that a
    rollout is as long."""


_A2C_GAUSSIAN = {
    "n_envs": 8,
    "n_steps": 20,
    "learning_rate": 0.00318,
    "decay_steps": math.inf,
    "gamma": 0.994,
    "gae_lambda": 0.938,
    "ent_coef": 0.0244,
    "max_grad_norm": 1.01,
    "normalize_observation": True,
    "normalize_reward": True,
    "normalize_advantage": True,
    "box_units": 1.0,
    "log_std_init": -0.89,
    "log_std_min": -3.0,
}
"""benchmarks/winner-a2c.toml selected these settings for the Gaussian."""

_PPO_GAUSSIAN = {
    "n_envs": 8,
    "n_steps": 256,
    "decay_steps": math.inf,
    "normalize_observation": True,
    "normalize_reward": True,
    "box_units": 1.0,
    "log_std_init": -0.5,
}
"""Set by hand on HalfCheetah (docs/ppo.md): Stable-Baselines3's numbers with eight environments, normalisation and a
linear decay, in units of the box."""

_A2C_CLASSIFICATION = {
    "n_bins": 25,
    "n_envs": 8,
    "n_steps": 20,
    "learning_rate": 0.00133,
    "gamma": 0.992,
    "gae_lambda": 0.851,
    "ent_coef": 0.000944,
    "max_grad_norm": 0.328,
    "normalize_observation": True,
    "normalize_reward": True,
    "normalize_advantage": True,
    "eta_rule": "policy",
    "eta": 3.96,
    "box_units": 1.0,
    "bin_centers": "bounds",
    "target_tails": "edges",
    "initial_policy": "clipped-gaussian",
    "log_std_init": -0.616,
    "deterministic_action": "mean",
}
"""benchmarks/winner-a2c.toml selected these for its best head over bins, but for the decay of the learning rate, which
changes little here (docs/winner.md)."""

_PPO_CLASSIFICATION = {
    "n_bins": 50,
    "n_envs": 8,
    "n_steps": 256,
    "n_epochs": 5,
    "learning_rate": 0.00104,
    "decay_steps": math.inf,
    "gamma": 0.993,
    "gae_lambda": 0.99,
    "ent_coef": 0.000599,
    "clip_range": 0.206,
    "max_grad_norm": 0.292,
    "normalize_observation": True,
    "normalize_reward": True,
    "eta": 4.48,
    "box_units": 1.0,
    "bin_centers": "bounds",
    "target_tails": "edges",
    "initial_policy": "clipped-gaussian",
    "log_std_init": -0.858,
    "deterministic_action": "mean",
}
"""The same of benchmarks/winner-mujoco.toml."""

_PPO_RN_D = {
    "n_envs": 16,
    "n_steps": 1024,
    "batch_size": 256,
    "decay_steps": math.inf,
    "vf_coef": 0.25,
    "clip_range_vf": 0.2,
    "normalize_observation": True,
    "normalize_reward": True,
    "network": "simba",
    "simba_width": 256,
    "simba_blocks": 2,
    "critic_arch": (64, 64),
    "n_bins": 41,
    "bin_centers": "bounds",
}
"""RN-D (Bian et al., 2026): configs/gym.yaml and rnd.py of github.com/alwaysbyx/RND-RL, whose value loss has a factor
of ½ before vf_coef. It takes the larger of the clipped and the plain error, as CleanRL does, not the clipped one."""

_PPO_PLAYGROUND = {
    "policy": "squashed-gaussian",
    "state_dependent_std": True,
    "log_std_init": -0.37,
    "net_arch": (32, 32, 32, 32),
    "critic_arch": (256, 256, 256, 256, 256),
    "activation": "silu",
    "kernel_init": "lecun",
    "n_envs": 2048,
    "n_steps": 480,
    "batch_size": 30_720,
    "n_epochs": 16,
    "learning_rate": 1e-3,
    "gamma": 0.995,
    "gae_lambda": 0.95,
    "clip_range": 0.3,
    "ent_coef": 0.01,
    "vf_coef": 0.25,
    "max_grad_norm": 1e9,
    "normalize_observation": True,
    "normalize_advantage": True,
}
"""MuJoCo Playground 0.2's numbers of Brax's PPO for its DM Control tasks, dm_control_suite_params.py, and what Brax
0.14.2 has beside them: networks, σ = softplus(0) at first, no clipping of gradients, half the value loss. Brax cuts
advantages off after 30 steps and computes them anew in each minibatch, and rewards are ten times as large there."""

PRESETS: Mapping[str, Mapping[str, Preset]] = {
    GAUSSIAN: {
        "a2c": Preset(GAUSSIAN, "gaussian", _A2C_GAUSSIAN),
        "ppo": Preset(GAUSSIAN, "gaussian", _PPO_GAUSSIAN),
        "trpo": Preset(GAUSSIAN, "gaussian", _PPO_GAUSSIAN | {"decay_steps": 0.0}),
        "v-mpo": Preset(GAUSSIAN, "gaussian", _PPO_GAUSSIAN),
    },
    CLASSIFICATION: {
        "a2c": Preset(CLASSIFICATION, "hl-gauss-centred", _A2C_CLASSIFICATION),
        "ppo": Preset(CLASSIFICATION, "hl-gauss-centred", _PPO_CLASSIFICATION),
    },
    RN_D: {"ppo": Preset(RN_D, "hl-one-hot", _PPO_RN_D)},
    PLAYGROUND: {"ppo": Preset(PLAYGROUND, "gaussian", _PPO_PLAYGROUND)},
    PAPER: {},
}
"""By their names and that of the algorithm. What isn't there has the usual loss and the algorithm's defaults."""

USUAL = {"a2c": CLASSIFICATION, "ppo": GAUSSIAN, "trpo": GAUSSIAN, "v-mpo": GAUSSIAN}
"""The preset of each algorithm where neither a preset nor a loss is named; that of any other is the paper's."""


def present(name: str) -> str:
    """Return the present name of the preset of that name, which may be its former one."""
    return CLASSIFICATION if name == RECOMMENDED else name


def find_preset(name: str | None, loss: Any, algorithm: str) -> Preset:
    """The preset of that name, with the loss if one is named.

    Without a name it is the algorithm's usual one, or the paper's where a loss is named: what was tuned for one loss
    says nothing of another.

    Raises:
        UsageError: there is none of that name, or it is for another loss or algorithm.
    """
    name = present(name or (USUAL.get(algorithm, PAPER) if loss is None else PAPER))
    require_word("preset", name, PRESETS)
    known = PRESETS[name]
    told = f"preset is {name!r}, which is for {' and '.join(known)}, not {algorithm!r}; take one of these algorithms"
    require(not known or algorithm in known, told)
    preset = known.get(algorithm, Preset(name))
    require(
        loss in (None, preset.loss) or not preset.settings,
        f"preset is {name!r}, which was tuned for loss {preset.loss!r}, not {loss!r}; leave one of the two out",
    )
    return preset if loss is None else preset._replace(loss=loss)
