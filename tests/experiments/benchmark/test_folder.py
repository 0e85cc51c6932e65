"""A benchmark trained twice from one file has the same bytes, goes on where it stopped, and knows its file."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np
import pytest
from scipy import stats

from galton import UsageError
from galton_experiments.benchmark import report
from galton_experiments.benchmark.folder import DATA, FILE, MADE, differences, load, train, written
from galton_experiments.commands import benchmark as command
from galton_experiments.sweep import engine
from galton_experiments.sweep.parquet import from_bytes, record_of
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import finished
from galton_experiments.sweep.store import Store

from .files import changed, of_record

PLACES = {
    "budget__settings": 2,
    "budget__fresh_seeds": 4,
    "budget__steps": 50,
    "methods__ppo": None,
    "prior__clip_range": None,
    "tasks__noisy": None,
    "tasks__four": {"env": "bandit", "env_kwargs": {"noise_std": 2.0}, "label": "more noise", "held_out": True},
}
RECORD = changed(**PLACES)


class Here:
    """Carries plans out in this process, and counts shards; up to so many."""

    def __init__(self, most=99):
        self.done, self._most = 0, most

    def __call__(self, store, plan):
        with ThreadPoolExecutor(1) as threads:
            engine.run(store, plan, threads, lambda: 1, self.count)

    def count(self, reports, before):
        self.done += len(reports) * (not before)
        if self.done >= self._most:
            raise KeyboardInterrupt


def benchmark(folder, record=RECORD, here=None):
    store, here, told = Store(str(folder)), here or Here(), []
    with store.lock():
        assert train(store, of_record(record), here, told.append)
    report.write(store, told[-1])
    return here.done


@pytest.mark.slow
def test_runs_of_a_shard_share_its_time_evenly(tmp_path):
    store = Store(str(tmp_path))
    with store.lock():
        assert train(store, of_record(RECORD), Here(), lambda _: None, shard_width=3)
    place = Store(f"{tmp_path}/sweeps/tuning-bandit")
    plan, steps, seconds = Plan.load(place), {}, {}
    for done in finished(place, plan).values():
        table = from_bytes(place.read(f"shards/{done.file}"))
        loss = plan.study.settings[table["setting"][0].as_py()]["loss"]
        method = "gaussian" if loss == "gaussian" else "bins"
        record = record_of(table)
        steps[method] = steps.get(method, 0) + record["env_steps"]
        seconds[method] = seconds.get(method, 0) + record["train_seconds"]
        assert table.num_rows in (3, 1)  # of 2 settings × 2 seeds
    told = json.loads((tmp_path / MADE).read_text())["tuning-bandit"]["steps_per_second"]
    assert told == {method: pytest.approx(steps[method] / seconds[method], abs=1) for method in steps}


def files(folder):
    """Every file that one finds in the end, but sweeps and how it was made."""
    found = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    return {name: path.read_bytes() for name, path in found.items() if "sweeps" not in name and name != MADE}


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference")
    benchmark(folder)
    return folder


@pytest.mark.slow
def test_it_writes_all_that_it_found(reference):
    names = {"fresh-bandit", "held-out-four", "tuning-bandit"}
    figures = {f"figures/{name}{suffix}" for name in ("scores", "curves", "best-of-n") for suffix in (".png", ".svg")}
    wanted = {f"{DATA}/{name}.parquet" for name in names} | figures
    assert {*files(reference)} - {".lock"} == wanted | {FILE, report.NUMBERS, report.PAGE}
    assert {*json.loads((reference / MADE).read_text())} == names


def test_the_hash_of_the_file_stands_in_every_result(reference):
    digest = of_record(RECORD).digest
    for name in (FILE, report.NUMBERS):
        assert json.loads((reference / name).read_text())["benchmark"] == digest
    assert digest in (reference / report.PAGE).read_text()
    for path in (reference / DATA).iterdir():
        assert record_of(from_bytes(path.read_bytes()))["benchmark"] == digest


@pytest.mark.slow
def test_a_second_run_from_the_same_file_gives_the_same_bytes(reference, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        benchmark(tmp_path, here=Here(most=3))
    assert benchmark(tmp_path) > 0
    assert files(tmp_path) == files(reference)
    assert benchmark(tmp_path) == 0
    assert files(tmp_path) == files(reference)


@pytest.mark.slow
def test_data_that_are_there_need_no_sweeps(reference, tmp_path):
    folder = tmp_path / "copied"
    shutil.copytree(reference, folder, ignore=shutil.ignore_patterns("sweeps", "*.html", "figures"))
    assert benchmark(folder) == 0
    assert files(folder) == files(reference)


def test_what_a_folder_holds_is_read_without_training(reference, tmp_path):
    folder, known = tmp_path / "copied", of_record(RECORD)
    shutil.copytree(reference, folder, ignore=shutil.ignore_patterns("sweeps"))
    assert written(load(Store(str(folder)), known).record()) == (reference / report.NUMBERS).read_bytes()
    (folder / DATA / "held-out-four.parquet").unlink()
    assert [*load(Store(str(folder)), known).later] == ["fresh"]
    assert {*files(folder)} == {*files(reference)} - {f"{DATA}/held-out-four.parquet"}
    (folder / DATA / "tuning-bandit.parquet").unlink()
    with pytest.raises(UsageError, match=r"out is .*copied, where tuning is not done; run its benchmark again"):
        load(Store(str(folder)), known)
    with pytest.raises(UsageError, match=f"out is .*, which holds no {FILE}; name the folder of a benchmark"):
        load(Store(str(tmp_path)), known)


@pytest.mark.parametrize(
    ("places", "told"),
    [
        ({"budget__seeds": 3}, "budget.seeds is 3 and was 2"),
        (
            {"methods__bins__search__eta": {"uniform": [1, 2]}},
            "methods.bins.search.eta.uniform is new; .*log-uniform is",
        ),
        ({"tasks__four": None}, "tasks.four is missing"),
        ({"selection__last": 0.2}, "selection is new"),
    ],
)
def test_a_changed_file_is_refused_with_what_differs(reference, places, told):
    before = files(reference)
    with pytest.raises(UsageError, match=f"which was begun with another file: {told}.*Put that back, or name another"):
        benchmark(reference, changed(**PLACES, **places) if "tasks__four" not in places else changed(**PLACES | places))
    assert files(reference) == before


def test_other_draws_and_other_runs_are_refused(reference, tmp_path):
    folder = tmp_path / "copied"
    shutil.copytree(reference, folder)
    file = folder / FILE
    record = json.loads(file.read_text())
    record["draws"]["bins"][0]["eta"] = 1.0
    file.write_text(json.dumps(record))
    with pytest.raises(UsageError, match=r"other draws of the same file, as another version of SciPy .*: bins.*eta"):
        benchmark(folder)
    for text in ("{", "[" * 100_000):
        file.write_text(text)
        with pytest.raises(UsageError, match=f"whose {FILE} was damaged"):
            benchmark(folder)
    shutil.copy(reference / FILE, file)
    shutil.copy(folder / DATA / "fresh-bandit.parquet", folder / DATA / "tuning-bandit.parquet")
    with pytest.raises(UsageError, match="its stage is 'fresh', not 'tuning'; remove it to make it again"):
        benchmark(folder)
    (folder / DATA / "tuning-bandit.parquet").write_bytes(b"nothing")
    with pytest.raises(UsageError, match=r"data/tuning-bandit.parquet in .* is not what this benchmark writes"):
        benchmark(folder)


def test_differences_are_told_by_their_place():
    assert differences({"a": 1, "b": {"c": [1, 2]}}, {"a": 1.5, "b": {"c": [1, 2]}, "d": 3}) == [
        "a is 1.5 and was 1",
        "d is new",
    ]


def table(folder, name):
    return from_bytes((folder / DATA / f"{name}.parquet").read_bytes()).to_pylist()


def test_the_report_is_what_the_data_say(reference):
    """Selection and scores again, from the Parquet files alone."""
    numbers = json.loads((reference / report.NUMBERS).read_text())
    rows = table(reference, "tuning-bandit")
    assert len(rows) == 2 * 2 * 2
    assert all(row["final_judged"] == pytest.approx(row["judged"][-1]) for row in rows)
    ranks = stats.rankdata([row["final_judged"] for row in rows])
    for method in ("gaussian", "bins"):
        means = [
            np.mean(
                [rank for rank, row in zip(ranks, rows, strict=True) if (row["method"], row["draw"]) == (method, i)]
            )
            for i in range(2)
        ]
        assert numbers["selected"]["shared"][method] == int(np.argmax(means))
        assert numbers["selected"]["per_task"]["bandit"][method] == int(np.argmax(means))
    for name in ("fresh-bandit", "held-out-four"):
        rows = [row for row in table(reference, name) if row["role"] == "shared"]
        stage = numbers["stages"][name.rpartition("-")[0]]
        for row in rows:
            assert row["draw"] == numbers["selected"]["shared"][row["method"]]
        ours, theirs = ([row["final_judged"] for row in rows if row["method"] == m] for m in ("bins", "gaussian"))
        share = np.mean([(x > y) + 0.5 * (x == y) for x in ours for y in theirs])
        assert stage["above"]["bins"]["gaussian"]["mean"] == pytest.approx(share)
        task = name.rpartition("-")[2]
        assert stage["results"][task]["bins"]["shared"]["judged"]["mean"] == pytest.approx(np.mean(ours))
    seeds = {name: {row["seed"] for row in table(reference, name)} for name in ("tuning-bandit", "fresh-bandit")}
    assert [len(of) for of in seeds.values()] == [2, 4]
    assert not seeds["tuning-bandit"] & seeds["fresh-bandit"]


@pytest.mark.slow
def test_plans_can_be_carried_out_by_others(reference, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text(json.dumps(RECORD))
    monkeypatch.setattr(command, "read", lambda path, importing: of_record(json.loads(path.read_text())))
    for stage in (["tuning-bandit"], ["fresh-bandit", "held-out-four"]):
        command.main(["mine.json", "--plan-only", "--out", "out"])
        printed = capsys.readouterr().out
        for name in stage:
            store = Store(f"out/sweeps/{name}")
            plan = Plan.load(store)
            assert f"{plan.n_shards} of {plan.n_shards} shards are left: out/sweeps/{name}" in printed
            for index in range(plan.n_shards):
                engine.work(store.url, index)
            assert len(finished(store, plan)) == plan.n_shards
        assert "there is more to train" in printed
    command.main(["mine.json", "--plan-only", "--out", "out"])
    printed = capsys.readouterr().out
    assert "P(above" in printed
    assert "more to train" not in printed
    assert {
        name for name in files(tmp_path / "out") if files(tmp_path / "out")[name] != files(reference)[name]
    } == set()


OWN = """
import gymnasium
from gymnasium.spaces import Box


class Point(gymnasium.Env):
    observation_space, action_space = Box(-1.0, 1.0, (1,)), Box(-1.0, 1.0, (1,))

    def __init__(self, target):
        self.target = target

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.observation_space.sample() * 0, {}

    def step(self, action):
        return self.observation_space.sample() * 0, -abs(float(action[0]) - self.target), True, False, {}


gymnasium.register("Point-v0", Point)
"""


@pytest.mark.slow
def test_an_environment_of_ones_own_is_trained_and_held_out(tmp_path, monkeypatch):
    (tmp_path / "a_point_of_mine.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    own = {"env": "a_point_of_mine:Point-v0", "env_kwargs": {"target": 0.5}}
    held_out = own | {"held_out": True, "env_kwargs": {"target": -0.5}}
    benchmark(tmp_path / "out", changed(**PLACES | {"tasks__bandit": own, "tasks__four": held_out}))
    for name in ("tuning-bandit", "held-out-four"):
        returns = [row["final_judged"] for row in table(tmp_path / "out", name)]
        assert max(returns) <= 0
        assert min(returns) >= -1.5
    monkeypatch.undo()
    gymnasium.registry.pop("Point-v0")


@pytest.mark.slow
def test_the_command_names_the_file_and_writes_nothing_for_a_wrong_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "read", lambda path, importing: of_record(changed(tasks__bandit__env="bandid")))
    with pytest.raises(UsageError, match=r"file is 'mine.toml': tasks.bandit: environment is 'bandid'"):
        command.main(["mine.toml"])
    monkeypatch.setattr(
        command, "read", lambda path, importing: of_record(changed(imports=["not_there"]), importing=importing)
    )
    with pytest.raises(UsageError, match=r"imports names 'not_there', .* if it lies there and you trust it, give"):
        command.main(["mine.toml"])
    monkeypatch.setattr(command, "read", lambda path, importing: of_record(RECORD))
    with pytest.raises(UsageError, match=r"imports is json, which no worker would import; name it among the imports"):
        command.main(["mine.toml", "--imports", "json"])
    assert [*tmp_path.iterdir()] == []
