"""Plans carried out in this process, and what is found in the end."""

import dataclasses
import re
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest
from rich.console import Console

from galton.errors import UsageError
from galton.saving import files
from galton_experiments.commands.sweep._folder import winners
from galton_experiments.sweep import engine, results
from galton_experiments.sweep.executors import WorkerDiedError
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.parquet import record_of
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import FOLDER, finished
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study

SETTINGS = expand(
    [{"loss": ["gaussian", "hl-one-hot"], "learning_rate": [0.001, 0.1], "n_steps": 5, "net_arch": (), "n_bins": 5}], {}
)
STUDY = Study("bandit", SETTINGS, trials=3, steps=200, logs=2, eval_episodes=1)


class Inline(Executor):
    """Calls at once, here."""

    def __init__(self):
        self.indices = []

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.indices.append(args[1])
        try:
            future.set_result(fn(*args))
        except Exception as error:
            future.set_exception(error)
        return future


class Recorder:
    def __init__(self):
        self.before, self.now = [], []

    def __call__(self, reports, before):
        (self.before if before else self.now).extend(report.index for report in reports)


def sweep(url, study=STUDY, executor=None, width=1, extend=False):
    store, recorder = Store(str(url)), Recorder()
    with store.lock():
        plan = engine.prepare(store, study, 4, extend)
        engine.run(store, plan, executor or Inline(), lambda: width, recorder)
    table = results.collect(store, plan)
    results.save(store, table)
    return recorder, plan, table


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference")
    sweep(folder)
    return folder


def test_a_sweep_does_every_shard_once_and_then_nothing(tmp_path):
    recorder, plan, table = sweep(tmp_path)
    assert recorder.before == []
    assert sorted(recorder.now) == list(range(plan.n_shards))
    assert table.num_rows == 12
    recorder, _, _ = sweep(tmp_path)
    assert (sorted(recorder.before), recorder.now) == (list(range(plan.n_shards)), [])


def test_the_table_has_every_run_with_its_setting(reference):
    table = results.collect(Store(str(reference)), Plan.load(Store(str(reference))))
    rows = [(r["setting.loss"], r["setting.learning_rate"], r["trial"]) for r in table.to_pylist()]
    assert rows == [(s["loss"], s["learning_rate"], t) for s in SETTINGS for t in range(3)]
    assert len(set(table.column("seed").to_pylist())) == 12


def test_a_study_finds_its_own_runs_in_a_folder_that_has_more_in_another_order(reference):
    store = Store(str(reference))
    fewer = dataclasses.replace(STUDY, settings=SETTINGS[2::-1], trials=2)
    with store.lock():
        plan = engine.prepare(store, fewer, None, extend=False)
    table = engine.Trained(store, plan, fewer).table()
    rows = [(r["setting"], r["setting.loss"], r["setting.learning_rate"], r["trial"]) for r in table.to_pylist()]
    assert rows == [(i, s["loss"], s["learning_rate"], t) for i, s in enumerate(fewer.settings) for t in range(2)]
    assert record_of(table)["versions"]
    assert engine.Trained(store, plan, STUDY).table().equals(results.collect(store, plan), check_metadata=True)


@pytest.mark.parametrize("width", [1, pytest.param(2, marks=pytest.mark.optimised), 4])
def test_neither_order_nor_workers_change_a_byte(tmp_path, reference, width):
    store = Store(str(tmp_path))
    plan = engine.prepare(store, STUDY, 4, extend=False)
    order = np.random.default_rng(width).permutation(plan.n_shards).tolist()
    for index in order[:width]:
        engine.work(store.url, index)
    with ThreadPoolExecutor(width) as threads:
        recorder, _, _ = sweep(tmp_path, executor=threads, width=width)
    assert sorted(recorder.now) == sorted(order[width:])
    assert (tmp_path / results.FILE).read_bytes() == (reference / results.FILE).read_bytes()


def test_damaged_shards_alone_are_done_again(tmp_path, reference):
    sweep(tmp_path)
    files = [tmp_path / FOLDER / name for name in Store(str(tmp_path)).names(FOLDER)]
    files[0].write_bytes(files[0].read_bytes()[:-1])
    flipped = bytearray(files[2].read_bytes())
    flipped[len(flipped) // 2] ^= 4
    files[2].write_bytes(flipped)
    with pytest.raises(UsageError, match="was damaged; run the sweep again"):
        results.collect(Store(str(tmp_path)), Plan.load(Store(str(tmp_path))))
    recorder, _, _ = sweep(tmp_path)
    assert sorted(recorder.now) == [0, 2]
    assert (tmp_path / results.FILE).read_bytes() == (reference / results.FILE).read_bytes()


def test_an_object_store_will_do(reference):
    store = Store("memory://sweep-of-the-test")
    with ThreadPoolExecutor(1) as threads:
        sweep("memory://sweep-of-the-test", executor=threads)
    assert store.read(results.FILE) == (reference / results.FILE).read_bytes()


def test_another_plan_is_refused_and_an_extension_adds(tmp_path):
    _, before, _ = sweep(tmp_path)
    more = dataclasses.replace(STUDY, trials=5)
    with pytest.raises(UsageError, match="holds the plan of another sweep: 8 of these runs are not in it"):
        sweep(tmp_path, more)
    for change in ({"steps": 300}, {"seed": 3}, {"env": "lqr"}):
        with pytest.raises(UsageError, match="but the plan has"):
            sweep(tmp_path, dataclasses.replace(STUDY, **change), extend=True)
    with pytest.raises(UsageError, match="shard_width is 5"):
        engine.prepare(Store(str(tmp_path)), STUDY, 5, extend=True)
    with pytest.raises(UsageError, match="whose plan was replaced meanwhile"):
        engine.work(str(tmp_path), 0, "of another plan")
    recorder, plan, table = sweep(tmp_path, more, extend=True)
    assert sorted(recorder.before) == list(range(before.n_shards))
    assert sorted(recorder.now) == list(range(before.n_shards, plan.n_shards))
    assert table.num_rows == 20
    runs = list(zip(table["setting"].to_pylist(), table["trial"].to_pylist(), strict=True))
    assert runs == sorted(runs)


def test_a_shard_that_fails_ends_the_sweep_and_keeps_the_others(tmp_path, monkeypatch):
    real = engine.work

    def work(url, index, name):
        if index == 2:
            raise UsageError("no room left")
        return real(url, index, name)

    monkeypatch.setattr(engine, "work", work)
    with pytest.raises(UsageError, match="no room left"):
        sweep(tmp_path)
    store = Store(str(tmp_path))
    done = set(finished(store, Plan.load(store)))
    assert 2 not in done
    monkeypatch.undo()
    recorder, _, _ = sweep(tmp_path)
    assert set(recorder.before) == done
    assert 2 in recorder.now


def test_a_shard_that_cannot_be_read_now_is_kept(tmp_path, monkeypatch):
    _, plan, _ = sweep(tmp_path)
    store = Store(str(tmp_path))

    def fail(*_):
        raise PermissionError("not now")

    monkeypatch.setattr(files, "read", fail)
    with pytest.raises(UsageError, match="can't be read: not now"):
        engine.verified(store, plan)
    monkeypatch.undo()
    assert len(finished(store, plan)) == plan.n_shards


def test_without_workers_it_waits_without_haste(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "TICK", 0.05)
    looks, begin = [], time.monotonic()

    def width():
        looks.append(time.monotonic() - begin)
        return int(looks[-1] > 0.5)

    store = Store(str(tmp_path))
    engine.run(store, engine.prepare(store, STUDY, 4, False), Inline(), width, Recorder())
    assert len([look for look in looks if look <= 0.5]) <= 11


def test_a_shard_that_ends_every_worker_says_what_to_do(tmp_path):
    class Fatal(Inline):
        def submit(self, fn, /, *args, **kwargs):
            future = Future()
            future.set_exception(WorkerDiedError("killed 20 workers"))
            return future

    with pytest.raises(UsageError, match=r"ended every worker .* smaller shard_width .*killed 20 workers"):
        sweep(tmp_path, executor=Fatal())


def test_a_lost_call_is_made_again(tmp_path, reference):
    class Lossy(Inline):
        def submit(self, fn, /, *args, **kwargs):
            if args[1] in self.indices:
                return super().submit(fn, *args, **kwargs)
            self.indices.append(args[1])
            future = Future()
            future.set_exception(ConnectionResetError())
            return future

    store, recorder = Store(str(tmp_path)), Recorder()
    plan = engine.prepare(store, STUDY, 4, False)
    engine.run(store, plan, Lossy(), lambda: 2, recorder, lost=(ConnectionResetError,))
    assert sorted(recorder.now) == list(range(plan.n_shards))
    results.save(store, results.collect(store, plan))
    assert (tmp_path / results.FILE).read_bytes() == (reference / results.FILE).read_bytes()


def test_a_shard_whose_calls_are_lost_every_time_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "ATTEMPTS", 3)

    class Lossy(Inline):
        def submit(self, fn, /, *args, **kwargs):
            self.indices.append(args[1])
            future = Future()
            future.set_exception(ConnectionResetError("gone"))
            return future

    store, executor = Store(str(tmp_path)), Lossy()
    plan = engine.prepare(store, dataclasses.replace(STUDY, settings=SETTINGS[:1]), 4, False)
    with pytest.raises(UsageError, match=r"shard 0 ended every worker that tried it; .*gone"):
        engine.run(store, plan, executor, lambda: 1, Recorder(), lost=(ConnectionResetError,))
    assert executor.indices == [0] * 3


def test_a_worker_keeps_its_program_and_a_new_one_takes_another():
    plan = Plan.create(dataclasses.replace(STUDY, trials=20), 4)  # ten shards of each loss
    pending = engine._Pending(plan, range(plan.n_shards))
    first, second = pending.pop(None), pending.pop(None)
    own, other = plan.firsts[first].program, plan.firsts[second].program
    assert own != other
    assert [plan.firsts[pending.pop(own)].program for _ in range(9)] == [own] * 9
    assert plan.firsts[pending.pop(own)].program == other  # nothing else is left
    left = 0
    while pending:
        pending.pop(other)
        left += 1
    assert left == 8


def test_the_best_setting_is_that_of_the_highest_mean(reference):
    store = Store(str(reference))
    plan = Plan.load(store)
    table = results.collect(store, plan)
    best = results.best_settings(plan.study, table)
    rows = table.to_pylist()
    for loss, winner in best.items():
        means = {
            rate: np.mean([r["final_training_return"] for r in rows if key(r) == (loss, rate)]) for rate in (0.001, 0.1)
        }
        assert winner.setting["learning_rate"] == max(means, key=means.get)
        assert winner.final_training_return.mean() == pytest.approx(max(means.values()), rel=1e-6)
        assert winner.n_settings == 2


def key(row):
    return row["setting.loss"], row["setting.learning_rate"]


def test_a_setting_with_a_diverged_or_missing_trial_does_not_win(reference):
    store = Store(str(reference))
    plan = Plan.load(store)
    table = results.collect(store, plan)
    finals = table.column("final_training_return").to_numpy().copy()
    place = table.column_names.index("final_training_return")

    def winner(first, begin=0):
        finals[:3] = first
        changed = table.set_column(place, "final_training_return", [finals])
        return results.best_settings(plan.study, changed.slice(begin))["gaussian"].setting

    assert winner([1e3, 1e3, 1e3]) == SETTINGS[0]
    assert winner([1e3, 1e3, np.nan]) == SETTINGS[1]
    finals[3:6] = [np.nan, np.nan, 1e3]
    assert winner([1e3, 1e3, np.nan]) == SETTINGS[0]
    assert winner([np.nan] * 3) == SETTINGS[1]
    finals[3:6] = [np.nan, 1e3, 1e3]
    assert winner([1e2, 1e2, np.nan]) == SETTINGS[1]
    finals[3:6] = 0
    assert winner([1e3, 1e3, 1e3], begin=1) == SETTINGS[1]


def test_the_table_of_winners_counts_the_runs_that_are_in_no_mean(reference):
    plan = Plan.load(Store(str(reference)))
    finals = np.array([1.0, 1.5, np.nan], np.float32)
    best = {"gaussian": results.Best(SETTINGS[0], finals, finals, 2)}
    console = Console(width=200)
    with console.capture() as capture:
        console.print(winners(plan.study, best))
    text = capture.get()
    assert "no return ┃ of settings" in text
    assert re.search(r"1 │ +2 │\n", text)


def test_a_rerun_has_the_winners_and_none_of_the_seeds(reference):
    store = Store(str(reference))
    plan = Plan.load(store)
    best = results.best_settings(plan.study, results.collect(store, plan))
    study = results.rerun(plan.study, best, trials=7, seed=1)
    assert study.settings == tuple(winner.setting for winner in best.values())
    fresh = Plan.create(study)
    assert fresh.n_runs == 14
    assert not set(fresh.seed.tolist()) & set(plan.seed.tolist())
    with pytest.raises(UsageError, match="seed is 0, the sweep's own"):
        results.rerun(plan.study, best, trials=7, seed=0)
