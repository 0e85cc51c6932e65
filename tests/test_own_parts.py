"""A part of one's own, with settings, is one file and a line: it is usable wherever the parts of Galton's are."""

import importlib
import json
import os
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import galton
from galton import Model, UsageError
from galton.callbacks import Checkpoint, Evaluate
from galton.cli._words import run_command
from galton.deploy import export
from galton.types import Count
from galton.words import CHOICES, vocabulary
from galton_experiments.benchmark import draws, reading
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import work
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study

FOLDERS = Path(__file__).parents[1] / "examples", Path(__file__).parent
SMALL = {"n_steps": 10, "learning_rate": 0.01}
OWN = {
    "loss": ("new_loss", {"loss": "smoothed", "smoothing": 0.3, "n_bins": 9}),
    "policy": ("new_policy", {"loss": "gaussian", "policy": "laplace", "log_b_init": 0.5}),
    "critic": ("own_parts", {"critic": "huber", "huber_delta": 0.5, "n_bins": 9}),
    "network": ("new_network", {"network": "fourier", "n_waves": 4, "frequency": 2.0, "n_bins": 9}),
    "optimizer": ("own_parts", {"optimizer": "lion", "lion_memory": 0.9, "n_bins": 9}),
    "algorithm": ("new_algorithm", {"algorithm": "awr", "awr_beta": 0.5, "n_repeats": 2, "n_bins": 9}),
}
"""The module that registers each, and the words that choose it and set what is its own."""
NOT_EXPORTED = {"policy": "^policy is 'laplace', of which", "network": "^network is a Fourier, of which"}


@pytest.fixture
def registered(request, monkeypatch):
    """The words of one of OWN, whose module is registered for this test alone."""
    name, words = OWN[request.param]
    before = [(choice.registry, dict(choice.registry)) for choice in CHOICES.values()]
    for folder in FOLDERS:
        monkeypatch.syspath_prepend(str(folder))
    importlib.import_module(name)
    yield request.param, name, words
    del sys.modules[name]
    for registry, known in before:
        registry.clear()
        registry.update(known)


everywhere = pytest.mark.parametrize("registered", OWN, indirect=True)


@pytest.mark.few
@everywhere
def test_it_trains_is_saved_goes_on_and_is_exported_or_says_why_not(registered, tmp_path):
    part, _, words = registered
    model = Model("lqr", **{"loss": "hl-one-hot"} | words, **SMALL).learn(40, progress_bar=False)
    assert words.items() <= model.settings.items()
    path = model.save(tmp_path / "model")
    again = Model.load(path, "lqr")
    assert again.settings == model.settings
    for one in (model, again):
        one.learn(40, progress_bar=False)
    for ours, theirs in zip(jax.tree.leaves(model.learner), jax.tree.leaves(again.learner), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    if part in NOT_EXPORTED:
        with pytest.raises(UsageError, match=NOT_EXPORTED[part]):
            export(model, tmp_path / "policy.onnx")
    else:
        assert export(model, tmp_path / "policy.onnx").exists()


class Bumps(galton.networks.MLP):
    """A part may call what it learns as it likes, and have counts that are no sizes."""

    label = "bumps"

    bump_seed: Count = 2026

    def init(self, key, n_in, n_out, last_scale, of_critic):
        first, *others = super().init(key, n_in, n_out, last_scale, of_critic)
        return [first | {"variance": -jnp.ones(4)}, *others]


class Remembering(galton.algorithms.A2C):
    """An algorithm whose memory begins at −∞."""

    label = "remembering"

    def init(self, agent, params):
        return {"best": jnp.array(-jnp.inf)}


class Telling(galton.algorithms.A2C):
    """It tells a number more than it says."""

    label = "telling"

    def update(self, agent, learner, batch, key):
        learner, told = super().update(agent, learner, batch, key)
        return learner, told | {"mood": 1.0}


def test_an_algorithm_that_tells_other_numbers_than_it_says_is_told_so():
    agent = galton.make_agent(loss="gaussian", n_envs=1, **SMALL).replace(algorithm=Telling())
    with pytest.raises(UsageError, match=r"algorithm is 'a2c', whose update tells .*mood.*; its scalars are "):
        Model.of("lqr", agent).learn(20, progress_bar=False)


def test_a_model_that_no_file_can_name_is_refused_before_it_is_trained(tmp_path):
    model = Model.of("lqr", galton.make_agent(loss="gaussian", n_envs=1, **SMALL).replace(network=Bumps()))
    for callback in (Checkpoint(tmp_path / "m", 10), Evaluate(10, 1, best_model=tmp_path / "m")):
        with pytest.raises(UsageError, match=r"network is Bumps.*files hold names"):
            model.learn(20, callback, progress_bar=False)
    assert model.num_timesteps == 0


def test_what_parts_of_ones_own_learn_and_remember_is_loaded_whatever_it_is(tmp_path, monkeypatch):
    monkeypatch.setitem(galton.NETWORKS, "bumps", Bumps)
    monkeypatch.setitem(galton.ALGORITHMS, "remembering", Remembering)
    model = Model("lqr", "gaussian", network="bumps", algorithm="remembering", n_envs=1, **SMALL).learn(
        20, progress_bar=False
    )
    again = Model.load(model.save(tmp_path / "model"), "lqr")
    assert again.settings == model.settings
    again.set_parameters(model.get_parameters())
    for ours, theirs in zip(jax.tree.leaves(model.learner), jax.tree.leaves(again.learner), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.skipif("CHECKED" in os.environ, reason="tyro fills fields with marks of its own")
@pytest.mark.few
@everywhere
def test_its_settings_are_options_of_the_command_line(registered, tmp_path):
    _, name, words = registered
    options = {"loss": "hl-one-hot", "algorithm": "a2c"} | words | SMALL
    typed = [word for option, value in options.items() for word in (f"--{option.replace('_', '-')}", str(value))]
    run = ["--steps", "20", "--logs", "1", "--eval-episodes", "1", "--out", str(tmp_path / "r"), "--imports", name]
    del sys.modules[name]
    run_command("galton.cli.train", ["lqr", *typed, *run])
    told = json.loads((tmp_path / "r" / "config.json").read_text())
    assert words.items() <= (told["config"] | told["hypers"] | {"loss": told["loss"], "algorithm": "awr"}).items()


@pytest.mark.slow
@pytest.mark.parametrize("registered", ["loss", "network"], indirect=True)
def test_its_settings_are_axes_of_a_sweep_whose_plan_is_read_again(registered, tmp_path):
    _, name, words = registered
    axis = list(words)[1]
    usual = vocabulary().usual[axis]
    grid = expand([{"loss": "hl-one-hot"} | words | SMALL | {axis: [usual, words[axis]]}], {})
    store = Store(str(tmp_path))
    plan = Plan.create(Study("lqr", grid, 2, 20, logs=1, eval_episodes=0, imports=(name,)))
    assert plan.n_shards == (1 if vocabulary().is_number(axis) else 2)
    plan.save(store)
    assert [axis in setting.record() for setting in Plan.load(store).study.settings] == [False, True]
    assert Plan.load(store).names == plan.names
    assert Plan.imports(store) == (name,)
    assert work(store.url, 0).steps == 20 * len(plan.get(0).seeds)


@pytest.mark.parametrize("registered", ["loss"], indirect=True)
def test_its_settings_are_drawn_by_a_benchmark(registered):
    _, name, words = registered
    record = {
        "imports": [name],
        "budget": {"settings": 3},
        "prior": {"learning_rate": {"log-uniform": [1e-3, 1e-1]}},
        "methods": {
            "plain": {"fixed": {"loss": "hl-one-hot"}},
            "own": {"fixed": {"loss": words["loss"]}, "search": {"smoothing": {"uniform": [0.1, 0.4]}}},
        },
        "tasks": {"bandit": {"steps": 100}},
    }
    protocol = reading.of_record(record)
    drawn = draws.draws(protocol)["own"]
    settings = [draws.setting(protocol, protocol.methods[1], each, protocol.tasks[0], fresh=False) for each in drawn]
    assert [setting.agent.loss.smoothing for setting in settings] == [each["smoothing"] for each in drawn]
    assert len({setting["smoothing"] for setting in settings}) == 3


class Column(galton.losses.NegativeLogLikelihood):
    def __call__(self, distribution, action):
        return super().__call__(distribution, action)[..., None]


class Square(galton.critics.SquaredErrorCritic):
    def loss(self, outputs, returns):
        return (returns - outputs) ** 2


@pytest.mark.skipif("CHECKED" in os.environ, reason="the checker refuses other shapes first")
@pytest.mark.parametrize(
    ("part", "told"),
    [
        ({"loss": Column()}, r"loss 'Column' of 2 samples has shape \(2, 1\); it must have shape \(2,\)"),
        ({"loss": "gaussian", "critic": Square()}, r"critic 'Square', whose loss of 2 samples has shape \(2, 2\)"),
    ],
)
def test_a_loss_that_would_be_broadcast_is_refused(part, told):
    for algorithm in (galton.A2C, galton.TRPO):
        with pytest.raises(UsageError, match=told):
            algorithm("lqr", n_steps=128, **part)


@pytest.mark.slow
def test_parts_are_given_beside_what_a_preset_or_a_task_has_for_everybody():
    model = galton.A2C("lqr", optimizer=galton.optimizers.AdamW(learning_rate=1e-3))
    assert model.settings["learning_rate"] == 1e-3
    assert galton.PPO("lqr", optimizer=galton.optimizers.AdamW()).settings["optimizer"] == "adamw"
    assert galton.A2C("bandit", "gaussian", network=galton.networks.SimBa(simba_width=4)).settings["simba_width"] == 4
    with pytest.raises(UsageError, match=r"^learning_rate is 0\.1 beside AdamW"):
        galton.A2C("lqr", optimizer=galton.optimizers.AdamW(), learning_rate=0.1)
    with pytest.raises(UsageError, match=r"^loss is GaussianPolicy.*; it must be of type Loss"):
        galton.make_agent(loss=galton.policies.GaussianPolicy())
