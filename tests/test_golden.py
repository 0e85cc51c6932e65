"""Models and runs of earlier versions go on as they did: tests/golden/README.md."""

import json
import shutil
import warnings

import numpy as np
import pyarrow.parquet as pq
import pytest

import galton
from galton import A2C, InexactResume
from galton.agents import read

from . import swing
from .golden.files import CLOSE, V1, arrays, by_path, check_close, check_settings, command, record

CHECKPOINTS = record("checkpoints.json")
LONG = (
    "bandit-one-hot",
    "lqr-centred",
    "swing-hl-gauss",
    "lqr/hl-one-hot",
    "lqr/hl-gauss-centred",
    "Pendulum-v1/gaussian",
)
"""Those that go on, or train again, in `make test-all` alone."""
EXACT = [name for name, known in CHECKPOINTS.items() if known["exact"]]


def path_of(name):
    return V1 / "checkpoints" / f"{name}.safetensors"


def go_on(name):
    """A model's log and parameters after learning more."""
    known, logs = CHECKPOINTS[name], []
    with warnings.catch_warnings():
        warnings.simplefilter("error", InexactResume)
        model = A2C.load(path_of(name), getattr(swing, known["env"], known["env"]))

    def note(model, log):
        if model.num_timesteps % model.log_interval == 0:  # the end of `learn` was no log point then
            logs.append(log)

    model.learn(known["more"], note, progress_bar=False, log_interval=known["log_interval"])
    assert model.num_timesteps == known["step"] + known["more"]
    model.close()
    return {key: np.array([log[key] for log in logs]) for key in logs[0]}, by_path(model.learner.params)


def check_model(model, known, golden):
    """Fail unless a model is what it was, to the bit, and predicts what it did."""
    numbers = {name: value if value is None else float(value) for name, value in known["hypers"].items()}
    check_settings(model.settings, known["config"] | numbers)  # infinity may be a word there
    assert (model.seed, model.num_timesteps) == (known["seed"], known["step"])
    found = by_path(model.learner.params)
    assert {key: leaf.tobytes() for key, leaf in found.items()} == {key: leaf.tobytes() for key, leaf in golden.items()}
    observation = np.array(known["observation"], model.observation_space.dtype)
    np.testing.assert_allclose(model.predict(observation, deterministic=True)[0], known["deterministic"], **CLOSE)
    np.testing.assert_allclose(model.predict(observation)[0], known["explored"], **CLOSE)


def learnt(model, known):
    """A model's log and parameters after it went on as it did then."""
    logs = []
    note = lambda _, log: logs.append(log)  # noqa: E731
    model.learn(known["more"], note, progress_bar=False, log_interval=known["log_interval"])
    model.close()
    return {key: np.array([point[key] for point in logs]) for key in logs[0]}, by_path(model.learner.params)


@pytest.mark.few
@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_model_is_what_it_was_and_predicts_what_it_did(name):
    check_model(A2C.load(path_of(name)), CHECKPOINTS[name], arrays("checkpoints.npz", f"{name}/before/"))


@pytest.mark.few
@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in EXACT])
def test_a_model_goes_on_as_it_did(name, trust):
    if CHECKPOINTS[name]["env"].endswith("-v5"):
        pytest.importorskip("mujoco")
    log, params = go_on(name)
    check_close(params, arrays("checkpoints.npz", f"{name}/after/"))
    check_close(log, arrays("checkpoints.npz", f"{name}/log/"))
    promise = "Models that earlier versions saved go on training as they did then."
    trust("golden-models", promise, topic="work", figure=1, unit="models", at_least=len(EXACT), over="sum")


@pytest.mark.slow
def test_a_model_whose_environment_can_not_tell_its_state_goes_on_with_a_warning():
    (name,) = CHECKPOINTS.keys() - set(EXACT)
    known = CHECKPOINTS[name]
    with pytest.warns(InexactResume):
        model = A2C.load(path_of(name), known["env"])
    check_close(by_path(model.learner.params), arrays("checkpoints.npz", f"{name}/before/"))
    model.learn(known["more"], progress_bar=False)
    assert model.num_timesteps == known["step"] + known["more"]
    model.close()


@pytest.mark.slow
def test_a_run_folder_goes_on_as_it_did(tmp_path):
    shutil.copytree(V1 / "run", tmp_path / "run")
    known = record("run.json")
    before = (tmp_path / "run" / "metrics.jsonl").read_text()
    command(*known["command"], "--algorithm", "a2c", cwd=tmp_path)  # which was the default
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


def curve(log, name):
    """One column of the log of `galton.train`."""
    return log.columns()[name]


POPULATIONS = record("bits.json")
OPTIMISED = ("lqr/hl-gauss",)


def trained(name):
    """A population's curves and parameters."""
    case = POPULATIONS[name]
    options = {key: case[key] for key in ("seeds", "total_timesteps", "n_logs", "n_eval_episodes")}
    agent = read({"loss": case["loss"]} | case["config"] | case["hypers"])
    result = galton.train(case["env"], agent, **options)
    golden = arrays("bits.npz", f"{name}/log/")
    return {column: curve(result.log, column) for column in golden}, by_path(result.learner.params)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.optimised] * (n in OPTIMISED)) for n in POPULATIONS],
)
def test_populations_train_as_they_did(name):
    log, params = trained(name)
    check_close(log, arrays("bits.npz", f"{name}/log/"))
    check_close(params, arrays("bits.npz", f"{name}/params/"))
