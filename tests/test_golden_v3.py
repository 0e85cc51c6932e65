"""Presets, later settings and a benchmark, as an earlier version wrote them."""

import json
import shutil

import numpy as np
import pytest

import galton
from galton.words import vocabulary
from galton_experiments.benchmark import stages
from galton_experiments.benchmark.draws import draws
from galton_experiments.benchmark.reading import read
from galton_experiments.sweep.study import Setting

from .golden.files import CLOSE, V3, arrays, check_close, command, record
from .test_golden import check_model, learnt

CHECKPOINTS, NAMES = record("checkpoints.json", V3), record("names.json", V3)
KINDS = {"A2C": galton.A2C, "PPO": galton.PPO}
QUICK = ("ppo-preset-classification", "ppo-held-hl-gauss-critic")
BENCHMARKS = V3.parents[2] / "benchmarks"


def load(name, env=None):
    return KINDS[CHECKPOINTS[name]["class"]].load(V3 / "checkpoints" / f"{name}.safetensors", env)


@pytest.mark.few
@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_model_is_what_it_was_and_predicts_what_it_did(name):
    check_model(load(name), CHECKPOINTS[name], arrays("checkpoints.npz", f"{name}/before/params/", V3))


@pytest.mark.few
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name not in QUICK else ()) for name in CHECKPOINTS]
)
def test_a_model_goes_on_as_it_did(name):
    known = CHECKPOINTS[name]
    if known["env"].endswith("-v5"):
        pytest.importorskip("mujoco")
    log, params = learnt(load(name, known["env"]), known)
    check_close(params, arrays("checkpoints.npz", f"{name}/after/params/", V3))
    check_close(log, arrays("checkpoints.npz", f"{name}/log/", V3))


def test_every_field_gives_a_setting_the_name_that_it_gave():
    assert NAMES["settings"].keys() <= vocabulary().usual.keys()
    for known in NAMES["settings"].values():
        assert Setting(known["record"]).name == known["name"]


@pytest.mark.parametrize(
    "file", [pytest.param(name, marks=[pytest.mark.slow] * name.startswith("winner")) for name in NAMES["benchmarks"]]
)
def test_a_benchmark_draws_the_settings_that_it_drew(file):
    known, protocol = NAMES["benchmarks"][file], read(BENCHMARKS / file)
    assert protocol.digest == known["digest"]
    parts = stages.tuning(protocol, draws(protocol))
    names = {part.name: [[setting.name for setting in study.settings] for study in part.studies] for part in parts}
    assert names == known["tuning"]


@pytest.mark.slow
def test_a_benchmark_that_was_done_is_read_and_reported_as_it_was(tmp_path):
    for name in ("small.toml", "benchmark"):
        (shutil.copytree if name == "benchmark" else shutil.copy)(V3 / name, tmp_path / name)
    command("benchmark", "small.toml", "--workers", "1", "--out", "benchmark", cwd=tmp_path)
    assert not (tmp_path / "benchmark" / "sweeps").exists()  # nothing was trained again
    ours, theirs = (json.loads((folder / "benchmark" / "report.json").read_text()) for folder in (tmp_path, V3))
    check_same(ours, theirs)


def check_same(one, other):
    """Everything that was there is there, and is the same."""
    if isinstance(other, dict):
        for key, value in other.items():
            check_same(one[key], value)
    elif isinstance(other, list):
        assert len(one) == len(other)
        for ours, theirs in zip(one, other, strict=True):
            check_same(ours, theirs)
    elif isinstance(other, float):
        np.testing.assert_allclose(one, other, **CLOSE)
    else:
        assert one == other
