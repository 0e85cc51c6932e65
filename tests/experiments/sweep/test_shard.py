"""One shard: trained, committed, checked."""

import dataclasses
import importlib
import types

import jax
import numpy as np
import pyarrow.parquet as pq
import pytest

import galton
from galton.errors import UsageError
from galton.training.on_device import DevicePopulation
from galton_experiments.commands.sweep._folder import conclude
from galton_experiments.sweep import begun, shard
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.parquet import record_of
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import FOLDER, finished, read, work
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Setting, Study

TINY = {"n_steps": 5, "net_arch": (), "n_bins": 5, "learning_rate": [0.01, 0.1]}


@pytest.fixture
def planned(tmp_path):
    """Two losses, two learning rates, three trials: two shards of four runs and two of two."""
    store = Store(str(tmp_path))
    study = Study("bandit", expand([TINY | {"loss": ["gaussian", "hl-gauss"]}], {}), 3, 60, 3, 2)
    plan = Plan.create(study, 4)
    plan.save(store)
    return store, plan


def test_a_shard_holds_what_train_gives(planned):
    store, plan = planned
    told = work(store.url, 1)
    runs = plan.get(1)
    table = read(store, finished(store, plan)[1])
    result = galton.train(
        galton.envs.Bandit(),
        runs.agent,
        runs.seeds.tolist(),
        60,
        n_logs=3,
        n_eval_episodes=2,
        devices=jax.devices()[:1],
    )
    assert len(runs.seeds) == table.num_rows == 2  # a short shard trains no more than its own
    for name in ("training_return", "evaluation_return", "entropy", "grad_norm"):
        curves = np.stack(table.column(name).to_numpy())
        np.testing.assert_array_equal(curves, np.float32(result.log.columns()[name]))
    np.testing.assert_array_equal(np.stack(table.column("steps").to_numpy()), [[20, 40, 60]] * 2)
    finals = np.float32(result.final("training_return"))
    np.testing.assert_array_equal(table.column("final_training_return").to_numpy(), finals)
    assert told.final_training_return == finals.tolist()
    assert (told.index, told.setting, told.steps) == (1, [2, 2], 2 * 60)
    assert table.column("trial").to_pylist() == [1, 2]
    assert table.column("seed").to_pylist() == plan.seed[plan.shard == 1].tolist()


def test_a_shard_done_twice_has_the_same_columns_and_counts_once(planned):
    store, plan = planned
    work(store.url, 0)
    first = read(store, finished(store, plan)[0])
    work(store.url, 0)
    assert list(finished(store, plan)) == [0]
    assert read(store, finished(store, plan)[0]).replace_schema_metadata(None) == first.replace_schema_metadata(None)


class Ended(BaseException):
    """A worker is ended."""


def end_at(monkeypatch, point):
    """Keep a shard at every log point, and end its worker at that one."""
    points = iter(range(1, 10))

    def keep(self, arrays, own=begun.Begun.keep):
        own(self, arrays)
        if next(points) == point:
            raise Ended

    monkeypatch.setattr(begun, "EVERY", 0.0)
    monkeypatch.setattr(begun.Begun, "keep", keep)


def curves(store, plan):
    table = read(store, finished(store, plan)[0])
    return {name: np.array(table.column(name).to_pylist()) for name in table.column_names}


@pytest.mark.parametrize("point", [1, 2])
def test_a_shard_whose_worker_was_ended_goes_on_from_the_last_log_point_to_the_same_columns(
    planned, monkeypatch, point
):
    store, plan = planned
    work(store.url, 0)
    whole = curves(store, plan)
    (file,) = store.names(FOLDER)
    store.remove(f"{FOLDER}/{file}")
    with monkeypatch.context() as patched:
        end_at(patched, point)
        with pytest.raises(Ended):
            work(store.url, 0)
    (file,) = store.names(FOLDER)
    assert file.endswith(".begun")
    assert not finished(store, plan)
    trained = []
    monkeypatch.setattr(DevicePopulation, "log", lambda self, log=DevicePopulation.log: trained.append(1) or log(self))
    work(store.url, 0)
    assert len(trained) == 3 - point
    assert len(store.names(FOLDER)) == 1
    for name, values in curves(store, plan).items():
        np.testing.assert_array_equal(values, whole[name], name)


def test_what_was_kept_is_left_alone_where_it_is_damaged_or_of_another_version(planned, monkeypatch):
    store, plan = planned
    end_at(monkeypatch, 1)
    with pytest.raises(Ended):
        work(store.url, 0)
    (file,) = store.names(FOLDER)
    kept = begun.Begun(store, file.rpartition("-")[0], plan.study.modules)
    assert kept.kept() is not None
    with monkeypatch.context() as patched:
        patched.setattr(kept, "_made_by", "another version")
        assert kept.kept() is None
    content = bytearray((store.local / FOLDER / file).read_bytes())
    content[-1] ^= 1
    store.write(f"{FOLDER}/{file}", bytes(content))
    assert kept.kept() is None
    work(store.url, 0)
    assert [name for name in store.names(FOLDER) if name.endswith(".begun")] == []
    assert list(finished(store, plan)) == [0]


def test_the_results_say_so_where_a_module_changed_between_two_shards(planned, monkeypatch, capsys):
    store, plan = planned
    monkeypatch.setattr(begun, "made_by", lambda _: "nothing is kept")
    for index, source in enumerate(("x = 1.0", "x = 1.0", "x = 0.0", "x = 0.0")):
        monkeypatch.setattr(shard, "versions_of", lambda _, source=source: {"galton": "1", "modules": source})
        work(store.url, index)
        if index == 1:
            conclude(store, plan)
            assert capsys.readouterr().err == ""
    conclude(store, plan)
    assert capsys.readouterr().err == ("galton: 2 versions of the code trained these runs; they differ in modules\n")


def test_what_could_not_be_read_again_is_not_kept(planned, monkeypatch):
    store, _ = planned
    end_at(monkeypatch, 1)
    monkeypatch.setattr(begun, "files", types.SimpleNamespace(DATA=10))
    with pytest.raises(Ended):
        work(store.url, 0)
    assert store.names(FOLDER) == []


def test_the_module_of_an_environment_is_a_version_though_the_worker_imports_it(tmp_path, monkeypatch):
    text = "import gymnasium\n\ndef make():\n    return gymnasium.make('Pendulum-v1', max_episode_steps=50)\n"
    (tmp_path / "own_task_of_a_shard.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    begun.versions_of.cache_clear()
    store = Store(str(tmp_path / "sweep"))
    plan = Plan.create(Study("own_task_of_a_shard:make", expand([TINY], {})[:1], 1, 60, logs=1), 1)
    plan.save(store)
    work(store.url, 0)
    assert "modules" in record_of(read(store, finished(store, plan)[0]))["versions"]


def test_a_change_in_a_package_is_another_version(tmp_path, monkeypatch):
    package = tmp_path / "own_parts_of_a_shard"
    package.mkdir()
    (package / "__init__.py").write_text("from own_parts_of_a_shard import losses")
    (package / "losses.py").write_text("x = 1.0")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module(package.name)
    told = begun.versions_of((package.name,))
    (package / "losses.py").write_text("x = 0.0")
    begun.versions_of.cache_clear()
    assert begun.versions_of((package.name,)) != told


def test_a_module_that_changed_is_another_version(tmp_path, monkeypatch):
    (tmp_path / "own_loss_of_a_shard.py").write_text("x = 1.0")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("own_loss_of_a_shard")
    before, modules = begun.made_by(()), ("own_loss_of_a_shard",)
    told = begun.made_by(modules)
    (tmp_path / "own_loss_of_a_shard.py").write_text("x = 0.0")
    begun.made_by.cache_clear()
    begun.versions_of.cache_clear()
    assert len({before, told, begun.made_by(modules)}) == 3
    assert begun.made_by(()) == before


def test_a_files_metadata_tells_versions_and_machine(planned):
    store, _ = planned
    work(store.url, 0)
    (file,) = store.names(FOLDER)
    record = pq.read_schema(store.local / FOLDER / file).metadata[b"galton"].decode()
    for word in ("jax", "galton", "commit", "machine", "train_seconds", "compile_seconds", "finished"):
        assert f'"{word}"' in record


def test_every_truncation_and_flip_of_a_file_is_noticed(planned, trust):
    store, plan = planned
    work(store.url, 0)
    (file,) = store.names(FOLDER)
    path = store.local / FOLDER / file
    whole = path.read_bytes()
    draw, noticed = np.random.default_rng(0), 0
    for n in draw.integers(0, len(whole), 20):
        path.write_bytes(whole[:n])
        noticed += read(store, finished(store, plan)[0]) is None
    for position in draw.integers(0, len(whole), 200):
        flipped = bytearray(whole)
        flipped[position] ^= 1 << int(draw.integers(8))
        path.write_bytes(flipped)
        noticed += read(store, finished(store, plan)[0]) is None
    assert noticed == 220
    path.write_bytes(whole)
    assert read(store, finished(store, plan)[0]) is not None
    promise = "A file of a sweep that was cut off, or in which one bit flipped, is noticed and its runs trained again."
    trust("shards-damaged", promise, topic="damage", figure=noticed, unit="of 220 damages noticed", at_least=220)


def test_files_of_other_runs_and_other_names_do_not_count(planned, tmp_path):
    store, plan = planned
    work(store.url, 0)
    other = Plan.create(dataclasses.replace(plan.study, seed=1), 4)
    assert finished(store, other) == {}
    (file,) = store.names(FOLDER)
    for name in (
        "notes.txt",
        f"{file}.bak",
        file.replace("0000000-", "0000001-"),
        file.replace("0000000-", "0000099-"),
    ):
        store.write(f"{FOLDER}/{name}", b"")
    assert list(finished(store, plan)) == [0]


def test_a_diverged_run_is_kept_as_such(tmp_path):
    store = Store(str(tmp_path))
    setting = TINY | {"loss": "gaussian", "learning_rate": [0.1, 1e38], "max_grad_norm": 1e38}
    plan = Plan.create(Study("bandit", expand([setting], {}), 1, 100, 2, 0), 2)
    plan.save(store)
    told = work(store.url, 0)
    table = read(store, finished(store, plan)[0])
    diverged = table.column("diverged_at").to_pylist()
    assert diverged[0] == -1
    assert diverged[1] > 0
    assert np.isnan(told.final_training_return).tolist() == [False, True]


@pytest.mark.slow
def test_an_environments_constants_may_be_matrices(tmp_path):
    store = Store(str(tmp_path))
    kwargs = '{"A": [[0.5, 0], [0, 0.5]]}'
    Plan.create(Study("lqr", expand([TINY], {}), 1, 10, 1, 0, env_kwargs=kwargs), 2).save(store)
    assert work(store.url, 0).setting == [0, 1]


def test_an_environment_that_is_not_there_is_told(tmp_path):
    store = Store(str(tmp_path))
    Plan.create(Study("bandit", expand([TINY], {}), 1, 100, env_kwargs='{"depth": 3}'), 2).save(store)
    with pytest.raises(UsageError, match="bandit has no constant 'depth'"):
        work(store.url, 0)


def test_a_module_that_is_not_there_is_told(tmp_path):
    store = Store(str(tmp_path))
    Plan.create(Study("bandit", expand([TINY], {}), 1, 20, imports=("no_such_module",)), 2).save(store)
    with pytest.raises(UsageError, match="imports names 'no_such_module', which can't be imported"):
        work(store.url, 0)


@pytest.mark.slow
def test_modules_named_in_the_study_are_imported_first(tmp_path, monkeypatch):
    (tmp_path / "my_losses_for_sweeps.py").write_text(
        "from galton import losses\n\n\nclass Mine(losses.NegativeLogLikelihood):\n    label = 'Mine'\n\n\n"
        "losses.LOSSES['mine'] = Mine\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("galton.losses.LOSSES", galton.LOSSES)
    of_ours = expand([TINY | {"loss": "gaussian"}], {})
    settings = tuple(Setting.of_checked({**setting, "loss": "mine"}) for setting in of_ours)
    store = Store(str(tmp_path / "out"))
    Plan.create(Study("bandit", settings, 1, 20, imports=("my_losses_for_sweeps",)), 2).save(store)
    try:
        assert work(store.url, 0).setting == [0, 1]
    finally:
        galton.LOSSES.pop("mine", None)
