"""What a run becomes does not depend on where its environments live.

The two engines draw a run's noise from the same key in different ways, so the device's loop is given the host's noise
here, rollout by rollout; that a population on the device is that loop with noise of its own is a test by itself.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import make_agent
from galton.envs.jax_task import JaxTask
from galton.parts import Box
from galton.training.on_device import DevicePopulation, begin_on_device, iteration
from galton.training.population import populate
from galton.training.rollout import draw_noise
from galton.training.run import read_log, rollout_key

from .slide import HIGH, LOW, Slide, slide

pytestmark = pytest.mark.slow
SEEDS, UPDATES = (3, 4), 5
CLOSE = {"rtol": 1e-4, "atol": 1e-5}
"""Roundings of the environment's float32, and what Adam makes of them in a few updates."""
NORMALIZE = {"normalize_observation": True, "normalize_reward": True}
CASES = [
    ("a2c", "gaussian", NORMALIZE),
    ("a2c", "hl-gauss", {}),
    ("ppo", "gaussian", {}),
    ("ppo", "hl-gauss-centred", NORMALIZE),
    ("a2c", "gaussian", NORMALIZE | {"normalize_window": 12}),
    ("a2c", "gaussian", {"noise_correlation": 0.8}),
    ("ppo", "hl-gauss", {"noise_correlation": 0.8}),
]


def agent_of(algorithm, loss, more):
    """Two copies, eight steps a rollout; episodes end by the edge and by the limit in every few of them."""
    own = {"n_epochs": 3, "batch_size": 4} if algorithm == "ppo" else {}
    static = {"n_bins": 9, "n_steps": 8, "n_envs": 2, "net_arch": (8,)}
    numbers = {"gamma": 0.9, "gae_lambda": 0.8, "ent_coef": 0.01, "eta": 0.6}
    return make_agent(algorithm=algorithm, loss=loss, **own, **static, **numbers, **more)


def each(agent):
    """The agent of as many runs as there are seeds."""
    return jax.tree.map(lambda number: np.full(len(SEEDS), number, np.float32), agent)


def by_hand(agent, seed, draw):
    """The state after each update of one run on the device, with its rollout; noise as `draw` has it."""
    begin, step = PROGRAMS
    agent = jax.tree.map(jnp.float32, agent)
    state = begin(agent, jnp.uint32(seed))
    for _ in range(UPDATES):
        state, batch = step(agent, state, draw(agent, state.run))
        yield state, batch


PROGRAMS = [jax.jit(functools.partial(f, JaxTask(Slide()))) for f in (begin_on_device, iteration)]


def of_the_device(agent, run):
    return draw_noise(rollout_key(agent, run), JaxTask(Slide()), agent)


def of_the_host(agent, run):
    """Noise for actions straight from the rollout's key; the environment has none."""
    shape = (agent.rollout.n_steps, agent.rollout.n_envs)
    return of_the_device(agent, run)._replace(action=agent.policy.noise(rollout_key(agent, run), shape))


def check_close(ours, theirs):
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for (path, a), b in zip(jax.tree_util.tree_leaves_with_path(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(a, b, **CLOSE, err_msg=jax.tree_util.keystr(path))


@pytest.mark.parametrize(("algorithm", "loss", "more"), CASES)
def test_the_same_dynamics_on_the_host_give_the_same_rollouts_updates_and_logs(algorithm, loss, more):
    agent = agent_of(algorithm, loss, more)
    population = populate(slide, each(agent), SEEDS, jax.devices()[:1])
    (group,) = population._groups
    agent = agent.on(Box.of(LOW, HIGH))
    runs = [by_hand(agent, seed, of_the_host) for seed in SEEDS]
    ends = np.zeros(2)
    for _ in range(UPDATES):
        population.advance(1)
        for i, run in enumerate(runs):
            state, batch = next(run)
            check_close(jax.tree.map(lambda x, i=i: x[i], group._batch), batch)
            check_close(jax.tree.map(lambda x, i=i: x[i], population.learner), state.run.learner)
            ends += [batch.terminated.sum(), batch.truncated.sum()]
    assert (ends > 0).all()
    assert population.step == UPDATES * 16
    log = population.log()
    _, expected = read_log(agent, state.run, batch)
    check_close(jax.tree.map(lambda x: x[-1], log), expected)
    population.close()


@pytest.mark.parametrize(("algorithm", "loss", "more"), [*CASES[1:3], CASES[-1]])
def test_a_population_on_the_device_is_one_iteration_after_the_other(algorithm, loss, more):
    agent = agent_of(algorithm, loss, more)
    population = populate(Slide(), each(agent), SEEDS)
    assert isinstance(population, DevicePopulation)
    population.advance(UPDATES)
    for i, seed in enumerate(SEEDS):
        *_, (state, batch) = by_hand(agent.on(Box.of(LOW, HIGH)), seed, of_the_device)
        check_close(jax.tree.map(lambda x, i=i: x[i], population.learner), state.run.learner)
        check_close(jax.tree.map(lambda x, i=i: np.asarray(x)[i], population._batch), batch)


def test_both_engines_evaluate_the_same_policy_alike():
    agent = agent_of("a2c", "hl-gauss", NORMALIZE)
    device, host = (populate(env, each(agent), SEEDS) for env in (Slide(), slide))
    check_close(device.learner, host.learner)
    np.testing.assert_allclose(device.evaluate(2), host.evaluate(2), rtol=1e-5)
    host.close()
