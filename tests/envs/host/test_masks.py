"""Masks of actions from environments of every kind: what they forbid is never done, and odd ones are refused."""

import dataclasses

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete
from stable_baselines3.common.vec_env import DummyVecEnv

import galton
from galton import BrokenEnvironmentError, UsageError
from galton.envs.find import find
from galton.models.file import InexactResume
from galton.training.yardsticks import yardsticks_on

WORDS = {"n_steps": 16, "batch_size": 16, "n_epochs": 2, "net_arch": (8,), "seed": 0}


class Shop(gymnasium.Env):
    """Some of four goods are there, and some of three sizes; what is not there can't be taken."""

    observation_space = Box(0, 1, (7,))
    action_space = MultiDiscrete([4, 3])

    def __init__(self, told="method"):
        self.told = told
        if told == "method":
            self.action_masks = lambda: self.there

    def _move(self):
        there = self.np_random.random(7) < 0.4
        there[self.np_random.integers(4)] = there[4 + self.np_random.integers(3)] = True
        self.there, self.n = there, self.n + 1
        return there.astype(np.float32), {"action_mask": there.astype(np.int8)} if self.told == "info" else {}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.n = 0
        return self._move()

    def step(self, action):
        assert self.there[action[0]]
        assert self.there[4 + action[1]]
        observation, info = self._move()
        return observation, float(action[0]), self.n > 5, False, info


def vectors(told):
    """The same in vector environments of Gymnasium and of SB3."""
    make = lambda: Shop(told)  # noqa: E731
    same = gymnasium.vector.AutoresetMode.SAME_STEP
    return {
        "gymnasium": lambda: gymnasium.vector.SyncVectorEnv([make] * 2, autoreset_mode=same),
        "sb3": lambda: DummyVecEnv([make] * 2),
    }


@pytest.mark.parametrize("told", ["method", "info"])
@pytest.mark.parametrize("loss", ["gaussian", "hl-gauss-centred"])
def test_what_a_mask_forbids_is_never_done(told, loss):
    model = galton.PPO(lambda: Shop(told), loss=loss, n_envs=2, normalize_observation=True, **WORDS)
    assert model.agent.box.n_mask == 7
    model.learn(128)
    assert np.isfinite(model.evaluate(3)).all()
    shapes = [layer["kernel"].shape[0] for net in ("actor", "critic") for layer in model.learner.params[net][:1]]
    assert shapes == [7, 7], "the networks see the observation alone"
    assert model.learner.normalizer.observation.mean.shape == (7,)
    allowed = np.array([0, 1, 0, 0, 0, 0, 1], bool)
    for deterministic in (True, False):
        action, _ = model.predict(np.ones(7, np.float32), deterministic=deterministic, action_masks=allowed)
        np.testing.assert_array_equal(action, [1, 2])
    many, _ = model.predict(np.ones((50, 7), np.float32), action_masks=np.tile(allowed, (50, 1)))
    np.testing.assert_array_equal(many, np.tile([1, 2], (50, 1)))


@pytest.mark.parametrize("kind", [galton.TRPO, galton.VMPO])
def test_trust_regions_take_masks_too(kind):
    told = []
    kind(lambda: Shop("info"), n_steps=32, net_arch=(8,)).learn(512, lambda model, log: told.append(log))
    assert 0 < max(log["train/kl"] for log in told) < 0.1
    assert all(np.isfinite(value) for log in told for name, value in log.items() if name.startswith("train/"))
    assert "train/sigma" not in told[0], "no entry is a number"


@pytest.mark.parametrize("kind", ["gymnasium", "sb3"])
@pytest.mark.parametrize("told", ["method", "info"])
def test_vector_environments_tell_masks_too(kind, told):
    model = galton.A2C(vectors(told)[kind](), n_steps=16, net_arch=(8,), seed=0).learn(128)
    assert model.agent.box.n_mask == 7


def test_a_masked_model_is_saved_and_goes_on_where_it_was(tmp_path):
    whole = galton.PPO(Shop, n_envs=2, loss="hl-one-hot", **WORDS).learn(64)
    whole.save(tmp_path / "model")
    with pytest.warns(InexactResume, match="goes on from the start of new episodes"):
        again = galton.PPO.load(tmp_path / "model", env=Shop)
    row, mask = np.full(7, 0.5, np.float32), [0, 0, 1, 0, 1, 1, 0]
    for model in (whole, again):
        model.n_predictions = 0
    for deterministic in (True, False):
        one, other = (model.predict(row, deterministic=deterministic, action_masks=mask)[0] for model in (whole, again))
        np.testing.assert_array_equal(one, other)
    again.learn(64)
    with pytest.raises(UsageError, match="env tells masks of 0 entries, and the model's has 7"):
        galton.PPO.load(tmp_path / "model", env=lambda: Shop("nothing"))


class Joint(Shop):
    """A number whose five bins are not all within reach, beside a switch."""

    observation_space = Box(-1, 1, (1,))
    action_space = Dict(angle=Box(-1, 1, (1,)), switch=Discrete(2))

    def _move(self):
        self.n, at = self.n + 1, self.np_random.integers(1, 4)
        self.there = np.append(abs(np.arange(5) - at) <= 1, [True, at < 3])
        return np.float32([at / 2 - 1]), {}

    def step(self, action):
        assert self.there[round(float(action["angle"][0] * 2 + 2))]
        assert self.there[5 + action["switch"]]
        observation, info = self._move()
        return observation, float(action["angle"][0]), self.n > 5, False, info


def test_bins_of_a_number_are_masked_beside_choices():
    words = WORDS | {"loss": "hl-gauss-centred", "eta": 1.0, "bin_centers": "bounds"}
    model = galton.PPO(Joint, n_bins=5, **words).learn(128)
    assert model.agent.box.mask_sizes == (5, 2)
    with pytest.raises(UsageError, match=r"n_bins is 7, and .* mask has 7 entries, which are 5 for each number"):
        galton.PPO(Joint, n_bins=7, **words)
    with pytest.raises(UsageError, match="mask has 7 entries, some of bins; policy 'histogram' alone can have that"):
        galton.PPO(Joint, loss="gaussian", **WORDS)


@dataclasses.dataclass(frozen=True)
class Doors:
    """In pure JAX: two of three doors are open, and the first that is shut ends an episode in disgrace."""

    action_space = Discrete(3)
    observation_low, observation_high = np.zeros(1, np.float32), np.full(1, 2, np.float32)
    max_episode_steps = 8
    optimal_return = random_return = None

    def reset(self, key):
        return drawn(key)

    def noise(self, key):
        return drawn(key)

    def action_mask(self, state):
        return jnp.arange(3) != state

    def step(self, state, action, noise):
        return noise, jnp.where(action == state, -100.0, action.astype(float)), jnp.array(False)

    def observe(self, state):
        return state[None].astype(float)


def drawn(key):

    return jax.random.randint(key, (), 0, 3)


def test_a_record_in_jax_may_have_choices_and_masks():
    model = galton.PPO(Doors(), loss="hl-one-hot", normalize_observation=True, **WORDS)
    log = []
    model.learn(2048, callback=lambda model, told: log.append(told["rollout/ep_rew_mean"]))
    assert min(log) >= 0
    assert log[-1] > 1.3 * 8, "it takes the last open door: 5/3 a step on average"
    assert (model.evaluate(5) >= 0).all()


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        ([0, 0, 0, 0, 1, 1, 1], "the action mask allows no value of entry 0 of the action; allow one at least"),
        ([1, 1, 1, 1, 0, 0, 0], "the action mask allows no value of entry 1"),
        ([1, 1, 1], "it must be 7 of 1 and 0"),
        ([1, 1, 1, 1, 0.5, 1, 1], "it must be 7 of 1 and 0"),
        ([1, 1, 1, 1, np.nan, 1, 1], "it must be 7 of 1 and 0"),
    ],
)
def test_an_odd_mask_is_refused_with_copy_and_step(mask, message):
    class Odd(Shop):
        def _move(self):
            observation, info = super()._move()
            if self.n == 4:
                self.there = np.asarray(mask)
            return observation, info

    with pytest.raises(BrokenEnvironmentError, match=rf"Odd, copy 0, step 3: the action mask.*{message}|{message}"):
        galton.A2C(Odd, n_steps=16, n_envs=1, net_arch=(8,), seed=0).learn(64)


def test_a_mask_that_a_vector_environment_does_not_tell_is_missed():
    class Silent(Shop):
        def step(self, action):
            return *super().step(action)[:4], {}

    with pytest.raises(BrokenEnvironmentError, match="copy 0, step 1: the action mask is None"):
        galton.A2C(
            gymnasium.vector.SyncVectorEnv(
                [lambda: Silent("info")] * 2, autoreset_mode=gymnasium.vector.AutoresetMode.SAME_STEP
            ),
            n_steps=16,
            net_arch=(8,),
            seed=0,
        ).learn(64)


@pytest.mark.parametrize("library", ["gymnasium", "sb3"])
def test_a_vector_environments_method_that_raises_is_blamed(library, monkeypatch):
    env = vectors("method")[library]()
    model = galton.A2C(env, n_steps=16, net_arch=(8,), seed=0)

    def masks():
        raise ZeroDivisionError("the shelf")

    for copy in env.envs:
        monkeypatch.setattr(copy.unwrapped, "action_masks", masks)
    with pytest.raises(BrokenEnvironmentError, match=r", step \d: action_masks raised ZeroDivisionError: the shelf"):
        model.learn(64)


def test_a_mask_of_no_use_is_refused_at_once():
    class Odd(Shop):
        def _move(self):
            observation, info = super()._move()
            self.there = np.ones(5)
            return observation, info

    with pytest.raises(
        UsageError, match=r"mask has 5 entries; it must have one for each value .* 7, and none of the 0"
    ):
        galton.A2C(Odd)
    model = galton.A2C(lambda: Shop("nothing"), net_arch=(8,))
    with pytest.raises(UsageError, match=r"action_masks are given, and the environment .* has none"):
        model.predict(np.ones(7, np.float32), action_masks=np.ones(7))
    masked = galton.A2C(Shop, net_arch=(8,))
    with pytest.raises(UsageError, match=r"action_masks is .*; it must be 7 of True and False for each observation"):
        masked.predict(np.ones(7, np.float32), action_masks=np.ones(6))
    with pytest.raises(UsageError, match="action_masks allows no value of entry 0 of the action; allow one at least"):
        masked.predict(np.ones((2, 7), np.float32), action_masks=[[1] * 7, [0, 0, 0, 0, 1, 1, 1]])
    assert masked.predict(np.ones((0, 7), np.float32))[0].shape == (0, 2)


def test_a_mask_in_parts_is_refused_with_the_form_that_it_must_have():
    class Parts(Shop):
        def _move(self):
            observation, info = super()._move()
            self.there = np.ones(4), np.ones(3)
            return observation, info

    with pytest.raises(UsageError, match="give one array of 1 and 0, all choices one after the other"):
        galton.A2C(Parts)


@pytest.mark.parametrize("env", [Shop, Joint])
def test_doing_nothing_and_random_actions_keep_to_masks(env):
    task = find(env)
    found = yardsticks_on(task, task.actions.box)
    assert np.isfinite(found).all()
    told = str(galton.check_env(env))
    assert "raised" not in told
    assert "never moved" not in told  # a mask is no observation


def test_a_run_with_choices_and_masks_is_resumed_to_the_bit(tmp_path):
    words = WORDS | {"loss": "hl-one-hot", "normalize_observation": True}
    whole, first = (galton.PPO(Doors(), **words).learn(n) for n in (128, 64))
    first.save(tmp_path / "model")
    again = galton.PPO.load(tmp_path / "model", env=Doors()).learn(64)
    jax.tree.map(np.testing.assert_array_equal, again.learner.params, whole.learner.params)
