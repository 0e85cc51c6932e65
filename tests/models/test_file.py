import dataclasses
import itertools
import zipfile

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from galton import A2C, PPO, CheckpointError, Model, UsageError, algorithms
from galton.envs import LQR

from ..envs.host.walks import Closing
from ..training.slide import Slide

SMALL = {"preset": "paper", "n_bins": 10, "net_arch": (8,)}


@pytest.fixture(scope="module")
def model():
    return A2C("lqr", **SMALL)


def test_a_loaded_model_without_an_environment_is_the_same_and_says_what_it_needs(model, tmp_path):
    path = model.save(tmp_path / "model")
    assert path.name == "model.safetensors"
    loaded, observations = A2C.load(tmp_path / "model"), np.random.default_rng(0).normal(size=(7, 2))
    for deterministic in (True, False, False):
        ours, theirs = (m.predict(observations, deterministic=deterministic)[0] for m in (model, loaded))
        np.testing.assert_array_equal(ours, theirs)
    assert loaded.env is None
    assert (loaded.action_space, loaded.observation_space) == (model.action_space, model.observation_space)
    assert (loaded.settings, loaded.seed) == (model.settings, model.seed)
    for action in (lambda: loaded.learn(1), loaded.evaluate):
        with pytest.raises(UsageError, match=r"load\(path, env=\.\.\.\), or set_env\(env\)"):
            action()
    assert loaded.evaluate(2, LQR()).shape == (2,)
    assert A2C.load(path, "lqr").env.record == LQR()
    with pytest.raises(UsageError, match="env_kwargs"):
        A2C.load(path, env_kwargs={"noise_std": 0.0})
    loaded.close()


def test_a_file_goes_on_only_with_as_many_copies_as_it_was_trained_on(tmp_path):
    path = A2C(Closing, **SMALL, n_steps=4, n_envs=2).save(tmp_path / "model")
    with pytest.raises(UsageError, match="n_envs is 2, but one environment was given"):
        A2C.load(path, env=Closing())


class Mine(A2C):
    """A model of a user's."""


class Own(algorithms.A2C):
    """An algorithm of a user's."""

    label = "Own"
    name = "own"


def test_a_file_says_its_algorithm_and_only_that_class_one_of_it_or_model_opens_it(model, tmp_path, monkeypatch):
    monkeypatch.setitem(algorithms.ALGORITHMS, "own", Own)
    path = PPO("lqr", **SMALL, n_steps=8, batch_size=4, clip_range=0.1).save(tmp_path / "model")
    for cls in (A2C, Mine):
        with pytest.raises(UsageError, match=r"holds a model of PPO; load it with galton.PPO.load"):
            cls.load(path)
    for cls in (PPO, Model, type("Any", (Model,), {})):
        loaded = cls.load(path)
        assert type(loaded).__name__ == cls.__name__
        assert [loaded.settings[name] for name in ("algorithm", "batch_size", "clip_range")] == ["ppo", 4, 0.1]
    own = Model("lqr", **SMALL, algorithm=Own()).save(tmp_path / "own")
    with pytest.raises(UsageError, match=r"holds a model of Own; load it with galton.Model.load"):
        A2C.load(own)
    assert isinstance(Model.load(own).agent.algorithm, Own)
    ours = Mine("lqr", **SMALL).save(tmp_path / "mine")
    assert [type(cls.load(ours)) for cls in (Mine, A2C)] == [Mine, A2C]


def test_what_was_saved_under_a_name_is_loaded_by_it_though_a_folder_has_it_too(model, tmp_path):
    (tmp_path / "x").mkdir()
    (tmp_path / "v1.safetensors").write_text("another file")
    for name in ("x", "v1.5", "a.b.c", "name with spaces"):
        path = model.save(tmp_path / name)
        assert path.is_file()
        assert A2C.load(tmp_path / name).seed == A2C.load(path).seed


def test_what_sb3s_callback_saves_is_loaded_without_its_suffix_and_a_file_of_sb3_itself_refused(model, tmp_path):
    model.save(tmp_path / "rl_model_20_steps.zip")
    assert A2C.load(tmp_path / "rl_model_20_steps").settings == model.settings
    with zipfile.ZipFile(tmp_path / "theirs.zip", "w") as theirs:
        theirs.writestr("data", "{}")
    with pytest.raises(CheckpointError, match=r"theirs.zip can't be loaded: it is a zip, as Stable-Baselines3 writes"):
        A2C.load(tmp_path / "theirs")


def test_a_path_that_names_no_file_or_a_folder_is_told_so(model, tmp_path):
    for name, use in itertools.product(("", ".", "..", "/", "runs/.."), (model.save, A2C.load)):
        with pytest.raises(UsageError, match=r"path is '.*', which names no file"):
            use(name)
    (tmp_path / "x").mkdir()
    (tmp_path / "x.d").mkdir()
    with pytest.raises(CheckpointError, match="x can't be loaded: it is a folder; name a file"):
        A2C.load(tmp_path / "x")
    (tmp_path / "x" / "model.safetensors").touch()
    with pytest.raises(UsageError, match=r"x, the folder of a run; name a file in it, such as .*x/model\.safetensors"):
        A2C.load(tmp_path / "x")
    with pytest.raises(UsageError, match=r"path is .*x\.d, which can't be written: Is a directory"):
        model.save(tmp_path / "x.d")
    with pytest.raises(UsageError, match=r"path is .*nothing, which does not exist"):
        A2C.load(tmp_path / "nothing")


@dataclasses.dataclass(frozen=True)
class Short(Slide):
    """Its state is in bfloat16, which files do not have."""

    def reset(self, key):
        return super().reset(key).astype(jnp.bfloat16)

    def step(self, state, action, noise):
        following, reward, ends = super().step(state, action.astype(jnp.bfloat16), noise)
        return following.astype(jnp.bfloat16), reward.astype(jnp.float32), ends

    def observe(self, state):
        return state.astype(jnp.float32)


def test_a_state_in_bfloat16_goes_on_to_the_same_bits(tmp_path):
    model = A2C(Short(), "gaussian", net_arch=(4,), n_steps=5)
    model.advance(1)
    loaded = A2C.load(model.save(tmp_path / "model"), Short())
    for one in (model, loaded):
        one.advance(1)
    for ours, theirs in zip(*(jax.tree.leaves(one.get_parameters()) for one in (model, loaded)), strict=True):
        np.testing.assert_array_equal(ours, theirs)
