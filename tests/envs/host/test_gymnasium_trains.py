"""Gymnasium's own tasks train as they come, under both algorithms."""

import jax
import numpy as np
import pytest

import galton
from galton.envs import find
from galton.envs.host.gymnasium import GymnasiumTask

ALGORITHMS = {"a2c": (galton.A2C, {}), "ppo": (galton.PPO, {"batch_size": 4, "n_epochs": 2})}
TASKS = {"Pendulum-v1": ({}, "gymnasium", 3), "LunarLander-v3": ({"continuous": True}, "Box2D", 8)}
"""Keyword arguments, the package without which there is no such task, and the size of an observation."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:builtin type:DeprecationWarning")  # Box2D's, when it is imported
@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_few_updates_change_all_that_is_learnt(name, algorithm):
    kwargs, package, size = TASKS[name]
    pytest.importorskip(package)
    make, own = ALGORITHMS[algorithm]
    model = make(name, env_kwargs=kwargs, n_bins=7, net_arch=(6,), n_steps=8, n_envs=2, learning_rate=1e-2, **own)
    assert isinstance(find(name, **kwargs), GymnasiumTask)
    assert model.observation_space.shape == (size,)
    before, logs = jax.device_get(model.learner.params), []
    model.learn(64, lambda _, log: logs.append(log), progress_bar=False, log_interval=1)
    after = jax.device_get(model.learner.params)
    action, _ = model.predict(np.zeros(size, np.float32))
    model.close()
    for old, new in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        assert np.isfinite(new).all()
        assert (old != new).any()
    assert (model.num_timesteps, len(logs)) == (64, 4)
    assert all(np.isfinite(log["train/grad_norm"]) for log in logs)
    assert model.action_space.contains(action)
