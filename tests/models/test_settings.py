import inspect

import pytest
from stable_baselines3.common.vec_env import DummyVecEnv

from galton import A2C, ALGORITHMS, PPO, TRPO, VMPO, Model, UsageError, algorithms, make_agent, schedules
from galton.envs import LQR
from galton.parts import settings
from galton.words import usual_of, vocabulary

from ..envs.host.walks import Tall

SMALL = {"preset": "paper", "n_bins": 10, "net_arch": (8,)}


BAD = [
    ({"loss": "mse"}, "loss is 'mse'"),
    ({"learning_rate": -1.0}, "learning_rate is -1.0"),
    ({"seed": -1}, "seed is -1"),
    ({"seed": 2**32}, "seed is 4294967296"),
    ({"n_bins": 1}, "n_bins is 1"),
    ({"net_arch": (8, 0)}, "an entry of net_arch is 0"),
    ({"env": "NoSuch-v0"}, "NoSuch-v0"),
    ({"env": LQR(), "env_kwargs": {"noise_std": 1.0}}, "env_kwargs"),
    ({"env_kwargs": {"mass": 1.0}}, "no constant 'mass'"),
    ({"env": DummyVecEnv([Tall] * 2), "n_envs": 3}, "n_envs is 3, but 2 were given"),
    ({"env": Tall(), "n_envs": 3}, "n_envs is 3, but one environment was given"),
]


def test_bad_arguments_of_the_constructor_are_named():
    for given, message in BAD:
        with pytest.raises(UsageError, match=message):
            A2C(**{"env": "lqr"} | SMALL | given)


@pytest.mark.parametrize(("model", "algorithm"), [(A2C, "a2c"), (PPO, "ppo"), (TRPO, "trpo"), (VMPO, "v-mpo")])
def test_what_editors_show_is_what_a_model_takes_with_the_defaults_that_it_has(monkeypatch, model, algorithm):
    monkeypatch.setattr("galton.models.model.Run", lambda *settings: None)
    told = {name for model in (A2C, PPO, TRPO, VMPO) for name in inspect.signature(model).parameters}
    assert vocabulary().usual.keys() - told == {"algorithm"}
    shown = {name: parameter.default for name, parameter in inspect.signature(model).parameters.items()}
    values = vocabulary().usual | usual_of(algorithm) | model("lqr", preset="paper").settings
    for name in shown.keys() & values.keys() - {"loss", "n_envs"}:
        assert shown[name] == values[name], name
    own = {name: settings(kind).keys() for name, kind in ALGORITHMS.items()}
    others = {field for name, fields in own.items() if name != algorithm for field in fields}
    assert vocabulary().usual.keys() - shown.keys() - {"algorithm"} == others - own[algorithm]


def test_a_setting_of_another_algorithm_is_refused_with_those_that_there_are():
    with pytest.raises(TypeError, match=r"A2C\(\) got an unexpected keyword argument 'clip_range'; it takes .*eta"):
        A2C("lqr", clip_range=0.1)
    with pytest.raises(TypeError, match=r"argument 'learning_rat'; did you mean learning_rate\?$"):
        A2C("lqr", learning_rat=0.1)


def test_a_setting_that_no_part_uses_is_refused_where_nobody_named_the_loss():
    """Whoever names it may have settings for several losses, as files and grids do."""
    with pytest.raises(UsageError, match=r"^n_bins is 5; it goes with policy 'histogram'.*, not 'gaussian'"):
        PPO("lqr", n_bins=5)
    assert PPO("lqr", "gaussian", n_bins=5).settings["loss"] == "gaussian"


def test_an_algorithm_itself_is_taken_with_its_numbers(monkeypatch):
    monkeypatch.setattr("galton.models.model.Run", lambda *settings: None)
    own = algorithms.PPO(clip_range=0.1, batch_size=16, gae_lambda=0.95)
    model = Model("lqr", "hl-gauss", algorithm=own, n_steps=16)
    assert model.settings == PPO("lqr", "hl-gauss", clip_range=0.1, batch_size=16, n_steps=16).settings
    with pytest.raises(UsageError, match=r"clip_range is 0\.3 beside PPO\(.*; give it to the part"):
        Model("lqr", "hl-gauss", algorithm=own, clip_range=0.3)


def test_an_agent_of_words_is_told_as_sb3_tells_it():
    theirs = {"net_arch": {"pi": [4], "vf": [8]}, "target_kl": None, "learning_rate": lambda left: 3e-4 * left}
    theirs |= {"clip_range_vf": None}
    ours = {"net_arch": (4,), "critic_arch": (8,), "learning_rate": schedules.Linear(3e-4, 0.0)}
    assert make_agent(algorithm="ppo", **theirs) == make_agent(algorithm="ppo", **ours)
    with pytest.raises(UsageError, match=r"clip_range is .*; it must be a number or a schedule"):
        make_agent(algorithm="ppo", clip_range=lambda left: left**2)
