"""PPO, settings that came after the first files, and what was exported, as earlier versions wrote them."""

import hashlib
import json
import re
import shutil

import numpy as np
import pytest

import galton
from galton.models import Model
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.store import Store

from .golden.files import CLOSE, V2, arrays, by_path, check_close, command, record
from .test_golden import check_model, learnt
from .test_golden_sweeps import check_rows, rows

CHECKPOINTS = record("checkpoints.json", V2)
KINDS = {"A2C": galton.A2C, "PPO": galton.PPO}


def load(name, env=None):
    return KINDS[CHECKPOINTS[name]["class"]].load(V2 / "checkpoints" / f"{name}.safetensors", env)


@pytest.mark.few
@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_model_is_what_it_was_and_predicts_what_it_did(name):
    check_model(load(name), CHECKPOINTS[name], arrays("checkpoints.npz", f"{name}/before/", V2))


@pytest.mark.few
@pytest.mark.parametrize("name", sorted(CHECKPOINTS, key=lambda name: name != "ppo-gaussian"))
def test_a_model_goes_on_as_it_did(name):
    known = CHECKPOINTS[name]
    log, found = learnt(load(name, known["env"]), known)
    golden = arrays("checkpoints.npz", f"{name}/after/", V2)
    if known["config"]["policy"] == "ordinal":
        for each in (found, golden):  # the first output of a dimension shifts all bins alike: Adam moves it by rounding
            each |= {key: each[key][..., np.arange(22) % 11 > 0] for key in ("actor/1/bias", "actor/1/kernel")}
    check_close(found, golden)
    check_close(log, arrays("checkpoints.npz", f"{name}/log/", V2))


@pytest.mark.slow
def test_a_sweep_of_ppo_keeps_its_names_and_its_finished_shards(tmp_path):
    shutil.copytree(V2 / "sweep", tmp_path / "sweep")
    plan, known = Plan.load(Store(str(tmp_path / "sweep"))), record("sweep.json", V2)
    assert [setting.name for setting in plan.study.settings] == known["settings"]
    assert plan.names == known["shards"]
    for column in ("setting", "trial", "seed"):
        assert getattr(plan, column).tolist() == known[column]
    golden = rows(tmp_path / "sweep")
    command("sweep", "results", "sweep", cwd=tmp_path)
    there = rows(tmp_path / "sweep")
    assert len(there) == len(golden) - np.bincount(plan.shard)[known["missing"]]
    check_rows(there, {key: golden[key] for key in there})


@pytest.mark.slow
def test_the_lost_shard_of_ppo_is_trained_again_as_it_was(tmp_path):
    shutil.copytree(V2 / "sweep", tmp_path / "sweep")
    shutil.copy(V2 / "grid.toml", tmp_path)
    golden = rows(tmp_path / "sweep")
    command(*record("sweep.json", V2)["command"], "--workers", "1", "--out", "sweep", cwd=tmp_path)
    assert rows(tmp_path / "sweep").keys() == golden.keys()
    check_rows(rows(tmp_path / "sweep"), golden)


@pytest.mark.slow
def test_a_run_of_ppo_goes_on_as_it_did(tmp_path):
    shutil.copytree(V2 / "run", tmp_path / "run")
    known, before = record("run.json", V2), (V2 / "run" / "metrics.jsonl").read_text()
    command(*known["command"], cwd=tmp_path)
    text = (tmp_path / "run" / "metrics.jsonl").read_text()
    assert text.startswith(before)
    lines = [json.loads(line) for line in text.splitlines()]
    for line, golden in zip(lines, known["metrics"], strict=True):
        golden = {key: value for key, value in golden.items() if key not in ("time/time_elapsed", "time/fps")}
        check_close(line, {key: np.nan if value is None else value for key, value in golden.items()})
    after = {key: value for key, value in arrays("run.npz", "", V2).items() if not key.startswith("exported/")}
    check_close(by_path(Model.load(tmp_path / "run" / "model").learner.params), after)


def test_an_exported_policy_does_what_it_did_under_onnx_runtime():
    runtime = pytest.importorskip("onnxruntime")
    contract = json.loads((V2 / "run" / "policy.json").read_text())
    content = (V2 / "run" / contract["file"]).read_bytes()
    assert hashlib.sha256(content).hexdigest() == contract["sha256"]
    session = runtime.InferenceSession(content, providers=["CPUExecutionProvider"])
    known = arrays("run.npz", "exported/", V2)
    given, taken = contract["input"]["name"], contract["output"]["name"]
    np.testing.assert_allclose(session.run([taken], {given: known["observations"]})[0], known["actions"], **CLOSE)


@pytest.mark.slow
def test_the_contract_of_today_has_all_that_the_earlier_one_had(tmp_path):
    """A program that reads the earlier contract reads this one: more may stand in it, nothing else may."""
    pytest.importorskip("onnx")
    command("export", str(V2 / "run"), "--format", "onnx", "card", "--out", str(tmp_path), cwd=tmp_path)
    earlier, today = (json.loads((folder / "policy.json").read_text()) for folder in (V2 / "run", tmp_path))
    own = {"sha256", "opset", "ir_version"}

    def check(one, other):
        assert type(one) is type(other)
        if isinstance(one, dict):
            for name in one.keys() - own:
                check(one[name], other[name])
        else:
            assert one == other

    earlier["source"].pop("galton"), today["source"].pop("galton")
    check(earlier, today)
    heads = [re.findall(r"(?m)^#+ .*", (folder / "model_card.md").read_text()) for folder in (V2 / "run", tmp_path)]
    assert {*heads[0]} <= {*heads[1]}
