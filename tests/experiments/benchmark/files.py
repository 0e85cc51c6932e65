"""A benchmark's file that is small, and what changes it."""

import copy
import tomllib

from galton_experiments.benchmark.reading import of_record

TEXT = """
seed = 3
baseline = "gaussian"

[budget]
settings = 3
seeds = 2
fresh_seeds = 3
steps = 100
logs = 2
eval_episodes = 1

[fixed]
n_steps = 5
net_arch = []

[prior]
learning_rate = { log-uniform = [0.01, 1] }
gamma = { log-uniform-below-1 = [0.9, 0.999] }
clip_range = { uniform = [0.1, 0.3] }
decay_steps = { choice = [0, 0.5], times = "steps" }

[methods.gaussian]
label = "Gaussian"
fixed = { loss = "gaussian" }

[methods.bins]
fixed = { loss = "hl-gauss-centred", n_bins = 5 }
search = { eta = { log-uniform = [0.25, 4] } }

[methods.ppo]
fixed = { loss = "hl-gauss-centred", algorithm = "ppo", n_bins = 5, n_epochs = 2, batch_size = 10, gamma = 0.5 }
search = { eta = { uniform = [1, 2] }, log_std_init = { uniform = [-1, 0] } }

[tasks.bandit]

[tasks.noisy]
env = "bandit"
env_kwargs = { noise_std = 5.0 }
steps = 200
fresh_steps = 300
fixed = { n_envs = 2 }

[tasks.four]
env = "bandit"
env_kwargs = { d = 4 }
held_out = true
"""
RECORD = tomllib.loads(TEXT)


def changed(**places):
    """The record with other values at dotted places, whose dots are written __; None takes one away."""
    record = copy.deepcopy(RECORD)
    for place, value in places.items():
        *outer, last = place.split("__")
        table = record
        for name in outer:
            table = table.setdefault(name, {})
        if value is None:
            del table[last]
        else:
            table[last] = value
    return record


def protocol(**places):
    return of_record(changed(**places))


FACTORIAL = {
    "design": "factorial",
    "budget__fresh_seeds": None,
    "tasks__noisy__fresh_steps": None,
    "tasks__four__held_out": None,
}
"""What makes it a factorial benchmark."""
