import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from galton import Bins, UsageError
from galton.envs import LQR


def simulate(env, controller, n=20_000, seed=0):
    """Returns of n episodes under controller(key, x, t), clipped into the box; and the largest |u| it asked for."""
    keys = jax.random.split(jax.random.key(seed), n)

    def episode(key):
        reset_key, noise_key, control_key = jax.random.split(key, 3)

        def step(x, inputs):
            t, noise_key, control_key = inputs
            u = controller(control_key, x, t)
            x, reward, _ = env.step(x, jnp.clip(u, env.action_low, env.action_high), env.noise(noise_key))
            return x, (reward, jnp.abs(u).max())

        t = env.max_episode_steps
        inputs = (jnp.arange(t), jax.random.split(noise_key, t), jax.random.split(control_key, t))
        _, (rewards, asked) = jax.lax.scan(step, env.reset(reset_key), inputs)
        return rewards.sum(), asked.max()

    returns, asked = jax.jit(jax.vmap(episode))(keys)
    return np.asarray(returns, np.float64), float(asked.max())


def within_three_errors(returns, value):
    return abs(returns.mean() - value) < 3 * returns.std() / len(returns) ** 0.5


def optimal_gains(env):
    """K_t of the optimal controller u_t = −K_t x_t for each step: from the last on, the best against its cost to go."""
    A, B, Q, R = (np.array(matrix) for matrix in (env.A, env.B, env.Q, env.R))
    cost_to_go, gains = np.zeros_like(A), []
    for _ in range(env.max_episode_steps):
        K = np.linalg.inv(R + B.T @ cost_to_go @ B) @ B.T @ cost_to_go @ A
        closed_loop = A - B @ K
        cost_to_go = Q + K.T @ R @ K + closed_loop.T @ cost_to_go @ closed_loop
        gains.append(K)
    return np.array(gains[::-1])


ENV = LQR()
GAINS = jnp.asarray(optimal_gains(ENV), jnp.float32)


def optimal(key, x, t):
    return -GAINS[t] @ x


@functools.cache
def at_best():
    return simulate(ENV, optimal)


@pytest.mark.slow
def test_the_optimal_controller_earns_the_riccati_value_within_the_bounds_and_random_actions_the_closed_form():
    returns, asked = at_best()
    assert within_three_errors(returns, ENV.optimal_return)
    assert asked < 1
    returns, _ = simulate(ENV, lambda key, x, t: jax.random.uniform(key, (2,), minval=-1.0, maxval=1.0))
    assert within_three_errors(returns, ENV.random_return)


TURN = jnp.array([[0.9, -0.4], [0.4, 0.9]])
OTHERS = {
    **{str(factor): lambda key, u, factor=factor: factor * u for factor in (0.0, 0.5, 0.8, 1.25, 2.0)},
    "turned": lambda key, u: TURN @ u,
    "noisy": lambda key, u: u + 0.1 * jax.random.normal(key, (2,)),
    "full": lambda key, u: jnp.sign(u),
}


@pytest.mark.slow
@pytest.mark.parametrize("other", OTHERS)
def test_no_other_controller_beats_the_optimum(other):
    best, _ = at_best()
    gap = best - simulate(ENV, lambda key, x, t: OTHERS[other](key, optimal(key, x, t)))[0]
    assert gap.mean() > 3 * gap.std() / len(gap) ** 0.5


@pytest.mark.slow
@pytest.mark.parametrize("n_bins", [50, 100, 200])
def test_bins_of_the_grid_cost_the_optimal_controller_next_to_nothing(n_bins):
    """Less than a hundredth of what lies between rest and the optimum: bins do not keep softmax policies behind."""
    best, _ = at_best()
    bins = Bins(ENV.action_low, ENV.action_high, n_bins)
    rounded, _ = simulate(ENV, lambda key, x, t: bins.decode(bins.encode(optimal(key, x, t))))
    gap = best - rounded
    assert gap.mean() + 3 * gap.std() / len(gap) ** 0.5 < 0.01 * 16.26
    assert np.any(gap != 0)


def test_early_gains_are_those_of_the_infinite_horizon():
    A, B, Q, R = (np.array(m) for m in (ENV.A, ENV.B, ENV.Q, ENV.R))
    P = solve_discrete_are(A, B, Q, R)
    np.testing.assert_allclose(optimal_gains(ENV)[0], np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A), atol=1e-6)


def test_other_sizes_noise_and_horizons():
    env = LQR(
        A=((0.9, 0.1, 0.0), (0.0, 0.8, 0.1), (0.0, 0.0, 0.7)),
        B=((0.0,), (0.1,), (0.2,)),
        Q=((1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 0.5)),
        R=((3.0,),),
        noise_std=0.02,
        max_episode_steps=30,
    )
    gains = jnp.asarray(optimal_gains(env), jnp.float32)
    returns, asked = simulate(env, lambda key, x, t: -gains[t] @ x)
    assert asked < 1
    assert within_three_errors(returns, env.optimal_return)


def test_matrices_may_be_arrays_records_are_hashable_and_bad_constants_are_refused_by_name():
    assert LQR(A=np.array(ENV.A), B=np.array(ENV.B)) == ENV
    assert hash(LQR(A=np.array(ENV.A))) == hash(ENV)
    for constants, message in (
        ({"A": ((1.0,),)}, "A has shape"),
        ({"R": ((0.0, 0.0), (0.0, 1.0))}, "R is .* positive definite"),
        ({"Q": ((-1.0, 0.0), (0.0, 1.0))}, "Q is .* semidefinite"),
        ({"Q": ((1.0, 1.0), (0.0, 1.0))}, "Q is .* symmetric"),
        ({"noise_std": -1.0}, "noise_std is -1"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
        ({"B": np.ones(3)}, "B has shape"),
    ):
        with pytest.raises(UsageError, match=message):
            dataclasses.replace(ENV, **constants)


def test_with_coupled_actions_the_optimum_is_that_of_all_steps_at_once():
    """Without noise the whole plan is one least-squares problem: min (Ψx + ΘU)ᵀ Q (Ψx + ΘU) + Uᵀ R U."""
    T, R = 12, np.array([[1.0, 0.9], [0.9, 1.0]])
    env = LQR(R=R, noise_std=0.0, max_episode_steps=T)
    A, B, Q = (np.array(matrix) for matrix in (env.A, env.B, env.Q))
    powers = [np.linalg.matrix_power(A, i) for i in range(T)]
    states = np.concatenate(powers)
    moved = np.block([[powers[t - s - 1] @ B if s < t else np.zeros((2, 2)) for s in range(T)] for t in range(T)])
    Q, R = np.kron(np.eye(T), Q), np.kron(np.eye(T), R)
    pull = moved.T @ Q @ states
    cost = states.T @ Q @ states - pull.T @ np.linalg.solve(moved.T @ Q @ moved + R, pull)
    assert env.optimal_return == pytest.approx(-np.trace(cost) / 3, rel=1e-10)
    assert env.optimal_return != pytest.approx(LQR(noise_std=0.0, max_episode_steps=T).optimal_return, rel=1e-3)
