"""What earlier versions wrote is read, and means what it meant: tests/golden/README.md.

As a script this tells whether training gives the same bits here as where the files were made.
"""

import hashlib
import json
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import jax
import numpy as np
import pyarrow.parquet as pq
import pytest

import galton
from galton import A2C, Config, Hypers, InexactResume

# All that is not public; where it lives may change, what is read with it may not.
from galton.studies import reproduce
from galton.studies.claims import all_claims
from galton.studies.sweeps import SWEEPS
from galton.sweep.grid import paper_grid, task_defaults
from galton.sweep.plan import Plan, fold_in
from galton.sweep.store import Store
from galton.sweep.study import Study

HERE = Path(__file__).parent
V1 = HERE / "golden" / "v1"
PAPER = HERE.parent / "results" / "paper"
CLOSE = {"rtol": 1e-4, "atol": 1e-5}
"""What other compiler flags and other processors may change: a few roundings, added up over hundreds of updates."""


def record(name):
    return json.loads((V1 / name).read_text())


def arrays(name, prefix):
    """Those of an npz file whose names begin so, by the rest of their names."""
    with np.load(V1 / name) as file:
        return {key.removeprefix(prefix): file[key] for key in file.files if key.startswith(prefix)}


def curve(log, name):
    """One column of the log of `galton.train`."""
    return getattr(log, name)


def by_path(tree):
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): np.asarray(leaf) for path, leaf in leaves}


def check_close(found, golden):
    """Everything golden is there; what a later version adds is its own affair."""
    assert golden
    assert golden.keys() <= found.keys()
    for name, values in golden.items():
        np.testing.assert_allclose(found[name], values, **CLOSE, err_msg=name)


def command(*arguments, cwd):
    done = subprocess.run(
        [sys.executable, "-m", "galton", *arguments], cwd=cwd, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


CHECKPOINTS = record("checkpoints.json")
EXACT = [name for name, known in CHECKPOINTS.items() if known["exact"]]


def path_of(name):
    return V1 / "checkpoints" / f"{name}.safetensors"


def environment(name):
    if name != "stateful_swing":
        return name
    sys.path.insert(0, str(HERE))
    try:
        import swing
    finally:
        sys.path.pop(0)
    return swing.stateful_swing


def go_on(name):
    """A model's log and parameters after learning more."""
    known, logs = CHECKPOINTS[name], []
    with warnings.catch_warnings():
        warnings.simplefilter("error", InexactResume)
        model = A2C.load(path_of(name), environment(known["env"]))
    interval = known["log_interval"]
    model.learn(known["more"], lambda _, log: logs.append(log), progress_bar=False, log_interval=interval)
    assert model.num_timesteps == known["step"] + known["more"]
    model.close()
    return {key: np.array([log[key] for log in logs]) for key in logs[0]}, by_path(model.learner.params)


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_model_is_what_it_was_and_predicts_what_it_did(name):
    known, model = CHECKPOINTS[name], A2C.load(path_of(name))
    for field, value in known["config"].items():
        assert getattr(model.config, field) == (tuple(value) if field == "net_arch" else value)
    assert model.hypers._asdict().items() >= known["hypers"].items()
    assert (model.seed, model.num_timesteps) == (known["seed"], known["step"])
    found, golden = by_path(model.learner.params), arrays("checkpoints.npz", f"{name}/before/")
    assert {key: values.tobytes() for key, values in found.items()} == {
        key: values.tobytes() for key, values in golden.items()
    }
    observation = np.float32(known["observation"])
    np.testing.assert_allclose(model.predict(observation, deterministic=True)[0], known["deterministic"], **CLOSE)
    np.testing.assert_allclose(model.predict(observation)[0], known["explored"], **CLOSE)


@pytest.mark.parametrize("name", EXACT)
def test_a_model_goes_on_as_it_did(name):
    if CHECKPOINTS[name]["env"].endswith("-v5"):
        pytest.importorskip("mujoco")
    log, params = go_on(name)
    check_close(params, arrays("checkpoints.npz", f"{name}/after/"))
    check_close(log, arrays("checkpoints.npz", f"{name}/log/"))


def test_a_model_whose_environment_can_not_tell_its_state_goes_on_with_a_warning():
    (name,) = CHECKPOINTS.keys() - set(EXACT)
    known = CHECKPOINTS[name]
    with pytest.warns(InexactResume):
        model = A2C.load(path_of(name), known["env"])
    check_close(by_path(model.learner.params), arrays("checkpoints.npz", f"{name}/before/"))
    model.learn(known["more"], progress_bar=False)
    assert model.num_timesteps == known["step"] + known["more"]
    model.close()


@pytest.fixture
def sweep(tmp_path):
    """The sweep that lacks a shard, beside its grid."""
    shutil.copytree(V1 / "sweep", tmp_path / "sweep")
    shutil.copy(V1 / "grid.toml", tmp_path)
    return tmp_path / "sweep"


def rows(folder):
    """Of results.parquet, by setting and trial."""
    table = pq.ParquetFile(folder / "results.parquet").read(use_threads=False)
    columns = {name: np.array(table.column(name).to_pylist()) for name in table.column_names}
    keys = zip(columns["setting"].tolist(), columns["trial"].tolist(), strict=True)
    return {key: {name: values[i] for name, values in columns.items()} for i, key in enumerate(keys)}


def check_rows(found, golden):
    for key, row in golden.items():
        assert row.keys() <= found[key].keys()
        for name, value in row.items():
            if value.dtype.kind == "f":
                np.testing.assert_allclose(found[key][name], value, **CLOSE, err_msg=name)
            else:
                np.testing.assert_array_equal(found[key][name], value, err_msg=name)


def test_a_plan_keeps_its_names_and_seeds(sweep):
    plan, known = Plan.load(Store(str(sweep))), record("sweep.json")
    assert [setting.name for setting in plan.study.settings] == known["settings"]
    assert plan.names == known["shards"]
    for column in ("setting", "trial", "seed"):
        assert getattr(plan, column).tolist() == known[column]


def test_finished_shards_count_and_the_missing_one_alone_is_trained(sweep):
    known, golden = record("sweep.json"), rows(sweep)
    before = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in (sweep / "shards").iterdir()}
    assert len(before) == len(known["shards"]) - 1

    command("sweep", "results", str(sweep), cwd=sweep.parent)
    there = rows(sweep)
    assert len(there) == 10
    check_rows(there, {key: golden[key] for key in there})

    command(*known["command"], "--workers", "1", "--out", "sweep", cwd=sweep.parent)
    after = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in (sweep / "shards").iterdir()}
    assert before.items() <= after.items()
    (new,) = after.keys() - before.keys()
    missing = known["missing"]
    assert new.startswith(f"{missing:07d}-{known['shards'][missing]}-")
    assert rows(sweep).keys() == golden.keys()
    check_rows(rows(sweep), golden)


def told_by(out):
    """What a folder of `galton reproduce` says."""
    data, found = reproduce.load(str(out)), {}
    for name, summary in data.sweeps.items():
        names = [setting.name for setting in summary.study.settings]
        best = {
            loss: [
                one.setting.name,
                *(float(x.mean()) for x in (one.final_training_return, one.final_evaluation_return)),
            ]
            for loss, one in summary.best.items()
        }
        digest = hashlib.sha256("\n".join(names).encode()).hexdigest()
        found[name] = {"runs": summary.table.num_rows, "settings": len(names), "names": digest, "best": best}
    return found, [[claim.source, claim.number, claim.verdict] for claim in all_claims(data)]


def check_told(out, known):
    sweeps, claims = told_by(out)
    assert sweeps == known["sweeps"]
    for claim in known["claims"]:
        assert claim in claims


def test_results_say_what_they_said():
    check_told(V1 / "results", record("results.json"))


def test_results_are_still_of_the_studies_that_reproduce_asks_for():
    def carry_out(store, plan):
        raise AssertionError(f"{store.url} is trained again")

    reproduce.train(["bandit", "bandit-again"], "smoke", str(V1 / "results"), carry_out)
    assert [path.name for path in (V1 / "results").iterdir()] == ["data"]


def test_all_published_results_open():
    data = reproduce.load(str(PAPER))
    assert set(SWEEPS) | set(record("paper.json")["sweeps"]) == set(data.sweeps)
    files = {path.stem for path in (PAPER / "data").iterdir()}
    assert files == set(data.sweeps) | {"propositions"}
    assert data.propositions.num_rows > 0
    for summary in data.sweeps.values():
        assert summary.table.num_rows == len(summary.study.settings) * summary.study.trials
        assert np.isfinite(summary.curves("evaluation_return")).any()


def test_published_results_say_what_they_said():
    known = record("paper.json")
    files = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in (PAPER / "data").iterdir()}
    if files != known["files"]:
        pytest.skip("results/paper was measured again since")
    check_told(PAPER, known)


def test_a_run_folder_goes_on_as_it_did(tmp_path):
    shutil.copytree(V1 / "run", tmp_path / "run")
    known = record("run.json")
    before = (tmp_path / "run" / "metrics.jsonl").read_text()
    command(*known["command"], cwd=tmp_path)
    text = (tmp_path / "run" / "metrics.jsonl").read_text()
    assert text.startswith(before)
    lines = [json.loads(line) for line in text.splitlines()]
    assert len(lines) == len(known["metrics"])
    for line, golden in zip(lines, known["metrics"], strict=True):
        golden = {key: value for key, value in golden.items() if key not in ("time/time_elapsed", "time/fps")}
        check_close(line, {key: np.nan if value is None else value for key, value in golden.items()})
    check_close(by_path(A2C.load(tmp_path / "run" / "model").learner.params), arrays("run.npz", ""))


@pytest.mark.slow
def test_a_comparison_comes_out_as_it_did(tmp_path):
    arguments = json.loads((V1 / "compare" / "config.json").read_text())["command"].split()
    command(*arguments[1:], cwd=tmp_path)
    golden, found = (
        pq.ParquetFile(folder / "compare" / "curves.parquet").read(use_threads=False).to_pydict()
        for folder in (V1, tmp_path)
    )
    assert golden.pop("loss") == found["loss"]
    check_close(found, golden)
    ours, theirs = (json.loads((folder / "compare" / "summary.json").read_text()) for folder in (V1, tmp_path))
    for one, other in zip(ours, theirs, strict=True):
        for metric in ("training_return", "evaluation_return"):
            check_close(other[metric], one[metric])


@pytest.mark.parametrize("env", record("names.json"))
def test_settings_runs_and_shards_of_the_papers_grid_keep_their_names_and_seeds(env):
    known, settings = record("names.json")[env], paper_grid(env, task_defaults(env))
    names = [setting.name for setting in settings]
    assert names == known["settings"]
    for study, seeds in known["seeds"].items():
        assert [[fold_in(int(study), name, trial) for trial in range(3)] for name in names] == seeds
    assert Plan.create(Study(env, settings, 3, 1000)).names == known["shards"]


POPULATIONS = record("bits.json")


def trained(name):
    """A population's curves and parameters."""
    case = POPULATIONS[name]
    options = {key: case[key] for key in ("seeds", "total_timesteps", "n_logs", "n_eval_episodes")}
    config = Config(loss=case["loss"], **case["config"] | {"net_arch": tuple(case["config"]["net_arch"])})
    result = galton.train(case["env"], config, Hypers(**case["hypers"]), **options)
    golden = arrays("bits.npz", f"{name}/log/")
    return {column: curve(result.log, column) for column in golden}, by_path(result.learner.params)


@pytest.mark.parametrize("name", POPULATIONS)
def test_populations_train_as_they_did(name):
    log, params = trained(name)
    check_close(log, arrays("bits.npz", f"{name}/log/"))
    check_close(params, arrays("bits.npz", f"{name}/params/"))


def tell_bits():
    """Print for each case whether its numbers are the golden ones to the last bit, or how far they are apart."""
    cases = [("checkpoints.npz", name, "after", go_on) for name in EXACT]
    cases += [("bits.npz", name, "params", trained) for name in POPULATIONS]
    for file, name, kind, make in cases:
        log, params = make(name)
        found = {f"log/{key}": values for key, values in log.items()}
        found |= {f"{kind}/{key}": values for key, values in params.items()}
        golden = {key: values for key, values in arrays(file, f"{name}/").items() if not key.startswith("before/")}
        apart = [key for key, values in golden.items() if found[key].tobytes() != values.tobytes()]
        gap = max((np.nanmax(np.abs(found[key] - golden[key])) for key in apart), default=0.0)
        verdict = f"{len(apart)} of {len(golden)} arrays differ, by {gap:.2g} at most" if apart else "equal to the bit"
        print(f"{file} {name}: {verdict}")


if __name__ == "__main__":
    galton.use_all_cores()
    tell_bits()
