"""What a part is: checked settings, numbers as leaves, all else as structure; and agents read from flat words."""

import dataclasses
import itertools
from typing import ClassVar, Literal

import jax
import numpy as np
import pytest

import galton
from galton import LOSSES, Config, Hypers, UsageError, parts
from galton.agents import MAY_IDLE, ONLY, REGISTRIES, USUAL, read
from galton.algorithms import ALGORITHMS, Rollout
from galton.losses import HLGauss, HLOneHot
from galton.policies import GaussianPolicy, HistogramPolicy
from galton.types import Count, Positive

from .agents import agent


@pytest.mark.parametrize(
    ("kind", "fields", "message"),
    [
        (HLGauss, {"eta": -1.0}, "eta is -1.0; it must be finite, and greater than 0"),
        (HLGauss, {"eta": np.array([0.5, 0.0])}, "eta is 0.0; it must be finite, and greater than 0"),
        (HLGauss, {"eta": "wide"}, "eta is 'wide'; it must be a number"),
        (HLGauss, {"target_tails": "cut"}, "target_tails is 'cut'; choose from rescaled, edges"),
        (
            HLGauss,
            {"eta_rule": "policy", "eta_min": 3.0, "eta_max": 2.0},
            "eta_min is 3.0 and eta_max 2.0; eta_min mus",
        ),
        (HistogramPolicy, {"n_bins": 1}, "n_bins is 1; it must be an integer of at least 2"),
        (Rollout, {"normalize_reward": 1}, "normalize_reward is 1; it must be True or False"),
        (Rollout, {"noise_correlation": 1.0}, "noise_correlation is 1.0; it must be 0 or more, and less than 1"),
        (ALGORITHMS["ppo"], {"clip_range": None}, "clip_range is None; it must be a number"),
    ],
)
def test_a_part_refuses_a_wrong_value_with_what_would_be_right(kind, fields, message):
    with pytest.raises(UsageError, match=f"^{message}"):
        kind(**fields)
    with pytest.raises(UsageError, match=f"^{message}"):
        kind().replace(**fields)


def test_a_parts_fields_stay_what_they_are_and_whole_numbers_are_numbers():
    with pytest.raises(dataclasses.FrozenInstanceError):
        HLGauss().eta = 1.0
    for one in (1, np.int64(1)):
        assert type(HLGauss(eta=one).eta) is float  # an integer would be another program


def test_numbers_are_leaves_and_the_rest_is_structure():
    loss = HLGauss(eta=0.5, eta_rule="policy", eta_min=1.0)
    paths = jax.tree_util.tree_leaves_with_path(loss)
    assert {jax.tree_util.keystr(path): leaf for path, leaf in paths} == {".eta": 0.5, ".eta_min": 1.0, ".eta_max": 16}
    assert jax.tree.structure(loss) == jax.tree.structure(loss.replace(eta=7.0))
    assert jax.tree.structure(loss) != jax.tree.structure(loss.replace(target_tails="edges"))
    assert jax.tree.structure(HLGauss()) != jax.tree.structure(HLOneHot())
    made = agent()
    names = {
        jax.tree_util.keystr(path).lstrip(".").split(".")[-1] for path, _ in jax.tree_util.tree_leaves_with_path(made)
    }
    assert {"learning_rate", "eta", "gamma"} <= names <= set(Hypers._fields)


class Sharp(galton.Loss):
    """−log π, times a number, as often as one says."""

    label: ClassVar[str] = "Sharp"

    sharpness: Positive = 2.0
    times: Count = 1
    sign: Literal["plus", "minus"] = "plus"

    def __call__(self, distribution, action):
        return -self.sharpness * self.times * distribution.log_prob(action)


def test_a_kind_of_ones_own_is_a_part_without_a_decorator(monkeypatch):
    monkeypatch.setitem(LOSSES, "sharp", Sharp)
    assert [*parts.settings(Sharp)] == ["sharpness", "times", "sign"]
    assert jax.tree.leaves(Sharp(3.0, times=2)) == [3.0]
    assert Sharp() == Sharp(2.0, 1, "plus") != Sharp(times=2)
    assert hash(Sharp()) == hash(Sharp(2.0))
    for wrong in ({"sharpness": 0.0}, {"times": 1.5}, {"sign": "none"}):
        ((name, value),) = wrong.items()
        with pytest.raises(UsageError, match=f"^{name} is {value!r}; "):
            Sharp(**wrong)
    made = read({"loss": "sharp", "sharpness": 5.0, "algorithm": "ppo", "n_steps": 64})
    assert (made.loss, type(made.policy)) == (Sharp(5.0), GaussianPolicy)
    with pytest.raises(UsageError, match=r"^sharpness is 0\.0; it must be finite"):
        read({"loss": "sharp", "sharpness": 0.0})


@pytest.mark.parametrize(
    ("given", "kept"),
    [(0.0, None), (None, None), (np.zeros(2), None), (1.0, 1.0), (np.array([0.0, 1.0]), np.array([0.0, 1.0]))],
)
def test_what_is_off_in_every_run_is_trimmed(given, kept):
    np.testing.assert_equal(parts.trimmed(GaussianPolicy(box_units=given)).box_units, kept)
    whole = read({"loss": "gaussian", "n_bins": 7, "ent_coef": 0.0})
    whole = whole.replace(policy=whole.policy.replace(box_units=given))
    trimmed = parts.trimmed(whole)
    np.testing.assert_equal(trimmed.policy.box_units, kept)
    assert trimmed.rollout.noise_correlation is None
    assert trimmed.algorithm.ent_coef == 0.0  # which may not be None
    assert HLOneHot() == parts.trimmed(HLOneHot())


def test_a_part_is_itself_again_after_jax_has_had_it():
    one = agent(Config("hl-gauss-centred", policy="ordinal"), Hypers(eta=0.5, noise_correlation=0.25))
    of_runs = jax.tree.map(lambda number: np.float32(number) * np.arange(1, 4, dtype=np.float32), one)
    for made in (one, of_runs):
        leaves, structure = jax.tree.flatten(made)
        again = jax.tree.unflatten(structure, leaves)
        assert jax.tree.structure(again) == structure
        assert [*map(id, jax.tree.leaves(again))] == [*map(id, leaves)]
        assert again.box == made.box
        jax.tree.map(np.testing.assert_allclose, jax.jit(lambda made: made)(made), made)
    assert one == jax.tree.unflatten(jax.tree.structure(one), jax.tree.leaves(one))
    assert jax.tree.structure(jax.tree.map(lambda _: object(), one)) == jax.tree.structure(one)
    doubled = jax.jit(jax.vmap(lambda made: made.replace(loss=made.loss.replace(eta=2 * made.loss.eta))))(of_runs)
    assert type(doubled.loss) is type(one.loss)
    np.testing.assert_allclose(doubled.loss.eta, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(doubled.rollout.noise_correlation, [0.25, 0.5, 0.75])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            {"loss": "gaussian", "bin_centers": "bounds"},
            "bin_centers is 'bounds'; it goes with policy 'histogram', 'ord",
        ),
        (
            {"loss": "hl-one-hot", "eta_rule": "policy"},
            "eta_rule is 'policy'; it goes with loss 'hl-gauss', 'hl-gauss-",
        ),
        ({"batch_size": 5}, "batch_size is 5; it goes with algorithm 'ppo', not 'a2c'"),
        ({"value_eta": np.array([0.75, 1.0])}, "value_eta is 1.0; it goes with critic 'hl-gauss', not 'squared-error'"),
        ({"temperature": 2.0}, "temperature is 2.0; it goes with weighting 'awr', 'v-mpo', not 'advantage'"),
        ({"entropy_rate": 0.5}, "entropy_rate is 0.5; it goes with entropy_target True, not False"),
        ({"eta_min": 1.0}, "eta_min is 1.0; it has no use with eta_rule at 'fixed'"),
    ],
)
def test_words_that_no_part_has_a_use_for_are_refused(words, message):
    with pytest.raises(UsageError, match=f"^{message}"):
        read(words)
    assert read({name: USUAL[name] for name in USUAL}) == read({})


IDLE = {
    "eta": 3.0,
    "n_bins": 7,
    "exploration": "gaussian",
    "bin_sample": "uniform",
    "deterministic_action": "mean",
    "box_units": 1.0,
    "initial_policy": "gaussian",
}


def test_what_files_may_have_without_a_use_is_let_be():
    assert IDLE.keys() - {"initial_policy"} == set(MAY_IDLE)
    plain = {"loss": "gaussian", "policy": "beta"}
    assert read(plain | IDLE) == read(plain)


def test_agents_whose_numbers_differ_have_one_structure():
    config = Config("hl-gauss", algorithm="ppo", n_steps=64)
    one = agent(config, Hypers())
    other = agent(config, Hypers(0.1, eta=2.0, gamma=0.5, ent_coef=0.1, clip_range=0.5, target_kl=0.1, decay_steps=9))
    assert one != other
    assert jax.tree.structure(one) == jax.tree.structure(other)
    assert hash(jax.tree.structure(one)) == hash(jax.tree.structure(other))
    for differs in (
        agent(dataclasses.replace(config, n_epochs=3)),
        agent(dataclasses.replace(config, net_arch=(8,))),
        agent(dataclasses.replace(config, loss="hl-gauss-centred")),
        agent(config, high=2.0),
        agent(config, Hypers(box_units=1.0)),
    ):
        assert jax.tree.structure(differs) != jax.tree.structure(one)


KINDS = {field: [*registry.values()] for field, (_, registry) in REGISTRIES.items()}
KINDS |= {field: [kind] for field, kind in ONLY.items()}
SHARED = {("policy", "loss"): {"eta", "target_tails"}}
"""What two parts of one agent have both, on purpose: the smoothed policy's width is that of HL-Gauss."""


def test_within_an_agent_no_two_parts_share_a_name_by_accident():
    for one, other in itertools.combinations(KINDS, 2):
        pairs = itertools.product(KINDS[one], KINDS[other])
        shared = [parts.settings(a).keys() & parts.settings(b).keys() for a, b in pairs]
        assert set().union(*shared) == SHARED.get((one, other), set()), (one, other)


def test_every_word_is_a_choice_of_a_part_or_a_setting_and_usual_alike_in_both():
    choices, owned = {word for word, _ in REGISTRIES.values()}, set()
    for kind in itertools.chain(*KINDS.values()):
        owned |= parts.settings(kind).keys()
        for name in parts.settings(kind):
            assert getattr(kind, name) == USUAL[name], (kind, name)
    assert not owned & choices
    assert owned | choices == USUAL.keys()
