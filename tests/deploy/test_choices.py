"""Exported policies over numbers and choices do what `predict` does, with masks and without."""

import json

import gymnasium
import numpy as np
import onnxruntime
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple

import galton
from galton.deploy import export
from galton.deploy.decision import decide

SPACE = Dict(
    motors=Box(np.float32([-1, 0]), np.float32([1, 4])),
    gripper=Discrete(3, start=5),
    gears=Tuple([MultiDiscrete([2, 4]), MultiBinary(2)]),
)
WORDS = {"n_steps": 16, "batch_size": 16, "n_epochs": 2, "net_arch": (8,), "seed": 0, "normalize_observation": True}
HEADS = [
    {"loss": "gaussian"},
    {"loss": "gaussian", "policy": "beta"},
    {"loss": "gaussian", "state_dependent_std": True},
    {"loss": "hl-one-hot", "n_bins": 7},
    {"loss": "hl-gauss-centred", "n_bins": 7, "deterministic_action": "mean"},
    {"loss": "hl-one-hot", "n_bins": 7, "deterministic_action": "median"},
    {"loss": "hl-gauss", "n_bins": {"motors": 9}, "bin_centers": {"motors.1": (0, 0.5, 4)}, "eta": {"motors.0": 1.0}},
    {"loss": "hl-one-hot", "policy": "anchored", "n_bins": 7, "deterministic_action": "mean"},
]


class Robot(gymnasium.Env):
    """It observes numbers and takes what it is given."""

    observation_space = Box(-1, 1, (4,))

    def __init__(self, space=SPACE, n_mask=0):
        self.action_space, self.n = space, 0
        if n_mask:
            self.action_masks = lambda: np.ones(n_mask)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.uniform(-1, 1, 4).astype(np.float32), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.n += 1
        return self.reset()[0], self.np_random.normal(), self.n % 5 == 0, False, {}


def rows_of(session, observations, **more):
    (found,) = session.run(["action"], {"observation": observations, **more})
    return found


def as_given(model, rows):
    """The file's flat actions as the environment has them."""
    return model.actions.clip(rows)


def same(one, other):
    if isinstance(one, dict):
        return all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple):
        return all(map(same, one, other))
    return np.allclose(one, other, atol=1e-5)


@pytest.mark.parametrize("words", HEADS)
def test_the_file_acts_as_predict_does(tmp_path, words):
    model = galton.PPO(Robot, **WORDS | words).learn(64)
    session = onnxruntime.InferenceSession(export(model, tmp_path / "policy"))
    observations = np.random.default_rng(0).uniform(-1, 1, (500, 4)).astype(np.float32)
    found, (expected, _) = rows_of(session, observations), model.predict(observations, deterministic=True)
    assert found.shape == (500, 7)
    assert same(as_given(model, found), expected)
    terms = json.loads((tmp_path / "policy.json").read_text())
    assert terms["output"]["shape"] == ["batch", 7]
    parts = {".".join(map(str, entry["part"])): entry for entry in terms["output"]["entries"]}
    assert list(parts) == ["motors", "gripper", "gears.0", "gears.1"]
    assert (parts["gripper"]["from"], parts["gripper"]["to"], parts["gripper"]["first"]) == (2, 3, 5)
    assert terms["output"]["high"] == [1, 4, 2, 1, 3, 1, 1]


def test_the_rule_for_choices_alone_is_their_mode():
    assert decide(galton.PPO("CartPole-v1", preset="classification")).chosen.rule == "mode"


@pytest.mark.parametrize("words", [{"loss": "gaussian"}, {"loss": "hl-one-hot", "n_bins": 7}])
def test_a_mask_is_a_second_input(tmp_path, words):
    model = galton.PPO(lambda: Robot(n_mask=13), **WORDS | words).learn(64)
    path = export(model, tmp_path / "policy")
    session = onnxruntime.InferenceSession(path)
    rng = np.random.default_rng(1)
    observations, masks = rng.uniform(-1, 1, (300, 4)).astype(np.float32), rng.random((300, 13)) < 0.5
    masks[:, [0, 3, 5, 9, 11]] = True
    found = rows_of(session, observations, action_mask=masks.astype(np.float32))
    expected, _ = model.predict(observations, deterministic=True, action_masks=masks)
    assert same(as_given(model, found), expected)
    assert (masks[np.arange(300), expected["gripper"] - 5]).all()
    assert json.loads(path.with_suffix(".json").read_text())["mask"]["shape"] == ["batch", 13]


def test_bins_that_are_masked_too_and_spaces_of_choices_alone(tmp_path):
    words = WORDS | {"loss": "hl-one-hot", "n_bins": 5, "deterministic_action": "mean"}
    rng = np.random.default_rng(2)
    observations = rng.uniform(-1, 1, (300, 4)).astype(np.float32)
    joint = galton.PPO(lambda: Robot(Dict(angle=Box(-1, 1, (1,)), on=Discrete(2)), 7), **words).learn(64)
    masks = rng.random((300, 7)) < 0.5
    masks[:, [4, 5]] = True
    session = onnxruntime.InferenceSession(export(joint, tmp_path / "joint"))
    found = rows_of(session, observations, action_mask=masks.astype(np.float32))
    expected = joint.predict(observations, deterministic=True, action_masks=masks)[0]
    assert same(as_given(joint, found), expected)
    bins = galton.Bins([-1.0], [1.0], 5)
    assert masks[np.arange(300), np.asarray(bins.encode(expected["angle"]))[:, 0]].all(), "a mean is allowed too"
    assert not np.isin(expected["angle"], bins.centers).all(), "and it is no mode"
    for loss in ("gaussian", "hl-one-hot"):
        model = galton.PPO(lambda: Robot(Discrete(3)), **words | {"loss": loss}).learn(64)
        session = onnxruntime.InferenceSession(export(model, tmp_path / loss))
        found = rows_of(session, observations)
        np.testing.assert_array_equal(found[:, 0], model.predict(observations, deterministic=True)[0])
