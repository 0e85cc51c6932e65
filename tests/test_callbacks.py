import errno
import functools
import json
import math
import os
import sys
import types

import jax.numpy as jnp
import numpy as np
import pytest

from galton import A2C, UsageError
from galton.callbacks import (
    Checkpoint,
    Evaluate,
    JSONLines,
    StopAfter,
    StopOnReward,
    TensorBoard,
    WeightsAndBiases,
)
from galton.training.yardsticks import Yardsticks

from .envs.host.walks import Closing, Walk

SB3_NAMES = {
    "rollout/ep_rew_mean",
    "rollout/ep_len_mean",
    "time/total_timesteps",
    "time/time_elapsed",
    "time/fps",
    "train/explained_variance",
    "train/policy_loss",
    "train/value_loss",
}


@pytest.fixture(scope="module")
def model():
    return A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10)


def learn(model, callback, updates=10, log_interval=2):
    """From the start of a log interval."""
    assert model.num_timesteps % (10 * log_interval) == 0
    first = model.num_timesteps
    model.learn(10 * updates, callback, progress_bar=False, log_interval=log_interval)
    return model.num_timesteps - first


class Fake:
    """A model whose evaluations are given."""

    def __init__(self, *means):
        self.num_timesteps, self.means, self.saved, self.n_yardsticks = 0, list(means), [], 0

    def evaluate(self, n_episodes, env, env_kwargs):
        assert (n_episodes, env) == (2, "other")
        mean = self.means.pop(0)
        return np.array([mean - 1, mean + 1])

    def yardsticks(self, env, env_kwargs):
        assert env == "other"
        self.n_yardsticks += 1
        return Yardsticks(-1.0, -2.5)

    def save(self, path):
        self.saved.append((str(path), self.num_timesteps))

    def take(self):
        return types.SimpleNamespace(scored=lambda mean: self)

    def log_points(self, callback, n):
        for _ in range(n):
            self.num_timesteps += 20
            log = {}
            assert callback(self, log) is not False
            yield log


def test_the_log_comes_at_every_interval_under_the_names_of_sb3(model):
    steps, logs, first = [], [], model.num_timesteps
    learn(model, [lambda model, log: steps.append(model.num_timesteps - first), lambda model, log: logs.append(log)])
    assert steps == [20, 40, 60, 80, 100]
    assert [log["time/total_timesteps"] - first for log in logs] == steps
    assert set(logs[0]) >= SB3_NAMES
    assert {name.split("/")[0] for name in logs[0]} == {"rollout", "time", "train"}
    assert math.isnan(logs[0]["rollout/ep_rew_mean"]) or logs[0]["rollout/n_episodes"] > 0
    assert logs[4]["rollout/ep_len_mean"] == 100
    assert all(type(value) in (int, float) for log in logs for value in log.values())
    assert all(log["time/fps"] > 0 for log in logs)


def test_log_points_do_not_depend_on_how_training_is_cut_but_for_the_ends():
    def numbers(cuts):
        run, logs = A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10), {}
        for updates in cuts:
            run.learn(updates * 10, lambda model, log: logs.update({model.num_timesteps: log}), 2, progress_bar=False)
        return {step: {name: log[name] for name in log if name.split("/")[0] != "time"} for step, log in logs.items()}

    whole, cut = numbers([10]), numbers([1, 2, 2, 5])
    assert [*whole] == [20, 40, 60, 80, 100]
    assert [*cut] == [10, 20, 30, 40, 50, 60, 80, 100]
    for step, log in whole.items():
        np.testing.assert_equal(cut[step], log)


def test_the_end_of_learn_is_a_log_point_of_the_updates_since_the_last(model):
    logs, first = [], model.num_timesteps
    model.learn(50, lambda model, log: logs.append(log), progress_bar=False, log_interval=100)
    assert [log["time/total_timesteps"] for log in logs] == [first + 50]
    assert math.isfinite(logs[0]["train/policy_loss"])
    model.learn(50, None, progress_bar=False, log_interval=100)  # to where the log intervals of the others begin


class Timed:
    """A callback that names steps; it may add to the log, or stop."""

    def __init__(self, every, adds=None, stops=False):
        self.every, self.adds, self.stops, self.steps = every, adds, stops, []

    def __call__(self, model, log):
        self.steps.append(model.num_timesteps)
        log |= self.adds or {}
        return not self.stops


@pytest.mark.parametrize(
    ("every", "steps"),
    [(1, [*range(10, 101, 10)]), (15, [20, 30, 50, 60, 80, 90]), (40, [40, 80]), (70, [70]), (95, [100]), (100, [100])],
)
@pytest.mark.parametrize("log_interval", [1, 3, 1000])
def test_what_names_steps_is_called_at_them_whatever_the_log_interval(every, steps, log_interval):
    run, timed, more = A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10), Timed(every), Timed(30)
    run.learn(100, [timed, more], progress_bar=False, log_interval=log_interval)
    assert timed.steps == steps
    assert more.steps == [30, 60, 90]


def test_what_names_steps_counts_them_from_the_start_of_the_run_through_every_learn():
    run, timed = A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10), Timed(30)
    run.learn(20, progress_bar=False)
    for _ in range(2):
        run.learn(40, timed, progress_bar=False)
    assert timed.steps == [30, 60, 90]


def test_one_that_adds_to_the_log_makes_a_log_point_for_those_behind_it_alone():
    run, seen = A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10), {"before": [], "behind": []}
    callbacks = [
        lambda model, log: seen["before"].append((model.num_timesteps, log.get("a"))),
        Timed(20),
        Timed(30, {"a": 1.0}),
        lambda model, log: seen["behind"].append((model.num_timesteps, log.get("a"))),
    ]
    run.learn(60, callbacks, progress_bar=False, log_interval=4)
    assert seen["before"] == [(40, None), (60, None)]
    assert seen["behind"] == [(30, 1.0), (40, None), (60, 1.0)]


@pytest.mark.parametrize("at", [0, 1, 2])
def test_the_end_is_logged_by_all_wherever_the_one_that_stops_stands(at):
    run, steps = A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10), [[], []]
    callbacks = [lambda model, log, own=own: own.append(model.num_timesteps) for own in steps]
    callbacks.insert(at, Timed(30, stops=True))
    run.learn(100, callbacks, progress_bar=False, log_interval=1000)
    assert steps == [[30], [30]]


REFUSED = [
    (lambda folder: Evaluate(50, env="NoSuchEnvironment-v0"), "NoSuchEnvironment-v0"),
    (lambda folder: Evaluate(50, env="mountain-car"), "env has actions"),
    (lambda folder: Evaluate(50, env=7), "env"),
    (lambda folder: Evaluate(50, best_model=""), "best_model is '.', which names no file"),
    (lambda folder: Evaluate(50, best_model=folder / "file" / "best"), "best_model is .*which can't be written"),
    (lambda folder: Checkpoint(folder / "file" / "run", every=50), "path is .*which can't be written"),
    (lambda folder: Evaluate(101), "every of Evaluate is"),
    (lambda folder: Checkpoint("never"), "every of Checkpoint is"),
    *((lambda folder, n=n: Timed(n), "every of Timed is") for n in (1000, 0, 2.5, "often", True)),
    (lambda folder: lambda: None, "can't be called as callback"),
    (lambda folder: lambda model: None, "can't be called as callback"),
    (lambda folder: lambda model, log, more: None, "can't be called as callback"),
    (lambda folder: lambda locals_, globals_: None, "take the model and the log"),
    (lambda folder: lambda _locals, _globals: None, "take the model and the log"),
    (lambda folder: 3, "must be callable"),
    (lambda folder: ["evaluate"], "must be callable"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED)
def test_what_could_only_fail_later_is_refused_before_training(make, message, tmp_path):
    (tmp_path / "file").touch()
    run = A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10)
    with pytest.raises(UsageError, match=message):
        run.learn(100, make(tmp_path), progress_bar=False)
    assert run.num_timesteps == 0


def test_callbacks_are_called_in_order_and_share_the_log(model):
    seen = []
    learn(model, [lambda model, log: log.update(a=1.0), lambda model, log: seen.append(log["a"])], updates=4)
    assert seen == [1.0, 1.0]


def test_a_step_in_a_log_is_the_model_s_also_where_a_callback_trains_it():
    run, steps = A2C("lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10), []

    def train(model, log):
        if not steps:
            model.learn(20, progress_bar=False)

    run.learn(100, [train, lambda model, log: steps.append(log["time/total_timesteps"])], 2, progress_bar=False)
    assert steps == [40, 60, 80, 100] == [*range(40, run.num_timesteps + 1, 20)]


def test_false_stops_at_that_log_point_after_the_others_and_none_and_true_do_not(model):
    calls = []
    stop = [lambda model, log: len(calls) < 2, lambda model, log: calls.append(1)]
    assert learn(model, stop) == 60
    assert len(calls) == 3
    assert learn(model, lambda model, log: True) == 100
    assert learn(model, lambda model, log: None) == 100
    for verdict in (False, np.bool_(False), jnp.array(False)):
        assert learn(model, lambda model, log, verdict=verdict: verdict) == 20
    assert learn(model, [Evaluate(20, 1), StopOnReward(-1e9)]) == 20
    model.learn(20, progress_bar=False)


def test_evaluate_keeps_the_best_model_exactly_when_the_mean_improves():
    fake = Fake(-5.0, -7.0, -5.0, -4.0, float("nan"))
    logs = list(fake.log_points(Evaluate(40, 2, "other", "best"), 5))
    assert fake.saved == [("best", 20), ("best", 80)]
    assert [log["eval/mean_reward"] for log in logs[:4]] == [-5.0, -7.0, -5.0, -4.0]
    assert [log["eval/best_mean_reward"] for log in logs] == [-5.0, -5.0, -5.0, -4.0, -4.0]
    assert logs[0]["eval/std_reward"] == 1.0


def test_a_new_evaluate_knows_the_best_model_that_the_same_run_kept(tmp_path, monkeypatch):
    means, best = iter([-5.0, -7.0, -4.0, -9.0]), tmp_path / "best"
    monkeypatch.setattr(A2C, "evaluate", lambda self, n_episodes, *_: np.full(n_episodes, next(means)))

    def learnt(model):
        logs = []
        model.learn(20, [Evaluate(20, best_model=best), lambda model, log: logs.append(log)], progress_bar=False)
        return logs[0]["eval/best_mean_reward"], A2C.load(best).num_timesteps

    new = functools.partial(A2C, "lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10)
    run = new()
    assert learnt(run) == (-5.0, 20)
    run = A2C.load(run.save(tmp_path / "last"), "lqr")
    assert learnt(run) == (-5.0, 20), "a worse one is not kept"
    assert learnt(run) == (-4.0, 60)
    assert learnt(new()) == (-9.0, 20), "a new run begins anew"


def test_one_evaluate_begins_anew_with_a_new_run_and_another_seeds_best_is_not_its_own(tmp_path, monkeypatch):
    means = iter([-5.0, -7.0])
    monkeypatch.setattr(A2C, "evaluate", lambda self, n_episodes, *_: np.full(n_episodes, next(means)))
    new = functools.partial(A2C, "lqr", "hl-gauss", n_bins=10, net_arch=(8,), n_steps=10)
    evaluate, logs = Evaluate(20, best_model=tmp_path / "best"), []
    for seed in (0, 1):
        model = new(seed=seed).learn(20, [evaluate, lambda model, log: logs.append(log)], progress_bar=False)
    assert [log["eval/best_mean_reward"] for log in logs] == [-5.0, -7.0]
    assert all("eval/doing_nothing" in log for log in logs)
    assert A2C.load(tmp_path / "best").seed == 1
    evaluate.best = 0.0
    evaluate.check(model)
    assert evaluate.best == 0.0, "the same run"
    evaluate.check(new(seed=2).learn(20, progress_bar=False))
    assert evaluate.best == -math.inf, "another one that has been trained"
    model.seed = 0
    evaluate = Evaluate(20, best_model=tmp_path / "best")
    evaluate.check(model)
    assert evaluate.best == -math.inf


def test_an_environment_to_evaluate_on_is_made_once_and_closed():
    made = []

    def make():
        made.append(Closing())
        return made[-1]

    model, log = A2C(Walk, "gaussian", net_arch=(4,)), {}
    for source, n_copies in ((make, 2), (Walk(), 1)):
        callback = Evaluate(20, n_copies, source)
        callback.check(model)
        for _ in range(2):
            callback(model, log)
        assert log["eval/mean_reward"] == model.evaluate(n_copies, source).mean()
        callback.end(model)
    assert [env.closed for env in made] == [1] * 4  # two for the callback, and two for the model


def test_evaluation_on_a_model_agrees_with_the_file_of_the_best(model, tmp_path):
    logs = []
    learn(model, [Evaluate(20, 3, best_model=tmp_path / "best"), lambda model, log: logs.append(log)], updates=6)
    best = max(log["eval/mean_reward"] for log in logs)
    assert [log["eval/best_mean_reward"] for log in logs][-1] == best
    at = next(log["time/total_timesteps"] for log in logs if log["eval/mean_reward"] == best)
    assert A2C.load(tmp_path / "best").num_timesteps == at


def test_checkpoints_are_kept_by_step_or_written_over(model, tmp_path):
    first = model.num_timesteps
    learn(model, [Checkpoint(tmp_path / "run-{step}", every=20), Checkpoint(str(tmp_path / "last"), every=20)], 4)
    Checkpoint(tmp_path / "{step}" / "model").check(model)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {f"run-{first + 20}.safetensors", f"run-{first + 40}.safetensors", "last.safetensors"}
    assert A2C.load(tmp_path / "last").num_timesteps == first + 40
    assert A2C.load(tmp_path / f"run-{first + 20}").num_timesteps == first + 20


def test_stop_on_reward_stops_at_the_threshold_and_passes_over_what_is_not_known():
    stop = StopOnReward(-3.0)
    values = ({}, True), ({"eval/mean_reward": -3.1}, True), ({"eval/mean_reward": float("nan")}, True)
    for log, go_on in (*values, ({"eval/mean_reward": -3.0}, False)):
        assert stop(Fake(), log) is go_on
    assert StopOnReward(1.0, "other")(Fake(), {"other": 2.0}) is False


@pytest.mark.parametrize(
    "callbacks",
    [[StopOnReward(-1e9)], [StopOnReward(-1e9), Evaluate(20, 1)], [Evaluate(20, 1), StopOnReward(0.0, "eval/mean")]],
    ids=["no evaluation", "before it", "misspelt"],
)
def test_a_stop_that_never_saw_its_number_says_so(model, callbacks):
    with pytest.warns(UserWarning, match="which was in no log, so StopOnReward could not stop"):
        assert learn(model, callbacks) == 100


def test_stop_after_counts_from_the_beginning_of_each_learn(model):
    stop = StopAfter(10.0)
    for elapsed in (1.0, 9.9, 10.0, 1.0):
        assert stop(Fake(), {"time/time_elapsed": elapsed}) is (elapsed < 10)
    assert learn(model, StopAfter(1e-9), log_interval=1) == 10  # after the first update
    model.learn(10, progress_bar=False)
    assert learn(model, StopAfter(1e9)) == 100


def test_json_lines_are_appended_with_null_for_what_is_not_known(model, tmp_path):
    path, logs = tmp_path / "folder" / "log.jsonl", []
    path.parent.mkdir()
    path.write_text('{"old": 1}\n')
    learn(model, [JSONLines(path), lambda model, log: logs.append(log)], updates=4)
    lines = path.read_text().splitlines()
    assert lines[0] == '{"old": 1}'

    def refuse(constant):
        raise AssertionError(constant)

    for line, log in zip(lines[1:], logs, strict=True):
        read = json.loads(line, parse_constant=refuse)
        assert read == {name: value if math.isfinite(value) else None for name, value in log.items()}
    JSONLines(path)(Fake(), {"a": math.nan, "b": -math.inf, "c": np.float32(2)})
    assert json.loads(path.read_text().splitlines()[-1]) == {"a": None, "b": None, "c": 2}


def test_tensorboard_reads_back_what_was_logged(model, tmp_path):
    logs = []
    writer = TensorBoard(tmp_path)
    learn(model, [writer, lambda model, log: logs.append(log)])
    writer._writer.close()
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(tmp_path)).Reload()
    for name in logs[0]:
        finite = [(log["time/total_timesteps"], log[name]) for log in logs if math.isfinite(log[name])]
        read = [(event.step, event.value) for event in events.Scalars(name)] if finite else []
        assert [step for step, _ in read] == [step for step, _ in finite]
        np.testing.assert_allclose([value for _, value in read], [value for _, value in finite], rtol=1e-6)


def test_two_runs_of_one_second_have_two_tensorboard_files(tmp_path):
    for _ in range(2):
        TensorBoard(tmp_path)(Fake(), {"a": 1.0})
    assert len([*tmp_path.iterdir()]) == 2


def full(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("method", ["write", "flush"])
def test_a_full_disk_under_tensorboard_is_told_and_nothing_waits(method, model, tmp_path, monkeypatch):
    """Not in a thread of its own, which would die there and leave training to wait for it."""
    first = model.num_timesteps
    writer = TensorBoard(tmp_path)
    monkeypatch.setattr("tensorboardX.record_writer.RecordWriter." + method, full)
    with pytest.raises(UsageError, match=f"folder is {tmp_path}, which can't be written: No space left on device"):
        learn(model, writer)
    monkeypatch.undo()
    assert model.num_timesteps == first + 20, "what was learnt up to there stays"
    model.learn(80, progress_bar=False, log_interval=2)


def test_a_full_disk_under_json_lines_is_told_and_the_file_stays_whole(model, tmp_path, monkeypatch):
    first, writer = model.num_timesteps, JSONLines(tmp_path / "log")
    learn(model, writer, updates=2)
    before = (tmp_path / "log").read_bytes()
    monkeypatch.setattr("galton.saving.files.append_line", full)
    with pytest.raises(UsageError, match="log, which can't be written: No space left on device; name another"):
        learn(model, writer)
    assert (tmp_path / "log").read_bytes() == before
    assert model.num_timesteps == first + 40
    model.learn(60, progress_bar=False, log_interval=2)


def test_weights_and_biases_gets_the_finite_numbers_and_its_settings(monkeypatch):
    sent, fake = [], types.ModuleType("wandb")
    run = types.SimpleNamespace(log=lambda numbers, step: sent.append((numbers, step)))
    fake.init = lambda **settings: sent.append(settings) or run
    monkeypatch.setitem(sys.modules, "wandb", fake)
    callback = WeightsAndBiases(project="p")
    list(Fake().log_points(lambda model, log: callback(model, log | {"a": 1.0, "b": math.nan}), 2))
    assert sent == [{"project": "p"}, ({"a": 1.0}, 20), ({"a": 1.0}, 40)]


def test_weights_and_biases_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(UsageError, match=r"pip install .*\[wandb\]"):
        WeightsAndBiases()


BRACES = ["run-{steps}", "run-{step:08d}", "run-{}", "{step}/{x}"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: Evaluate(every=0), "every is 0"),
        (lambda path: Evaluate(n_episodes=0), "n_episodes is 0"),
        (lambda path: Checkpoint("x", every=-1), "every is -1"),
        *((lambda path, name=name: Checkpoint(name), "is all that can stand in braces") for name in BRACES),
        (lambda path: StopAfter(0.0), "seconds is 0.0"),
        (lambda path: StopAfter(math.nan), "seconds is nan"),
        (lambda path: StopAfter(True), "seconds is True; it must be a number"),
        (lambda path: StopOnReward(True), "threshold is True; it must be a number"),
        (lambda path: StopOnReward(math.nan), "threshold is nan"),
        (lambda path: JSONLines(path), "can't be written"),
        (lambda path: JSONLines(path / "new" / "/dev/null/x"), "can't be written"),
        (lambda path: TensorBoard("/dev/null/logs"), "folder is /dev/null/logs, which can't be written"),
    ],
)
def test_bad_arguments_are_named(make, message, tmp_path):
    with pytest.raises(UsageError, match=message):
        make(tmp_path)
