"""Schedules against Optax's, in a run, in files and on the command line."""

import functools
import json
import math
from typing import Literal

import jax
import numpy as np
import optax
import pytest

import galton
from galton import A2C, PPO, UsageError, make_agent, schedules
from galton.agents import read, words_of
from galton.callbacks import Checkpoint
from galton.parts import at
from galton.schedules import Cosine, Linear, Step
from galton.types import Count, Finite
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.results import collect
from galton_experiments.sweep.shard import work
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Setting, Study

SMALL = {"n_bins": 9, "net_arch": (8,), "loss": "hl-gauss"}


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (Linear(0.3, 0.1, 100), optax.linear_schedule(0.3, 0.1, 100)),
        (Linear(0.3, 0.1, 100, 50), optax.linear_schedule(0.3, 0.1, 100, transition_begin=50)),
        (Cosine(0.3, 0.03, 100), optax.cosine_decay_schedule(0.3, 100, alpha=0.1)),
        (Step(0.3, 0.1, 60), optax.piecewise_constant_schedule(0.3, {60: 1 / 3})),
        (
            Step(Linear(0.0, 0.3, 20), Cosine(0.3, 0.0, 80, 20), 20),
            optax.warmup_cosine_decay_schedule(0.0, 0.3, 20, 100),
        ),
    ],
)
def test_a_number_at_each_step_is_optaxs(ours, theirs):
    for step in (0, 1, 19, 20, 21, 50, 59, 60, 99, 100, 150, 10**6):
        assert float(ours(step)) == pytest.approx(float(theirs(step)), abs=1e-6), step


@pytest.mark.parametrize("kind", [Linear, Cosine])
def test_it_begins_and_ends_at_its_numbers_exactly(kind):
    for start, end in ((1.0, 1e-8), (1e-8, 1.0), (16.0, 0.01), (0.99, 1e-3)):
        assert [float(kind(start, end, 1000.0, 8.0)(step)) for step in (0, 8, 1008, 2000)] == [
            *[float(np.float32(start))] * 2,
            *[float(np.float32(end))] * 2,
        ]


@pytest.mark.parametrize(
    "schedule",
    [
        Linear(3e-4, 0.0),
        Cosine(1e-3, 1e-4, 1e6, 10.0),
        Step(Linear(0.0, 1e-3, 10.0), 1e-4, 500.0),
        Step(-math.inf, -3.0, 1000.0),
        functools.reduce(lambda before, i: Step(before, 1e-3 / i, 1e4 * i), range(1, 61), 1e-3),
    ],
)
def test_a_schedule_comes_back_from_its_text(schedule):
    assert schedules.read("learning_rate", schedules.told(schedule)) == schedule


class Stairs(schedules.Schedule):
    label = "stairs"

    start: Finite = 0.0
    n_stairs: Count = 4
    kind: Literal["even", "uneven"] = "even"
    is_up: bool = False

    def values(self):
        return (self.start,)

    def __call__(self, step):
        return self.start / (1 + step // self.n_stairs)


def test_one_of_ones_own_may_have_fields_and_a_name_of_any_kind(monkeypatch, tmp_path):
    rate = Stairs(0.1, 7, "uneven", True)
    model = A2C("bandit", "gaussian", learning_rate=rate)
    with pytest.raises(UsageError, match="give its class a line in the registry"):
        model.learn(5, Checkpoint(tmp_path / "kept", every=5), progress_bar=False)
    assert model.num_timesteps == 0
    monkeypatch.setitem(schedules.SCHEDULES, "stair-case", Stairs)
    assert schedules.told(rate) == "stair_case(0.1, 7, 'uneven', True)"
    assert schedules.read("learning_rate", schedules.told(rate)) == rate
    with pytest.raises(UsageError, match=r"is 'stair_case\(0.1, -7\)', whose n_stairs is -7; it must be"):
        schedules.read("learning_rate", "stair_case(0.1, -7)")


@pytest.mark.parametrize(
    "text",
    [
        "0.1",
        "0.1x",
        "linear",
        "linear(",
        "linear(a)",
        "cubic(1, 2)",
        "linear(1, 2, 3, 4, 5)",
        "__import__('os')",
        "1(2)",
    ],
)
def test_a_text_that_describes_none_is_refused_with_what_would(text):
    with pytest.raises(UsageError, match=r"^learning_rate is .*must be a number, or a schedule such as"):
        read({"learning_rate": text})


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"learning_rate": Linear(1.0, -1.0)}, "a number of learning_rate is -1.0; it must be finite, and 0 or more"),
        ({"learning_rate": "linear(1, 0, 0)"}, r"learning_rate is 'linear\(1, 0, 0\)', whose steps is 0"),
        ({"decay_steps": Linear(1.0, 2.0)}, "decay_steps is Linear.*; give one number"),
        ({"learning_rate": "step(1, 0, linear(0, 9, 9))"}, r"learning_rate is 'step\(.*\)', whose at_step is"),
        ({"learning_rate": Linear(1.0, 0.0), "decay_steps": 9}, "decay_steps is 9.0 beside a schedule"),
        ({"policy": "smoothed", "eta": Linear(1.0, 0.5)}, "eta is Linear.*; say over how many steps"),
        ({"n_bins": Linear(10, 20)}, "n_bins is Linear.*; it must be an integer"),
        ({"eta": Step(1.0, 0.0, 5)}, "a number of eta is 0.0"),
    ],
)
def test_what_no_schedule_can_be_is_refused(words, message):
    with pytest.raises(UsageError, match=f"^{message}"):
        make_agent(**words)


def test_an_agents_numbers_at_a_step_and_its_words():
    agent = make_agent(**SMALL, eta=Linear(2.0, 0.5, 100), learning_rate=Cosine(1e-2, 0.0, 100))
    assert float(at(agent, 50).loss.eta) == 1.25
    assert float(at(agent, 50).optimizer.learning_rate) == pytest.approx(5e-3)
    assert read(words_of(agent)) == agent


@pytest.mark.slow
@pytest.mark.parametrize("env", ["lqr", "Pendulum-v1"])
def test_a_constant_schedule_is_the_number_and_one_that_changes_is_not(env):
    own = {"learning_rate": 1e-2, "eta": 2.0, "gamma": 0.9}
    plain, constant, other = (
        A2C(env, **SMALL, **words, n_steps=10).learn(40, progress_bar=False)
        for words in (
            own,
            {name: Linear(value, value, 20) for name, value in own.items()},
            {name: Linear(value, value / 2, 20) for name, value in own.items()},
        )
    )
    for ours, theirs in zip(jax.tree.leaves(plain.learner), jax.tree.leaves(constant.learner), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6)
    assert not np.allclose(plain.get_parameters()["actor"][0]["kernel"], other.get_parameters()["actor"][0]["kernel"])


@pytest.mark.slow
def test_a_function_of_what_remains_is_understood_where_it_is_linear():
    model = PPO(
        "lqr", "gaussian", n_steps=64, learning_rate=lambda left: 1e-3 * left, clip_range=lambda left: 0.2 * left
    )
    assert model.settings["learning_rate"] == Linear(1e-3, 0.0)
    assert model.settings["clip_range"] == Linear(0.2, 0.0)
    assert PPO("lqr", "gaussian", n_steps=64, clip_range=lambda _: 0.1).settings["clip_range"] == 0.1
    rates = []
    model.learn(256, lambda _, log: rates.append(log["train/learning_rate"]) and None, progress_bar=False)
    np.testing.assert_allclose(rates, [7.5e-4, 5e-4, 2.5e-4, 0.0], atol=1e-9)  # as SB3's
    with pytest.raises(
        UsageError, match=r"^learning_rate is <function .*is understood if it is linear; write another as"
    ):
        PPO("lqr", "gaussian", learning_rate=lambda left: 1e-3 * left**2)


@pytest.mark.slow
def test_a_schedule_is_a_point_of_a_sweep(tmp_path):
    grid = expand([SMALL | {"learning_rate": [1e-3, "linear(1e-2, 0)", "linear(1e-2, 0, inf)"]}], {})
    assert len(grid) == 2  # the last two are one
    store = Store(str(tmp_path))
    plan = Plan.create(Study("lqr", grid, 2, 40, logs=1, eval_episodes=0))
    plan.save(store)
    assert Plan.load(store).study.settings == grid
    assert plan.n_shards == 2
    for index in range(2):
        work(store.url, index)
    told = collect(store, Plan.load(store)).column("setting.learning_rate").to_pylist()
    assert told == ["0.001"] * 2 + ["linear(0.01, 0.0, inf, 0.0)"] * 2
    assert Setting(grid[1].record()).name == grid[1].name
    assert json.loads(json.dumps(grid[1].record()))["learning_rate"] == told[-1]


@pytest.mark.parametrize(
    "points",
    [
        {"learning_rate": "linear(1e-2, 0)"},
        {"algorithm": "ppo", "n_steps": 20, "batch_size": [5, 10], "n_epochs": [1, 2], "ratio": ["auto", "true"]},
        {"network": "simba", "simba_width": [4, 8]},
        {"net_arch": [[4], [8]], "critic_arch": [[4], []]},
        {"resets": "pool", "reset_pool": [4, 8]},
        {"optimizer": "adamw", "weight_decay": [0.1, "linear(0.1, 0)"]},
        {"entropy_target": True, "entropy_rate": [0.1, "step(0.1, 0.2, 50)"]},
        {"weighting": "awr", "temperature": [0.5, 2]},
    ],
)
def test_a_study_comes_back_from_its_record_whatever_it_varies(points):
    study = Study("lqr", expand([{"loss": "hl-gauss", "n_bins": 9} | points], {}), 1, 40)
    again = Study.of_record(json.loads(json.dumps(study.record())))
    assert again == study
    assert [setting.name for setting in again.settings] == [setting.name for setting in study.settings]
    assert all(setting.brief() for setting in study.settings)
    Plan.create(study)


def test_a_presets_decay_gives_way_to_a_schedule_that_is_given():
    for rate in (Linear(3e-4, 0.0), "linear(3e-4, 0)", lambda left: 3e-4 * left):
        assert PPO("lqr", learning_rate=rate).settings["learning_rate"] == Linear(3e-4, 0.0)
    with pytest.raises(UsageError, match=r"^decay_steps is 10\.0 beside a schedule"):
        PPO("lqr", learning_rate=Linear(3e-4, 0.0), decay_steps=10)


def test_an_endless_schedule_keeps_its_own_beginning():
    spread = Linear(1.0, 0.0, begin=100).over(0, 200)
    assert [float(spread(step)) for step in (0, 100, 150, 200)] == [1.0, 1.0, 0.5, 0.0]


def test_a_call_that_learns_nothing_says_so():
    model = A2C("bandit", **SMALL, n_steps=8, learning_rate=Linear(1e-2, 0.0, 16))
    model.learn(8, progress_bar=False)
    with pytest.warns(UserWarning, match=r"^learning_rate is Linear.*, 0 from step 8 to 16, so nothing is learnt"):
        model.learn(8, progress_bar=False)


@pytest.mark.slow
def test_a_list_of_numbers_is_one_for_each_run():
    agent = make_agent(**SMALL, n_steps=8, eta=[1.0, 2.0], learning_rate=Linear([1e-2, 1e-3], 0.0))
    assert galton.train("bandit", agent, [0, 1], 8, n_eval_episodes=0).agent.loss.eta.tolist() == [1.0, 2.0]
    with pytest.raises(UsageError, match=r"^learning_rate\.start is .*; give one number"):
        A2C("lqr", **SMALL, learning_rate=Linear([1e-2, 1e-3], 0.0))


def test_infinity_stays_what_it_is_where_it_is_no_schedule():
    assert make_agent(algorithm="ppo", target_kl=math.inf).algorithm.target_kl == math.inf
