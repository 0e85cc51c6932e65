"""What is compiled and what is said when a model learns."""

import contextlib
import warnings

import jax
import pytest

from galton import A2C, PPO, WideGaussian
from galton.envs import Bandit

TRAINING = {"bandit": {"jit(iterate)", "jit(read_log)"}, "Pendulum-v1": {"jit(_prepare)", "jit(_act)", "jit(read_log)"}}
"""The names of the programs that train on the device, and of those outside JAX."""


@contextlib.contextmanager
def compiled():
    """The names of the programs that are compiled inside, or found among those that were kept on disk."""
    names, inside = set(), True

    def note(event, _, fun_name="", **__):
        if inside and "backend_compile" in event:
            names.add(fun_name)

    jax.monitoring.register_event_duration_secs_listener(note)
    yield names
    inside = False


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::galton.models.file.InexactResume")
@pytest.mark.parametrize(("model_of", "env"), [(A2C, "bandit"), (PPO, "Pendulum-v1")])
def test_nothing_that_trains_is_compiled_until_a_model_learns(model_of, env, tmp_path):
    size = {"n_steps": 4, "batch_size": 4} if model_of is PPO else {"n_steps": 4}
    with compiled() as before:
        model = model_of(env, "hl-gauss", net_arch=(3,), n_bins=6, **size)  # no other test has these sizes
        path = model.save(tmp_path / "model")
        loaded = model_of.load(path)
        for one in (model, loaded, model_of.load(path, env)):
            one.predict(one.observation_space.sample())
        loaded.set_env(env)
        model.evaluate(1)
        model.set_random_seed(1)
    with compiled() as then:
        model.learn(4, progress_bar=False)
    told = then & TRAINING[env]
    assert len(told) >= 2, then
    assert not before & TRAINING[env]


SMALL = {"n_steps": 16, "batch_size": 8, "net_arch": (), "box_units": 1.0}
TOLD = r"^at step [\d,]+ the Gaussian's σ has grown to .* lower ent_coef, which is 1,"


@pytest.mark.slow
def test_a_sigma_that_outgrows_the_box_is_said_once_and_a_policy_that_stays_in_it_is_not_warned_of():
    with pytest.warns(WideGaussian, match=TOLD) as told:
        PPO(Bandit(), "gaussian", **SMALL, learning_rate=0.1, ent_coef=1.0).learn(16 * 8)
    assert len(told) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error", WideGaussian)
        for loss in ("gaussian", "hl-gauss"):
            PPO(Bandit(), loss, **SMALL, learning_rate=1e-3).learn(16 * 8)
