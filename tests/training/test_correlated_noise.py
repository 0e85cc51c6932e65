"""Correlated noise in training: over rollouts, through the ends of episodes, and on from a file."""

import jax
import numpy as np
import pytest

import galton
from galton import A2C, make_agent
from galton.algorithms import actor_critic
from galton.envs import LQR
from galton.envs.jax_task import JaxTask
from galton.saving import checkpoint
from galton.training.on_device import DevicePopulation
from galton.training.population import populate
from galton.training.rollout import draw_noise
from galton.training.run import rollout_key

RHO, LENGTH, T, N = 0.75, 5, 3, 2
SETTINGS = {"preset": "paper", "n_bins": 9, "net_arch": (8,), "n_steps": 4, "n_envs": 2, "learning_rate": 1e-2}


def noise_of(agent, learner, batch):
    """The normal numbers of a Gaussian's actions in a rollout."""
    distribution = actor_critic.distribution(agent, learner.params, batch.observation)
    return np.asarray((batch.action - distribution.mean) / distribution.std(), np.float64)


@pytest.mark.slow
def test_noise_goes_on_over_rollouts_and_begins_anew_with_an_episode():
    env, static = LQR(max_episode_steps=LENGTH), {"loss": "gaussian", "n_steps": T, "n_envs": N, "net_arch": (4,)}
    agent = make_agent(**static, learning_rate=1e-2, noise_correlation=RHO)
    population = populate(env, jax.tree.map(lambda number: np.float32([number]), agent), [7])
    assert isinstance(population, DevicePopulation)
    z, steps = np.zeros((N, 2)), 0
    for _ in range(4):
        run, agent = jax.tree.map(lambda x: x[0], (population._state.run, population._agent))
        drawn = np.asarray(draw_noise(rollout_key(agent, run), JaxTask(env), agent).action, np.float64)
        population.advance(1)
        batch = jax.tree.map(lambda x: x[0], population._batch)
        found = noise_of(agent, run.learner, batch)
        for t in range(T):
            z = drawn[t] if steps % LENGTH == 0 else RHO * z + np.sqrt(1 - RHO**2) * drawn[t]
            steps += 1
            np.testing.assert_allclose(found[t], z, rtol=1e-4, atol=1e-5)
    assert steps > 2 * LENGTH
    np.testing.assert_allclose(population.snapshot()["environments"].noise[0], z, rtol=1e-4, atol=1e-5)


def learned(model):
    return [leaf.tobytes() for leaf in jax.tree.leaves(jax.device_get(model.learner))]


@pytest.mark.slow
@pytest.mark.parametrize(("env", "loss"), [("lqr", "hl-gauss"), ("Reacher-v5", "gaussian")])
def test_a_loaded_run_goes_on_to_the_same_bits(env, loss, tmp_path):
    if env.endswith("-v5"):
        pytest.importorskip("mujoco")
    model = A2C(env, loss, noise_correlation=0.9, **SETTINGS)
    path = model.learn(7 * 8, progress_bar=False).save(tmp_path / "cut")
    settings, arrays = checkpoint.read(path)
    assert settings["hypers"]["noise_correlation"] == pytest.approx(0.9)
    assert arrays["environments/noise"].shape == (1, 2, 2)
    plain, names = checkpoint.read(A2C(env, loss, **SETTINGS).save(tmp_path / "plain"))
    assert "noise_correlation" not in plain["hypers"]
    assert not [name for name in names if "noise" in name]
    loaded = A2C.load(path, env)
    for each in (model, loaded):
        each.learn(8 * 8, progress_bar=False)
        each.close()
    assert learned(loaded) == learned(model)


def test_a_correlation_out_of_range_is_refused():
    for wrong in (-0.1, 1.0, float("nan")):
        with pytest.raises(galton.UsageError, match=r"noise_correlation is .*; it must be 0 or more, and less than 1"):
            A2C("bandit", noise_correlation=wrong)
