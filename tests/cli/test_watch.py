"""A film whatever the environment, the model or its settings do: what can't be played is said in a line."""

import json
import shutil

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from gymnasium.wrappers import NormalizeObservation, TransformObservation
from numpy.testing import assert_array_equal
from PIL import Image

from galton import A2C, BrokenEnvironmentError, Model, UsageError
from galton.cli import watch

FINE = (np.zeros(2, np.float32), 1.0, False, False, {})


class Watched(gymnasium.Env):
    """Answers as it is told, at its second step."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012, as Gymnasium has it
    action_space = Box(-1.0, 1.0, (1,))

    def __init__(self, render_mode=None, answer=FINE, begun=FINE[0], n_observed=2):
        self.render_mode, self.answer, self.begun, self.t = render_mode, answer, begun, 0
        self.observation_space = Box(-1.0, 1.0, (n_observed,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        if isinstance(self.begun, Exception):
            raise self.begun
        return self.begun, {}

    def step(self, action):
        self.t += 1
        if self.t < 2:
            return FINE
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def render(self):
        picture = np.zeros((8, 8, 3), np.uint8)
        picture[self.t % 8] = 255
        return picture


@pytest.fixture(scope="module", autouse=True)
def _registered():
    gymnasium.register("Watched-v0", Watched, disable_env_checker=True)
    yield
    del gymnasium.registry["Watched-v0"]


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    model = A2C("Watched-v0", n_bins=5, net_arch=(4,))
    return model.save(tmp_path_factory.mktemp("watched") / "model.safetensors")


@pytest.fixture
def run(saved, tmp_path):
    """A run folder with a model, and no settings yet."""
    shutil.copy(saved, tmp_path / "model.safetensors")
    return tmp_path


def film(run, *arguments):
    watch.main([str(run), "--max-steps", "4", "--out", str(run / "film.gif"), *arguments])


def changed(reply, **parts):
    names = ("observation", "reward", "terminated", "truncated", "info")
    return tuple(parts.get(name, value) for name, value in zip(names, reply, strict=True))


@pytest.mark.slow
def test_the_run_is_played_with_its_own_settings(run, capsys):
    (run / "config.json").write_text(json.dumps({"env": "Watched-v0", "env_kwargs": {}}))
    film(run, "--episodes", "2")
    assert "return 4.00, 4.00 in 10 frames" in capsys.readouterr().out
    with Image.open(run / "film.gif") as frames:
        assert frames.n_frames == 10


BROKEN = {
    "raises": (ArithmeticError("on purpose"), "Watched-v0, episode 0, step 2: step raised ArithmeticError: on purpose"),
    "none": (None, r"step 2: step returned None; it must return \(observation, reward"),
    "reward": (changed(FINE, reward="much"), "step 2: the reward is 'much'; it must be one number"),
    "flag": (changed(FINE, terminated="no"), "step 2: terminated is 'no'; it must be True or False"),
    "shape": (changed(FINE, observation=np.zeros(3)), r"step 2: the observation is array\(.*the space is Box"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_an_environment_that_breaks_is_blamed_with_episode_and_step(name, run, monkeypatch):
    answer, message = BROKEN[name]
    monkeypatch.setattr(Watched.__init__, "__defaults__", (None, answer, FINE[0], 2))
    with pytest.raises(BrokenEnvironmentError, match=message):
        film(run, "--env", "Watched-v0")
    assert [path.name for path in run.iterdir()] == ["model.safetensors"]


def test_a_reset_that_raises_is_blamed_and_a_run_that_is_not_there_named(run, monkeypatch):
    monkeypatch.setattr(Watched.__init__, "__defaults__", (None, FINE, KeyError("seed"), 2))
    with pytest.raises(BrokenEnvironmentError, match="Watched-v0, episode 0: reset raised KeyError: 'seed'"):
        film(run, "--env", "Watched-v0")
    for name in ("nowhere", "x" * 300, "a/" * 3000, ""):
        with pytest.raises(UsageError, match=r"^run is "):
            watch.main([name])


class Unseen(Watched):
    """Takes no render_mode."""

    def __init__(self):
        super().__init__()


def test_an_environment_without_a_picture_is_refused_with_what_a_film_needs(run):
    with pytest.raises(UsageError, match=r"unexpected keyword argument 'render_mode'; a film needs .* then renders"):
        film(run, "--env", f"{__name__}:Unseen")


def bare(render_mode=None):
    return TransformObservation(Watched(render_mode), lambda seen: seen, Box(-np.inf, np.inf, (2,)))


def counting(render_mode=None):
    return NormalizeObservation(Watched(render_mode))


def test_a_policy_is_not_filmed_on_other_observations_than_it_was_trained_on(run):
    for kind in (bare, counting):
        model = A2C(kind, n_bins=5, net_arch=(4,))
        model.save(run / "model.safetensors")
        model.close()
        if kind is bare:
            with pytest.raises(UsageError, match="has counted no observations"):
                film(run, "--env", f"{__name__}:counting")
    film(run, "--env", f"{__name__}:counting")


class Recorded(Watched):
    """Remembers its actions, and allows one choice in each state: that of the state's number."""

    acted: list = []  # noqa: RUF012, one for all copies

    def __init__(self, render_mode=None, masked=False):
        super().__init__(render_mode)
        if masked:
            self.action_space = Discrete(5)
            self.action_masks = lambda: np.arange(5) == self.t

    def step(self, action):
        self.acted.append(action)
        return super().step(action)


@pytest.mark.parametrize("kwargs", [{"masked": True}, {"action_scale": 8.0}])
def test_actions_are_those_that_training_would_take(kwargs, run):
    name = f"{__name__}:Recorded"
    model = A2C(name, n_bins=5, net_arch=(4,), env_kwargs=kwargs)
    model.save(run / "model.safetensors")
    model.close()
    Recorded.acted.clear()
    film(run, "--env", name, "--env-kwargs", json.dumps(kwargs))
    observations = [Watched.reset(Recorded())[0], *[FINE[0]] * 3]
    policy = Model.load(run / "model.safetensors")
    if "masked" in kwargs:
        assert Recorded.acted == [0, 1, 2, 3]
    else:
        acted = [policy.predict(each, deterministic=True)[0] / 8 for each in observations]
        assert_array_equal(Recorded.acted, acted)
        assert np.any(acted)


def test_another_environment_than_the_models_is_refused_before_it_is_played(run):
    with pytest.raises(UsageError, match=r"env has observations Box.*; the model's are Box"):
        film(run, "--env", "Watched-v0", "--env-kwargs", '{"n_observed": 3}')
    with pytest.raises(UsageError, match=r"env has actions Box.*; the model's are Box"):
        film(run, "--env", "Pendulum-v1")


SETTINGS = {
    "no JSON": ("{", "can't be read"),
    "a list": ("[1]", "holds no settings"),
    "an env that is no name": ('{"env": 5}', "env is 5 in .*; it must be a name"),
    "no env": ("{}", "env is not known"),
    "odd arguments": ('{"env": "Watched-v0", "env_kwargs": 5}', "env_kwargs is '5'; it must be a JSON object"),
    "wrong arguments": ('{"env": "Watched-v0", "env_kwargs": {"mass": 1}}', "can't be made: TypeError"),
    "a long env": ('{"env": "%s-v0"}' % ("x" * 300), "can't be made: NameNotFound"),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_broken_settings_beside_the_model_are_named_and_not_needed(name, run):
    content, message = SETTINGS[name]
    (run / "config.json").write_text(content)
    with pytest.raises(UsageError, match=message):
        film(run)
    film(run, "--env", "Watched-v0", "--env-kwargs", "{}")
    assert (run / "film.gif").exists()
    if message == "can't be read":  # something is wanted of them
        with pytest.raises(UsageError, match=r"can't be read: .*; give --env and --env-kwargs"):
            film(run, "--env", "Watched-v0")


def test_wrong_numbers_are_refused_before_anything_is_loaded(tmp_path):
    (tmp_path / "model.safetensors").touch()
    for arguments, message in (
        (("--seed", "-1"), "seed is -1"),
        (("--seed", "4294967296"), "seed is 4294967296; it must be less than"),
        (("--episodes", "0"), "episodes is 0"),
        (("--max-steps", "0"), "max_steps is 0"),
        (("--out", "film.png"), "its name must end in .mp4 or .gif"),
    ):
        with pytest.raises(UsageError, match=message):
            watch.main([str(tmp_path), *arguments])
