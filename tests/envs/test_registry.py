import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from galton import UsageError
from galton.envs import ENVS, Environment, make
from galton.envs.registry import read_constants


@pytest.mark.parametrize("name", ENVS)
def test_records_and_registrations_agree_and_pass_gymnasiums_check_without_a_warning(name):
    record, env = make(name), gymnasium.make(ENVS[name].gymnasium_id)
    assert isinstance(record, Environment)
    assert record.max_episode_steps == env.spec.max_episode_steps
    assert env.observation_space.shape == record.observation_low.shape
    assert env.action_space.shape == record.action_low.shape
    assert make(ENVS[name].gymnasium_id) == record
    check_env(env.unwrapped)  # pytest turns warnings into errors


@pytest.mark.parametrize("name", ENVS)
def test_gymnasium_steps_are_the_records_with_scaled_actions(name):
    constants = {} if name in ("mountain-car", "acrobot") else {"noise_std": 0.0}
    record, env = make(name, **constants), gymnasium.make(ENVS[name].gymnasium_id, **constants).unwrapped
    first, _ = env.reset(seed=5)
    first += 0  # who is given an observation may write to it
    np.testing.assert_allclose(record.observe(env._state), first)
    for action in (np.full(env.action_space.shape, 0.5, np.float32), np.full(env.action_space.shape, 3.0, np.float32)):
        state = env._state
        observed, reward, terminated, truncated, _ = env.step(action)
        scaled = np.clip(action, -1, 1) * record.action_high
        still = jax.tree.map(jnp.zeros_like, record.noise(jax.random.key(0)))
        following, expected, ended = record.step(state, jnp.asarray(scaled), still)
        np.testing.assert_allclose(observed, record.observe(following), rtol=1e-5, atol=1e-6)
        assert not truncated
        assert terminated == bool(ended)
        assert reward == pytest.approx(float(expected), abs=1e-5)


def test_the_time_limit_truncates():
    env = gymnasium.make("galton/LQR-v0")
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(100)]
    assert ends == [(False, False)] * 99 + [(False, True)]


def test_constants_reach_the_record_through_gymnasium_and_an_unknown_environment_is_named():
    assert gymnasium.make("galton/Bandit-v0", d=3, noise_std=0.0).unwrapped.record.d == 3
    with pytest.raises(UsageError, match="bandit has no constant 'foo'"):
        gymnasium.make("galton/Bandit-v0", foo=1)
    with pytest.raises(UsageError, match="environment is 'cartpole'; choose from bandit"):
        make("cartpole")


def test_constants_are_read_from_json_and_what_are_none_is_refused_in_a_line():
    assert read_constants("{}") == {}
    assert read_constants('{"d": 3, "x": [1, [2]]}') == {"d": 3, "x": (1, (2,))}
    no_json = ("", "{'d': 3}", "[" * 100_000, f'{{"d": {"9" * 5000}}}')
    for text, said in (
        *((text, "is not JSON") for text in no_json),
        *((text, "a JSON object") for text in ("[]", "null")),
    ):
        with pytest.raises(UsageError, match=said) as told:
            read_constants(text)
        assert len(str(told.value)) < 500
