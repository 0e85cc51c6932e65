"""What a model begins with where no loss is named, and how the paper's settings are had back."""

import itertools
import json
import math
import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from stable_baselines3.common.vec_env import DummyVecEnv

from galton import A2C, ALGORITHMS, PPO, UsageError
from galton.agents import read, words_of
from galton.cli._options import Training
from galton.models import Model
from galton.optimizers import Adam
from galton.presets import CLASSIFICATION, GAUSSIAN, PAPER, PRESETS, RECOMMENDED, Preset, find_preset
from galton.words import vocabulary

from ..envs.host.walks import Tall

ROOT = Path(__file__).parents[2]
EIGHT = {"n_envs": 8, "n_steps": 20, "normalize_reward": True, "learning_rate": 0.002, "gamma": 0.95}
MADE_UP = {
    GAUSSIAN: {"ppo": Preset(GAUSSIAN, "gaussian", EIGHT | {"n_steps": 256})},
    CLASSIFICATION: {"a2c": Preset(CLASSIFICATION, "hl-one-hot", EIGHT)},
    PAPER: {},
}


@pytest.fixture
def made_up(monkeypatch):
    monkeypatch.setattr("galton.presets.PRESETS", MADE_UP)
    monkeypatch.setattr("galton.models.model.Run", lambda *settings: None)


def test_where_no_loss_is_named_it_is_the_usual_preset_whole(made_up):
    whole = words_of(read(EIGHT | {"loss": "hl-one-hot"}))
    assert A2C("lqr").settings == A2C("lqr", preset="classification").settings == whole
    ppo = PPO("lqr").settings
    assert ppo == PPO("lqr", preset="gaussian").settings
    assert (ppo["loss"], ppo["gamma"]) == ("gaussian", 0.95)


def test_presets_have_an_earlier_name_too_and_an_algorithm_of_ones_own_the_usual_settings():
    for algorithm, preset in PRESETS[CLASSIFICATION].items():
        assert find_preset(RECOMMENDED, None, algorithm) == preset
    assert find_preset(None, None, "reinforce") == Preset(PAPER, "hl-gauss", {})
    with pytest.raises(UsageError, match="preset is 'best'; choose from gaussian, classification, rn-d, playground"):
        A2C("lqr", preset="best")


def test_where_a_loss_is_named_it_is_the_papers_settings_and_what_is_named_goes_before_the_preset(made_up):
    for loss in ("gaussian", "hl-gauss"):
        papers = words_of(read({"loss": loss}))
        assert A2C("lqr", loss).settings == A2C("lqr", loss, preset="paper").settings == papers
    assert A2C("lqr", preset="paper").settings == words_of(read({}))
    assert PPO("lqr", preset="paper").settings == PPO("lqr", "hl-gauss").settings
    assert A2C("lqr", "hl-one-hot", preset="classification").settings == A2C("lqr").settings
    with pytest.raises(UsageError, match="preset is 'classification', which was tuned for loss 'hl-one-hot', not 'ga"):
        A2C("lqr", "gaussian", preset="classification")
    named = {"n_envs": 2, "gamma": 0.5, "normalize_reward": False, "n_steps": 20}
    found = A2C("lqr", **named).settings
    assert {name: found[name] for name in named} == named
    assert found["learning_rate"] == 0.002


def test_a_task_of_the_paper_keeps_what_is_its_own_and_its_whole_rollout(made_up):
    found, ppo = A2C("bandit").settings, PPO("bandit").settings
    assert [found[name] for name in ("n_envs", "n_steps", "net_arch", "learning_rate")] == [1, 5, (), 0.05]
    assert (found["loss"], found["gamma"]) == ("hl-one-hot", 0.95)
    assert (ppo["n_envs"], ppo["n_steps"]) == (8, 256)


FEWER = [(A2C, 1, 160), (A2C, 3, 54), (PPO, 1, 2048), (PPO, 2, 1024), (PPO, 3, 704)]


def test_with_fewer_environments_a_rollout_is_as_long_in_whole_minibatches(made_up):
    for (model, copies, n_steps), ready_made in itertools.product(FEWER, (True, False)):
        env = (Tall() if copies == 1 else DummyVecEnv([Tall] * copies)) if ready_made else Tall
        n_envs = None if ready_made else copies
        rollout = model(env, n_envs=n_envs).agent.rollout
        assert (rollout.n_envs, rollout.n_steps) == (copies, n_steps)
        assert model(env, n_steps=64, n_envs=n_envs).agent.rollout.n_steps == 64
        papers = model(env, n_envs=n_envs, preset="paper"), model("lqr", preset="paper")
        assert papers[0].agent.rollout.n_steps == papers[1].agent.rollout.n_steps
    assert PPO(DummyVecEnv([Tall] * 3), batch_size=256).agent.rollout.n_steps == 768
    for name in ("n_envs", "batch_size"):
        with pytest.raises(UsageError, match=f"{name} is 0; it must be an integer of at least 1"):
            PPO("lqr", **{"n_envs": 3} | {name: 0})


def test_so_many_environments_that_a_rollout_has_hardly_a_step_are_told():
    with pytest.warns(UserWarning, match=r"n_envs is 1,024, and a rollout .*, so n_steps is 2;") as told:
        assert PPO("lqr", n_envs=1024).agent.rollout.size == 2048
    assert told[0].filename == __file__
    assert PPO("lqr", n_envs=1024, n_steps=2, batch_size=64).agent.rollout.size == 2048


def test_models_and_commands_have_the_same_presets(monkeypatch):
    monkeypatch.setattr("galton.models.model.Run", lambda *settings: None)
    numbers = ((None, None), (3, None), (10, 80))
    every = itertools.product(PRESETS, ALGORITHMS, ("bandit", "acrobot", "Pendulum-v1"), numbers)
    for name, algorithm, env, (n_envs, batch_size) in every:
        if PRESETS[name] and algorithm not in PRESETS[name]:
            with pytest.raises(UsageError, match=f"preset is '{name}', which is for .*, not '{algorithm}'"):
                find_preset(name, None, algorithm)
            continue
        training = Training.of_task(env, algorithm, find_preset(name, None, algorithm), n_envs, batch_size)
        own = {} if batch_size is None or algorithm == "a2c" else {"batch_size": batch_size}
        model = Model(env, preset=name, algorithm=algorithm, n_envs=n_envs, **own)
        assert words_of(read(training.words)) == model.settings


@pytest.mark.parametrize(
    ("name", "algorithm", "benchmark", "method"),
    [
        (CLASSIFICATION, "a2c", "winner-a2c", "width-edges"),
        (CLASSIFICATION, "ppo", "winner-mujoco", "edges"),
        (GAUSSIAN, "a2c", "winner-a2c", "gaussian"),
    ],
)
def test_a_preset_is_what_a_benchmark_selected(name, algorithm, benchmark, method):
    """To three digits; a benchmark's decay of 1 is over all that is trained, and A2C's classification has none."""
    report = json.loads((ROOT / "results" / benchmark / "report.json").read_text())
    drawn = report["draws"][method][report["selected"]["shared"][method]]
    selected = report["file"]["fixed"] | report["file"]["methods"][method]["fixed"] | drawn
    preset = PRESETS[name][algorithm]
    found = {**preset.settings, "loss": preset.loss, "algorithm": algorithm}
    assert found.get("decay_steps") == (None if (name, algorithm) == (CLASSIFICATION, "a2c") else math.inf)
    if name == GAUSSIAN:
        del selected["deterministic_action"]  # which it has no use for
    assert rounded(found | {"decay_steps": 1}) == rounded(selected)


@pytest.mark.parametrize(
    ("algorithm", "benchmark", "method"),
    [("a2c", "a2c-one-setting", "recommended"), ("ppo", "ppo-parts-mujoco", "all-but-decay")],
)
def test_what_a_page_calls_the_default_is_the_preset_but_for_the_decay(algorithm, benchmark, method):
    file = tomllib.loads((ROOT / "benchmarks" / f"{benchmark}.toml").read_text())
    (rate,) = file["prior"]["learning_rate"]["choice"]
    trained = file["fixed"] | file["methods"][method].get("fixed", {}) | {"learning_rate": rate}
    preset = PRESETS[CLASSIFICATION][algorithm]
    usual = {"net_arch": [*vocabulary().usual["net_arch"]], "decay_steps": 0}
    expected = {**preset.settings, "loss": preset.loss, "algorithm": algorithm}
    expected.pop("decay_steps", None)
    assert trained == expected | {name: value for name, value in usual.items() if name in trained}


def rounded(settings):
    return {name: value if isinstance(value, str | bool) else f"{value:.3g}" for name, value in settings.items()}


def test_rn_d_is_its_authors_settings_and_their_actor_and_critic():
    model = PPO("lqr", preset="rn-d", n_envs=2)
    theirs = {"n_epochs": 10, "batch_size": 16 * 1024 // 64, "learning_rate": 3e-4, "decay_steps": math.inf}
    theirs |= {"gamma": 0.99, "gae_lambda": 0.95, "clip_range": 0.2, "clip_range_vf": 0.2, "max_grad_norm": 0.5}
    theirs |= {"vf_coef": 0.5 * 0.5, "ent_coef": 0.0, "normalize_advantage": True, "normalize_reward": True}
    theirs |= {"normalize_observation": True, "loss": "hl-one-hot", "n_steps": 8 * 1024}
    assert {name: model.settings[name] for name in theirs} == theirs
    embedding, *blocks, norm, last = model.get_parameters()["actor"]
    width, bins = 256, model.agent.policy.bins
    assert [block["up"]["kernel"].shape for block in blocks] == 2 * [(width, 4 * width)]
    assert [layer["kernel"].shape for layer in (embedding, last)] == [(2, width), (width, 2 * 41)]
    assert norm["scale"].shape == (width,)
    np.testing.assert_allclose(last["kernel"].T @ last["kernel"], 1e-4 * np.eye(82), atol=1e-9)
    np.testing.assert_allclose(bins.centers, np.linspace(*bins.centers[:, [0, -1]].T, 41, axis=1), rtol=1e-5)
    np.testing.assert_array_equal(bins.centers[:, [0, -1]].T, model.agent.box[:2])
    critic = [layer["kernel"].shape for layer in model.get_parameters()["critic"]]
    assert critic == [(2, 64), (64, 64), (64, 1)]
    with pytest.raises(UsageError, match="preset is 'rn-d', which is for ppo, not 'a2c'; take one"):
        A2C("lqr", preset="rn-d")


def test_a_decay_over_all_that_is_trained_reaches_0_after_the_last_update():
    """SB3's linear schedule, but that the rate of an update is that of its first step: a single update learns."""
    for decay_steps, expected in ((jnp.inf, [0.3, 0.2, 0.1]), (80, [0.075, 0, 0])):
        adam = Adam(learning_rate=0.3, decay_steps=decay_steps).falling(begin=40, end=100, rollout=20)
        at = [adam.learning_rate * adam.remaining(jnp.float32(step)) for step in (60, 80, 100)]
        np.testing.assert_allclose(at, expected, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("env", ["lqr", Tall])
def test_a_run_that_is_cut_decays_as_one_that_is_not(env):
    settings = {"loss": "gaussian", "n_steps": 32, "n_envs": 2, "net_arch": (4,), "decay_steps": math.inf}
    whole, cut, each = (A2C(env, **settings) for _ in range(3))
    whole.learn(256, progress_bar=False)
    cut.population.decay_over(0, 256)
    cut.advance(2)
    cut.learn(128, progress_bar=False, decay_from=0)
    for _ in range(4):
        each.learn(64, progress_bar=False)  # at the full rate each time
    spread = [jax.tree.leaves(model.learner.params) for model in (whole, cut, each)]
    for mine, theirs, other in zip(*spread, strict=True):
        np.testing.assert_array_equal(mine, theirs)
        assert (mine != other).any()
    assert whole.settings["decay_steps"] == math.inf
    whole.advance(1)  # which has no end
    assert (jax.tree.leaves(whole.learner.params)[0] != spread[0][0]).any()
