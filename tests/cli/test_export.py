"""What `galton export` writes of a run, and what it says where there is none."""

import json
import shutil
import sys

import onnxruntime
import pytest

from galton import A2C, UsageError
from galton.cli import export
from galton.models import Model

COMMAND = "galton train Pendulum-v1 --loss hl-gauss --n-bins 5"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run folder as `galton train` leaves one; what a policy earns does not matter, so nothing is learnt."""
    folder = tmp_path_factory.mktemp("made") / "run"
    model = A2C("Pendulum-v1", "hl-gauss", n_bins=5, net_arch=(4,))
    for name in ("best_model", "model"):
        model.save(folder / f"{name}.safetensors")
    point = {"time/total_timesteps": 0, "eval/mean_reward": -5.0, "eval/std_reward": 1.0}
    (folder / "metrics.jsonl").write_text(json.dumps(point) + "\n")
    settings = {"env": "Pendulum-v1", "env_kwargs": {}, "eval_episodes": 2, "command": COMMAND}
    (folder / "config.json").write_text(json.dumps(settings | {"versions": {"galton": "0.1.0"}}))
    return folder


@pytest.fixture
def run(made, tmp_path):
    return shutil.copytree(made, tmp_path / "run")


def written(folder, before=("best_model.safetensors", "config.json", "metrics.jsonl", "model.safetensors")):
    return sorted({path.name for path in folder.iterdir()} - set(before))


def test_a_run_becomes_a_policy_and_a_contract_that_says_where_it_came_from(run, capsys):
    export.main([str(run), "--format", "onnx"])
    assert written(run) == ["policy.json", "policy.onnx"]
    source = json.loads((run / "policy.json").read_text())["source"]
    assert (source["env"], source["command"], source["model"]) == ("Pendulum-v1", COMMAND, "model.safetensors")
    assert source["steps"] == 0
    assert onnxruntime.InferenceSession(run / "policy.onnx").get_inputs()[0].shape == ["batch", 3]
    assert f"policy: {run / 'policy.onnx'}" in capsys.readouterr().out


def test_onnx_is_what_it_writes_by_default_also_of_a_model_without_a_run(run, tmp_path):
    export.main([str(run)])
    assert written(run) == ["policy.json", "policy.onnx"]
    (tmp_path / "alone").mkdir()
    shutil.copy(run / "model.safetensors", tmp_path / "alone")
    export.main([str(tmp_path / "alone" / "model.safetensors")])
    assert written(tmp_path / "alone") == ["policy.json", "policy.onnx"]


def test_a_card_needs_no_onnx(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    export.main([str(run), "--format", "card"])
    assert written(run) == ["model_card.md"]
    text = (run / "model_card.md").read_text()
    assert COMMAND in text
    assert "| This policy | 0 | 2 |" in text


def test_the_best_model_is_exported_by_its_name_to_a_folder_of_its_own_and_again_over_its_files(run):
    for _ in range(2):
        export.main([str(run / "best_model.safetensors"), "--format", "onnx", "card", "--out", str(run / "best")])
        assert written(run / "best") == ["model_card.md", "policy.json", "policy.onnx"]
    source = json.loads((run / "best" / "policy.json").read_text())["source"]
    assert source["model"] == "best_model.safetensors"
    assert source["steps"] == Model.load(run / "best_model.safetensors").num_timesteps


WRONG = {
    "no run": (["nowhere"], "run is nowhere, which does not exist"),
    "no model": (["{run}/.."], "run is .*, which holds no model.safetensors; name a run folder of `galton train`"),
    "a long name": (["x" * 300], "^(run|path) is x"),
    "no format": (["{run}", "--format", "torch"], "format is 'torch'; choose from onnx, card"),
    "none": (["{run}", "--format"], "format is empty; choose from onnx, card"),
    "out is a file": (["{run}", "--out", "{run}/config.json"], "out is .*config.json, which is a file; name a folder"),
    "a card of a model": (["{run}/../alone/model", "--format", "card"], "beside which there is no config.json; a card"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_can_not_be_exported_is_named_and_nothing_is_written(name, run, tmp_path):
    words, message = WRONG[name]
    (tmp_path / "alone").mkdir()
    shutil.copy(run / "model.safetensors", tmp_path / "alone")
    with pytest.raises(UsageError, match=message):
        export.main([word.replace("{run}", str(run)) for word in words])
    assert written(run) == written(tmp_path / "alone") == []
