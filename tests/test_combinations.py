"""Policy, loss and algorithm are three choices: whatever fits trains on both engines, and nothing else does."""

import itertools

import jax
import numpy as np
import pytest

from galton import ALGORITHMS, LOSSES, POLICIES, Model, UsageError
from galton.envs import Bandit
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.study import Setting

from .agents import agent

SETTINGS = {"n_bins": 7, "net_arch": (6,), "n_steps": 8, "n_envs": 2, "learning_rate": 1e-2}
OWN = {
    "ppo": {"batch_size": 4, "n_epochs": 2},
    "trpo": {"batch_size": 4, "n_critic_updates": 2},
    "v-mpo": {"batch_size": 4, "n_epochs": 2},
}
"""What an algorithm needs for rollouts of this size."""
ALL = list(itertools.product(POLICIES, LOSSES, ALGORITHMS))
ON_THE_HOST = ("ordinal", "hl-gauss-centred", "ppo"), ("gaussian", "gaussian", "a2c")
"""What is tried on the host without being slow: there the update is the device's, and only who samples is another."""


def resolved(policy, loss, algorithm):
    return agent({"policy": policy, "loss": loss, "algorithm": algorithm, "n_steps": 8, **OWN.get(algorithm, {})})


def fits(policy, loss, algorithm):
    try:
        resolved(policy, loss, algorithm)
    except UsageError:
        return False
    return True


QUICK = [
    *itertools.product(("gaussian", "rpo"), ["gaussian"], ["ppo"]),
    *itertools.product(("histogram", "ordinal"), ["hl-gauss-centred"], ["ppo"]),
    ("smoothed", "hl-one-hot", "ppo"),
    ("histogram", "hl-gauss", "trpo"),
    ("discretised-gaussian", "hl-one-hot", "v-mpo"),
]
"""What is tried on the device without being slow."""


def marked(combinations):
    return [pytest.param(names, marks=[] if names in QUICK else pytest.mark.slow) for names in combinations]


FITTING = [names for names in ALL if fits(*names)]
REFUSED = [names for names in ALL if names not in FITTING]
LOSSES_OF = {policy: [loss for loss in LOSSES if (policy, loss, "ppo") in FITTING] for policy in POLICIES}
PAIRS = [
    (policy, loss, algorithm)
    for (i, (policy, losses)), (k, algorithm) in itertools.product(enumerate(LOSSES_OF.items()), enumerate(ALGORITHMS))
    for j, loss in enumerate(losses)
    if (policy, loss, algorithm) in FITTING and (len(losses) == 1 or (i + j + k) % 2)
]
"""Every policy with every loss that fits it, every policy with every algorithm and every loss with every algorithm."""
ONE_OF_EACH = [names for names in PAIRS if names[1] == LOSSES_OF[names[0]][-1]]


def test_the_pairs_are_all_there():
    for i, j in itertools.combinations(range(3), 2):
        assert {(names[i], names[j]) for names in PAIRS} == {(names[i], names[j]) for names in FITTING}
    assert {names[0] for names in ONE_OF_EACH} == set(POLICIES)


def test_a_density_loss_fits_every_policy_and_a_histogram_loss_every_histogram():
    assert len(ALL) == len(POLICIES) * len(LOSSES) * len(ALGORITHMS)
    histograms = {name for name, policy in POLICIES.items() if policy.family == "histogram"}
    assert {"histogram", "ordinal", "smoothed"} <= histograms < set(POLICIES)
    for loss, entry in LOSSES.items():
        expected = set(POLICIES) if entry.family == "density" else histograms
        for algorithm in ALGORITHMS:
            bounds = algorithm in ("trpo", "v-mpo")
            fitting = {name for name in expected if POLICIES[name].has_kl or not bounds}
            assert {one for one, *rest in FITTING if rest == [loss, algorithm]} == fitting


@pytest.mark.parametrize("names", REFUSED, ids="-".join)
def test_what_does_not_fit_is_refused_by_name_with_what_would(names):
    policy, loss, algorithm = names
    wanted = ", ".join(one for one in POLICIES if (one, loss, algorithm) in FITTING)
    needs = f"policy is {policy!r}, but the loss {loss!r} needs a histogram; choose from {wanted}"
    if LOSSES[loss].family == "density":
        needs = f"policy is {policy!r}, which has no KL divergence for .* to bound; choose from {wanted}"
    with pytest.raises(UsageError, match=needs):
        resolved(*names)
    with pytest.raises(UsageError, match=needs):
        Model("bandit", loss, algorithm=algorithm, policy=policy, **SETTINGS, **OWN.get(algorithm, {}))


def check_training(env, policy, loss, algorithm):
    own, logs = OWN.get(algorithm, {}), []
    model = Model(env, loss, algorithm=algorithm, policy=policy, **SETTINGS, **own, seed=1)
    try:
        assert type(model.agent.policy) is POLICIES[policy]
        assert type(model.agent.loss) is LOSSES[loss]
        assert type(model.agent.algorithm) is ALGORITHMS[algorithm]
        before = jax.device_get(model.learner.params)
        model.learn(48, lambda _, log: logs.append(log), progress_bar=False, log_interval=1)
        after = jax.device_get(model.learner.params)
        action, _ = model.predict(np.zeros(model.observation_space.shape, np.float32))
    finally:
        model.close()
    for old, new in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        assert np.isfinite(new).all()
        assert (old != new).any() or not old.size  # one dimension is correlated with none
    assert model.action_space.contains(action)
    told = ("entropy", "sigma", "actor_grad_norm", "explained_variance", *ALGORITHMS[algorithm].scalars)
    assert len(logs) == 3
    for log in logs:
        for name in told:
            assert np.isfinite(log[f"train/{name}"]), name
        assert log["train/grad_norm"] > 0
        assert log["train/sigma"] > 0


@pytest.mark.few
@pytest.mark.parametrize("names", marked(list(dict.fromkeys([*QUICK, *PAIRS]))), ids="-".join)
def test_what_fits_trains_on_the_device(names):
    check_training(Bandit(d=2), *names)


@pytest.mark.few
@pytest.mark.parametrize(
    "names",
    [
        pytest.param(n, marks=[] if n in ON_THE_HOST else pytest.mark.slow)
        for n in dict.fromkeys([*ON_THE_HOST, *ONE_OF_EACH])
    ],
    ids="-".join,
)
def test_what_fits_trains_on_the_host(names):
    check_training("Pendulum-v1", *names)


@pytest.mark.parametrize("loss", LOSSES)
def test_the_policy_is_by_default_the_losss_usual_one(loss):
    agents = [resolved(policy, loss, "a2c") for policy in ("auto", LOSSES[loss].policy)]
    assert agents[0] == agents[1]
    assert type(agents[0].policy) is POLICIES[LOSSES[loss].policy]


def test_unknown_names_are_refused_with_the_known_ones():
    for names, message in (
        (
            ("laplace", "gaussian", "a2c"),
            "policy is 'laplace'; choose from auto, gaussian, histogram, ordinal, smoothed",
        ),
        (("auto", "l2", "a2c"), "loss is 'l2'; choose from gaussian, hl-one-hot, hl-gauss, hl-gauss-centred"),
        (("auto", "gaussian", "acer"), "algorithm is 'acer'; choose from a2c, ppo, trpo, v-mpo"),
    ):
        with pytest.raises(UsageError, match=message):
            resolved(*names)


IDLE = [
    (
        {"loss": "gaussian", "target_tails": "edges"},
        "target_tails is 'edges'; it goes with .*loss 'hl-gauss', 'hl-gauss-",
    ),
    ({"loss": "gaussian", "rpo_alpha": 0.1}, "rpo_alpha is 0.1; it goes with policy 'rpo', not 'gaussian'"),
    ({"loss": "gaussian", "policy": "beta", "log_std_init": -1.0}, "log_std_init is -1.0; it goes with .*, not 'beta'"),
]


@pytest.mark.parametrize(("given", "message"), IDLE)
def test_a_setting_that_has_no_use_is_refused_by_name(given, message):
    with pytest.raises(UsageError, match=message):
        Model("bandit", **given, **SETTINGS)
    with pytest.raises(UsageError, match=message):
        Setting(given)


USED = [
    {"loss": "hl-one-hot", "bin_centers": "bounds", "initial_policy": "clipped-gaussian"},
    {"loss": "hl-gauss", "target_tails": "edges", "policy": "ordinal"},
    {"loss": "hl-one-hot", "target_tails": "edges", "policy": "smoothed"},
    {"loss": "gaussian", "policy": "rpo", "rpo_alpha": 0.1},
    {"loss": "gaussian", "policy": "squashed-gaussian", "log_std_init": -1.0, "log_std_min": -3.0},
    {"loss": "gaussian", "policy": "beta", "box_units": 1.0},  # in whose units it is anyway
    {"loss": "gaussian", "initial_policy": "gaussian"},  # which has no use either, but files may have it
]


@pytest.mark.parametrize("given", USED)
def test_a_setting_that_has_one_is_taken(given):
    setting = Setting(given)
    assert all(setting.record()[name] == value for name, value in given.items())
    agent(setting.replace(n_steps=8).record())


def test_results_of_a_policy_that_is_not_registered_here_can_be_read():
    for settings in (
        [Setting({"loss": "gaussian", "policy": "somebodys"})],
        expand([{}], {"policy": "somebodys"}),
    ):
        assert settings[0]["policy"] == "somebodys"


@pytest.mark.parametrize(
    "policy", [pytest.param(name, marks=[] if name == "rpo" else pytest.mark.slow) for name in POLICIES]
)
def test_a_model_of_any_policy_goes_on_exactly_from_its_file(policy, tmp_path):
    loss = "gaussian" if POLICIES[policy].family == "density" else "hl-one-hot"
    model = Model("bandit", loss, algorithm="ppo", policy=policy, **SETTINGS, **OWN["ppo"], seed=1)
    model.learn(32, progress_bar=False)
    again = Model.load(model.save(tmp_path / "model"), "bandit")
    for one in (model, again):
        one.learn(32, progress_bar=False)
    for ours, theirs in zip(*(jax.tree.leaves(one.learner.params) for one in (model, again)), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    seen = np.zeros((3, *model.observation_space.shape), np.float32)
    assert np.isfinite(again.predict(seen)[0]).all()
