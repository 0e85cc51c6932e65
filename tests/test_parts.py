"""What a part is: checked settings, numbers as leaves, all else as structure; and agents read from flat words."""

import dataclasses
import itertools
import re
import typing
from typing import ClassVar, Literal

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import galton
from galton import LOSSES, Agent, UsageError, make_agent, parts
from galton.agents import read, words_of, written
from galton.algorithms import ALGORITHMS, Rollout
from galton.fields import annotations
from galton.losses import HLGauss, HLOneHot
from galton.policies import GaussianPolicy, HistogramPolicy
from galton.types import Count, Positive
from galton.words import CHOICES, CHOOSING, MAY_IDLE, vocabulary

from .agents import agent


@pytest.mark.parametrize(
    ("kind", "fields", "message"),
    [
        (HLGauss, {"eta": -1.0}, "eta is -1.0; it must be finite, and greater than 0"),
        (HLGauss, {"eta": np.array([0.5, 0.0])}, "eta is 0.0; it must be finite, and greater than 0"),
        (HLGauss, {"target_tails": "cut"}, "target_tails is 'cut'; choose from rescaled, edges"),
        (
            HLGauss,
            {"eta_rule": "policy", "eta_min": 3.0, "eta_max": 2.0},
            "eta_min is 3.0 and eta_max 2.0; eta_min mus",
        ),
        (Rollout, {"normalize_window": 0.0}, "normalize_window is 0.0; it must be greater than 0, or inf for all"),
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
    assert {jax.tree_util.keystr(path): leaf for path, leaf in paths} == {
        ".eta": 0.5,
        ".eta_min": 1.0,
        ".eta_max": 16,
        ".diffusion": 0,
    }
    assert jax.tree.structure(loss) == jax.tree.structure(loss.replace(eta=7.0))
    assert jax.tree.structure(loss) != jax.tree.structure(loss.replace(target_tails="edges"))
    assert jax.tree.structure(HLGauss()) != jax.tree.structure(HLOneHot())
    made = agent()
    names = {
        jax.tree_util.keystr(path).lstrip(".").split(".")[-1] for path, _ in jax.tree_util.tree_leaves_with_path(made)
    }
    assert {"learning_rate", "eta", "gamma"} <= names <= {*filter(vocabulary().is_number, vocabulary().usual)}


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
    whole = read({"loss": "gaussian", "n_bins": 7, "ent_coef": 0.0, "vf_coef": 0.5})
    whole = whole.replace(policy=whole.policy.replace(box_units=given))
    trimmed = parts.trimmed(whole)
    np.testing.assert_equal(trimmed.policy.box_units, kept)
    assert trimmed.rollout.noise_correlation is None
    assert trimmed.algorithm.ent_coef is None
    assert trimmed.algorithm.vf_coef == 0.5  # which may not be None
    assert HLOneHot() == parts.trimmed(HLOneHot())


def test_a_part_is_itself_again_after_jax_has_had_it():
    one = agent({"loss": "hl-gauss-centred", "policy": "ordinal", "eta": 0.5, "noise_correlation": 0.25})
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
        ({"batch_size": 5}, "batch_size is 5; it goes with algorithm 'ppo', 'trpo', 'v-mpo', not 'a2c'"),
        ({"value_eta": np.array([0.75, 1.0])}, "value_eta is 1.0; it goes with critic 'hl-gauss', not 'squared-error'"),
        ({"entropy_rate": 0.5}, "entropy_rate is 0.5; it goes with entropy_target True, not False"),
        ({"eta_min": 1.0}, "eta_min is 1.0; it has no use with eta_rule at 'fixed'"),
    ],
)
def test_words_that_no_part_has_a_use_for_are_refused(words, message):
    with pytest.raises(UsageError, match=f"^{message}"):
        read(words)
    assert read(vocabulary().usual) == read({})


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
    words = {"loss": "hl-gauss", "algorithm": "ppo", "n_steps": 64}
    numbers = {"learning_rate": 0.1, "eta": 2.0, "gamma": 0.5, "clip_range": 0.5, "target_kl": 0.1}
    one, other = agent(words), agent(words | numbers | {"decay_steps": 9})
    assert one != other
    assert jax.tree.structure(one) == jax.tree.structure(other)
    assert hash(jax.tree.structure(one)) == hash(jax.tree.structure(other))
    for differs in (
        agent(words | {"n_epochs": 3}),
        agent(words | {"net_arch": (8,)}),
        agent(words | {"loss": "hl-gauss-centred"}),
        agent(words, high=2.0),
        agent(words | {"box_units": 1.0}),
    ):
        assert jax.tree.structure(differs) != jax.tree.structure(one)


KINDS = {field: [*choice.registry.values()] for field, choice in CHOICES.items()} | {"rollout": [Rollout]}
SHARED = {("loss", "policy"): {"eta", "target_tails"}}
"""What two parts of one agent have both, on purpose: the smoothed policy's width is that of HL-Gauss."""


def test_within_an_agent_no_two_parts_share_a_name_by_accident():
    for one, other in itertools.combinations(KINDS, 2):
        pairs = itertools.product(KINDS[one], KINDS[other])
        shared = [parts.settings(a).keys() & parts.settings(b).keys() for a, b in pairs]
        assert set().union(*shared) == SHARED.get((one, other), set()), (one, other)


def test_every_word_is_a_choice_of_a_part_or_a_setting_and_usual_alike_in_both():
    owned, usual = set(), vocabulary().usual
    for kind in itertools.chain(*KINDS.values()):
        owned |= parts.settings(kind).keys()
        for name in parts.settings(kind):
            assert getattr(kind, name) == usual[name], (kind, name)
    assert not owned & {*CHOOSING}
    assert owned | {*CHOOSING} == usual.keys()
    assert owned == vocabulary().annotations.keys()


class Narrow(galton.Loss):
    """−log π, with a setting that others have too."""

    eta: Positive = 0.5

    def __call__(self, distribution, action):
        return -distribution.log_prob(action)


class Bare(Narrow):
    """The same with a setting that has no usual value."""

    eta: Positive = 0.25
    sharpness: Positive = dataclasses.field(kw_only=True)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Narrow, r"Narrow\.eta is 0\.5 by default, and 0\.25 elsewhere; give it another name"),
        (Bare, r"Bare\.sharpness has no default; give it one, for an agent that is made by words"),
    ],
)
def test_two_usual_values_of_one_setting_or_none_are_refused(monkeypatch, kind, message):
    known = vocabulary()
    with monkeypatch.context() as patch:
        patch.setitem(LOSSES, "own", kind)
        for attempt in (vocabulary, lambda: read({}), lambda: make_agent(loss="own")):
            with pytest.raises(UsageError, match=f"^{message}"):
                attempt()
    assert vocabulary() == known


PAIRS = [(choice.word, key) for choice in CHOICES.values() for key in choice.registry]
OTHER = {
    "net_arch": (8,),
    "critic_arch": (4,),
    "n_steps": 128,
    "batch_size": 32,
    "normalize_reward": True,
    "negative_target": "same",
    "box_units": 1.0,
    "log_std_min": -3.0,
    "target_kl": 0.1,
    "clip_range_vf": 0.1,
    "decay_steps": np.inf,
    "entropy_alpha_min": 0.0,
    "ordered": (),
    "per_entry": (),
}
"""What settings are set to where another value is not made of the usual one."""


def other(name):
    """Another value of a setting than its usual one."""
    usual, annotation = vocabulary().usual[name], vocabulary().annotations[name]
    if name in OTHER:
        return OTHER[name]
    if isinstance(usual, str):
        return next(word for word in typing.get_args(annotation) if word != usual)
    return not usual if isinstance(usual, bool) else usual + 1 if isinstance(usual, int) else usual / 2 or 0.5


@pytest.mark.parametrize(("word", "key"), PAIRS)
def test_words_come_back_from_the_agent_that_is_read_of_them(word, key):
    words = {"n_steps": 64, "normalize_reward": True, word: key}
    words |= {"loss": "gaussian"} if word == "policy" else {}  # which fits every policy
    found = words_of(read(words))
    kept = {"policy": "auto"} if words.get("policy") == "gaussian" else {}
    assert found.items() >= (words | kept).items()
    assert read(found) == read(words)
    owned = found.keys() - {*CHOOSING}
    assert [*found] == [name for name in vocabulary().usual if name in owned or name in CHOOSING]
    changed = found | {name: other(name) for name in owned}
    assert words_of(read(changed)) == changed
    assert all(type(value) is type(changed[name]) for name, value in words_of(read(changed)).items())
    assert words_of(agent(changed)) == changed  # in a box, without a trace of what is off
    assert words_of(agent(words)) == found


@pytest.mark.parametrize(("word", "key"), PAIRS)
def test_a_part_and_its_name_are_the_same_word_under_every_algorithm(word, key):
    kind = next(choice.registry for choice in CHOICES.values() if choice.word == word)[key]
    words = {"algorithm": "ppo", "normalize_reward": True} | ({"loss": "gaussian"} if word == "policy" else {})
    by_name, usual = make_agent(**words | {word: key}), vocabulary().usual
    own = {name: usual[name] for name in parts.settings(kind)}  # not what the algorithm has instead
    assert make_agent(**words | {word: kind()}) == make_agent(**words | own | {word: key})
    assert type(by_name) is Agent


def test_a_part_without_a_name_is_its_own_word_and_none_to_write_down():
    made = make_agent(loss=Sharp(5.0), algorithm="ppo")
    words = words_of(made)
    assert words["loss"] is made.loss
    assert "sharpness" not in words
    assert read(words) == made
    with pytest.raises(UsageError, match=r"^loss is Sharp\(.*files hold names; give its class a line in the registry"):
        written(words)


def test_an_agent_by_words_has_its_algorithms_usual_values_and_a_reader_has_not():
    made, usual = make_agent(algorithm="ppo"), ALGORITHMS["ppo"].defaults
    assert words_of(made).items() >= usual.items()
    assert make_agent(algorithm="ppo", n_steps=64).rollout.n_steps == 64
    assert read({"algorithm": "ppo"} | usual) == made
    plain = read({"algorithm": "ppo", "n_steps": 64})
    assert (plain.optimizer.learning_rate, plain.algorithm.gae_lambda) == (7e-4, 1.0)
    assert make_agent() == read({})


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"learnin_rate": 0.1}, "'learnin_rate' is no setting; did you mean learning_rate?"),
        ({"zzz": 1}, "'zzz' is no setting; choose from a"),
        ({"loss": "hl-gaus"}, "loss is 'hl-gaus'; choose from gaussian, hl-one-hot, hl-gauss, hl-gauss-centred; did y"),
        ({"critic": None}, "critic is None; "),
        ({"policy": HLGauss()}, "policy is HLGauss"),
        ({"loss": HLGauss(), "eta_rule": "policy"}, "eta_rule is 'policy' beside HLGauss(eta=0.25"),
    ],
)
def test_words_that_mean_nothing_are_refused(words, message):
    for attempt in (make_agent, lambda **words: read(words)):
        with pytest.raises(UsageError, match=f"^{re.escape(message)}"):
            attempt(**words)


THREE = {"policy": HistogramPolicy(), "loss": HLGauss(), "algorithm": ALGORITHMS["a2c"]()}
"""The parts of an agent that have to be named."""


def test_an_agent_of_parts_has_the_usual_ones_where_none_are_named():
    assert Agent(**THREE) == read({}) == make_agent()
    assert Agent(**THREE, rollout=Rollout(n_steps=5)) == read({"n_steps": 5})


WRONG = (None, "hl-gauss", HLGauss, Narrow(), Rollout())


@pytest.mark.parametrize(
    ("field", "kind", "wrong"),
    [
        (field, kind, wrong)
        for field, kind in ((field, annotations(Agent)[field]) for field in KINDS)
        for wrong in WRONG
        if not isinstance(wrong, kind)
    ],
)
def test_an_agent_refuses_another_kind_of_part_by_its_field(field, kind, wrong):
    message = f"^{field} is {re.escape(repr(wrong))}; it must be of type {kind.__name__}$"
    with pytest.raises(UsageError, match=message):
        Agent(**THREE | {field: wrong})
    with pytest.raises(UsageError, match=message):
        read({}).replace(**{field: wrong})


def test_an_agent_refuses_parts_that_do_not_fit_together():
    for field, part, message in (
        ("policy", GaussianPolicy(), "policy is 'gaussian', but the loss 'hl-gauss' needs a histogram; choose from hi"),
        ("algorithm", ALGORITHMS["ppo"](), "batch_size is 64"),
        ("critic", CHOICES["critic"].registry["hl-gauss"](), "set normalize_reward, or value_min"),
    ):
        with pytest.raises(UsageError, match=re.escape(message)):
            Agent(**THREE | {field: part})


def test_arrays_of_jax_are_checked_as_numbers_are():
    with pytest.raises(UsageError, match=r"learning_rate is -0.001.*; it must be finite, and"):
        make_agent(learning_rate=jnp.array([1e-3, -1e-3]))
    with pytest.raises(UsageError, match="batch_size is 48"):
        make_agent(algorithm="ppo", n_steps=32, n_envs=2, batch_size=48, learning_rate=jnp.float32(1e-3))
    made = make_agent(learning_rate=jnp.float32(1e-3))
    assert float(made.optimizer.learning_rate) == pytest.approx(1e-3)
    assert made.optimizer == make_agent(learning_rate=np.float32(1e-3)).optimizer
