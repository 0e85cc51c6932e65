"""An environment in other units of the action."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import galton
from galton.envs import JaxTask
from galton.envs.find import find
from galton.envs.lqr import LQR
from galton.errors import UsageError


def trained(env, scale, loss, n_eval_episodes=2, **numbers):
    task = find(env, **({} if scale == 1 else {"action_scale": scale}))
    own = {"n_steps": 5, "net_arch": (), "learning_rate": 0.05} if env == "bandit" else {"learning_rate": 1e-3}
    agent = galton.make_agent(loss=loss, n_bins=20, eta=0.75, **own, **numbers)
    return galton.train(task, agent, [3, 4], 400, n_logs=4, n_eval_episodes=n_eval_episodes)


def same(one, other, aside=("sigma",)):
    """Whether all that was learnt and logged is equal to the last bit, but for σ, which is in units of the action."""
    learnt = zip(*(jax.tree.leaves(result.learner) for result in (one, other)), strict=True)
    logged = [[x for name, x in result.log.columns().items() if name not in aside] for result in (one, other)]
    return all(np.array_equal(a, b, equal_nan=True) for a, b in [*learnt, *zip(*logged, strict=True)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env", "loss", "scale"),
    [("bandit", "hl-gauss", 0.125), ("lqr", "hl-one-hot", 0.125), ("Reacher-v5", "hl-gauss-centred", 8.0)],
)
def test_a_softmax_policy_learns_the_same_to_the_bit_at_any_scale_of_the_box(env, loss, scale):
    assert same(trained(env, 1, loss), trained(env, scale, loss))


@pytest.mark.slow
def test_a_gaussian_notices_the_scale():
    assert not same(trained("lqr", 1, "gaussian"), trained("lqr", 8.0, "gaussian"))


@pytest.mark.few
@pytest.mark.parametrize(("env", "n_eval_episodes"), [("bandit", 0), ("bandit", 2), ("lqr", 2), ("Reacher-v5", 2)])
def test_a_gaussian_in_units_of_the_box_learns_the_same_to_the_bit(env, n_eval_episodes):
    small, large = (trained(env, scale, "gaussian", n_eval_episodes, box_units=1.0) for scale in (0.125, 8.0))
    assert same(small, large, aside=("sigma", "entropy", "policy_loss"))  # a density's are in its units


def test_what_is_done_is_the_action_over_the_scale():
    plain, wide = LQR(), find("lqr", action_scale=4.0)
    state, noise, action = jnp.array([0.5, -0.25]), jnp.zeros(2), jnp.array([0.75, -0.5])
    for ours, theirs in zip(wide.step(state, 4 * action, noise), plain.step(state, action, noise), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(wide.actions.high, [4.0, 4.0])
    assert wide.record == plain

    class Spaced(LQR):
        action_space = gymnasium.spaces.Box(-1, 1, (2,))

    found = JaxTask(Spaced(), 4.0).step(state, 4 * action, noise)[0]
    np.testing.assert_array_equal(found, plain.step(state, action, noise)[0])
    task = find("Pendulum-v1", action_scale=2.0)
    assert (task.actions.space.low, task.actions.space.high) == (-4.0, 4.0)
    twins = task.make(1), find("Pendulum-v1").make(1)
    for envs in twins:
        envs.reset(np.array([1], np.uint32))
    mine, theirs = (envs.step(np.array([[x]], np.float32)) for envs, x in zip(twins, (3.0, 1.5), strict=True))
    np.testing.assert_array_equal(mine.reward, theirs.reward)


@pytest.mark.parametrize("env", ["lqr", "Pendulum-v1", "Reacher-v5"])
@pytest.mark.parametrize("scale", [0, -1.0, float("inf"), float("nan"), True, "8", None])
def test_a_scale_that_is_no_positive_number_is_refused(env, scale):
    with pytest.raises(UsageError, match=r"action_scale is .*; it must be a finite number greater than 0"):
        find(env, action_scale=scale)
