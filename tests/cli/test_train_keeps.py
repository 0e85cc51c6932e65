"""`galton train` and a run folder: whatever fails, and whenever, what was learnt and what was there is kept."""

import dataclasses
import errno
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from galton import A2C
from galton.callbacks import Evaluate, JSONLines, TensorBoard
from galton.cli import train
from galton.cli._options import Training
from galton.envs.find import find
from galton.errors import UsageError
from galton.models import Model
from galton.models.file import Taken
from galton.saving import files
from galton.saving.checkpoint import read
from galton.saving.result_folder import write_settings

from ..envs.host.walks import Walk


def small(steps=100, env_kwargs="{}", **words):
    usual = Training.of_task("bandit")
    words = usual.words | {"n_bins": 4, **words}
    return dataclasses.replace(usual, steps=steps, logs=4, eval_episodes=1, env_kwargs=env_kwargs, words=words)


def galton_train(out, **options):
    """What `galton train bandit` does with these options; tyro can't read them where types are checked."""
    named = {"env": "bandit", "loss": "hl-gauss", "preset": "paper", "training": small(), "out": Path(out)}
    options = train.Options(**named | options)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "parse", lambda *_, **__: options)
        train.main([])


def content(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """The files of a run that is done."""
    out = tmp_path_factory.mktemp("earlier") / "run"
    galton_train(out)
    return content(out)


def put_in(out, earlier):
    for name, data in earlier.items():
        files.write(out / name, data)


def no_room(*_, **__):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


FAILURES = {
    "config.json": lambda patch: patch.setattr(train, "write_settings", no_room),
    "the model": lambda patch: patch.setattr(files, "write", no_room),
    "the log": lambda patch: patch.setattr(files, "append_line", no_room),
    "the log's file": lambda patch: patch.setattr(JSONLines, "__init__", no_room),
    "TensorBoard's file": lambda patch: patch.setattr(TensorBoard, "__init__", no_room),
    "an evaluation": lambda patch: patch.setattr(Evaluate, "__call__", no_room),
    "a save on the way": lambda patch: patch.setattr(train._Saving, "__call__", no_room),
    "the first update": lambda patch: patch.setattr(Model, "advance", no_room),
    "the making of the model": lambda patch: patch.setattr(Model, "of", no_room),
    "the end": lambda patch: patch.setattr(Taken, "save", fails_from(3, Taken.save)),
}


def fails_from(number, call):
    """A call that has room until that time."""
    times = []

    def limited(*arguments):
        times.append(1)
        return no_room() if len(times) >= number else call(*arguments)

    return limited


@pytest.mark.few
@pytest.mark.parametrize("failure", FAILURES)
def test_there_is_a_whole_run_at_any_time(failure, earlier, tmp_path, monkeypatch):
    """The earlier one to the byte, or the new one with its settings and what it has learnt; and nothing beside it."""
    out = tmp_path / "run"
    put_in(out, earlier)
    FAILURES[failure](monkeypatch)
    with pytest.raises((UsageError, OSError), match="No space left"):
        galton_train(out, seed=5, tensorboard=True, overwrite=True, save_every=25)
    monkeypatch.undo()
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    if content(out) != earlier:
        settings, _ = read(out / "model.safetensors")
        assert settings["seed"] == json.loads((out / "config.json").read_text())["seed"] == 5
        assert settings["step"] >= 25
    galton_train(out, seed=5, overwrite=True)


@pytest.mark.parametrize("failure", ["config.json", "the model", "the making of the model", "the first update"])
def test_a_beginning_that_fails_leaves_the_folder_free(failure, tmp_path, monkeypatch):
    FAILURES[failure](monkeypatch)
    with pytest.raises((UsageError, OSError), match="No space left"):
        galton_train(tmp_path / "run")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("failure", ["the log", "an evaluation", "TensorBoard's file", "the log's file"])
def test_what_was_learnt_before_it_failed_is_gone_on_with(failure, tmp_path, monkeypatch, capsys):
    out = tmp_path / "run"
    FAILURES[failure](monkeypatch)
    with pytest.raises((UsageError, OSError), match="No space left"):
        galton_train(out, tensorboard=True)
    monkeypatch.undo()
    assert read(out / "model.safetensors")[0]["step"] == 25
    galton_train(out, resume=True)
    assert read(out / "model.safetensors")[0]["step"] == 100


def test_a_resumed_run_keeps_the_best_model_that_it_had(tmp_path, monkeypatch):
    out, means = tmp_path / "run", iter([4.0, 9.0, 3.0, 2.0, 8.0, 7.0, 8.5, 6.0])
    monkeypatch.setattr(Model, "evaluate", lambda self, n_episodes, *_: np.full(n_episodes, next(means)))
    galton_train(out)
    best = (out / "best_model.safetensors").read_bytes()
    galton_train(out, training=small(steps=200), resume=True)
    assert (out / "best_model.safetensors").read_bytes() == best
    last = json.loads((out / "metrics.jsonl").read_text().splitlines()[-1])
    assert (last["time/total_timesteps"], last["eval/mean_reward"], last["eval/best_mean_reward"]) == (200, 6.0, 9.0)


@pytest.mark.parametrize(
    "options",
    [
        {"training": small(steps=99999999999)},
        {"training": small(n_envs=10**11)},
        {"training": small(net_arch=(10**11,))},
        *({"out": out} for out in ("/proc", "/proc/galton", "/dev/null/run", "n" * 300, "d/" * 3000 + "run")),
        *({"save_every": 0}, {"resume": True}, {"loss": "mse"}),
    ],
    ids=lambda options: str(*options),
)
def test_what_can_be_known_is_refused_before_anything_is_made(options, tmp_path, monkeypatch):
    def made(*_):
        raise AssertionError("a model was made")

    monkeypatch.setattr(Model, "of", made)
    monkeypatch.chdir(tmp_path)
    said = "where a disk is mounted; name a folder in it" if options.get("out") == "/proc" else None
    with pytest.raises(UsageError, match=said) as told:
        galton_train(**{"out": "run", **options})
    assert "another process" not in str(told.value)
    assert list(tmp_path.iterdir()) == []


LIMITED = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (9_000, 9_000))
from galton.cli.main import main
main()
"""
"""A command none of whose files can grow beyond 9,000 bytes: what a disk that is full does to them."""


@pytest.mark.slow
def test_a_disk_that_fills_up_is_told_in_a_line_and_the_model_is_kept(tmp_path):
    out = tmp_path / "run"
    words = f"train bandit --algorithm a2c --steps 500 --logs 100 --eval-episodes 0 --out {out}".split()
    # Files that others share, of programs and of lines that were run, can not grow either, which is not what is asked.
    elsewhere = ("JAX_COMPILATION_CACHE_DIR", "COVERAGE_PROCESS_CONFIG")
    environment = {name: value for name, value in os.environ.items() if name not in elsewhere}
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, *words],
        capture_output=True,
        text=True,
        timeout=120,
        env=environment | {"GALTON_PROGRAMS": "off"},
    )
    assert done.returncode == 2
    assert done.stderr.startswith(f"galton: path is {out / 'metrics.jsonl'}, which can't be written: File")
    assert done.stderr.count("\n") == 1, done.stderr
    lines = (out / "metrics.jsonl").read_text().splitlines()
    steps = [json.loads(line)["time/total_timesteps"] for line in lines]
    assert read(out / "model.safetensors")[0]["step"] == steps[-1] + 5
    assert A2C.load(out / "model.safetensors", "bandit").num_timesteps > 0


class Slope(Walk):
    def __init__(self, angle=1.0):
        self.angle = angle


@pytest.fixture
def slopes():
    for name in ("Slope-v0", "Incline-v0"):
        gymnasium.register(name, Slope)
    yield
    for name in ("Slope-v0", "Incline-v0"):
        del gymnasium.registry[name]


def environments(folder, known, name, constants):
    """The two environments that a resumed run compares."""
    write_settings(folder, known)
    options = train.Options(name, small(env_kwargs=json.dumps(constants)), out=folder)
    return train._environments(options, find(name, **constants))


@pytest.mark.usefixtures("slopes")
@pytest.mark.parametrize(
    ("name", "constants", "again", "others", "same"),
    [
        ("bandit", {}, "bandit", {"noise_std": 3.0}, False),
        ("bandit", {"d": 3}, "bandit", {"d": 2}, False),
        ("lqr", {}, "bandit", {}, False),
        ("Slope-v0", {}, "Incline-v0", {}, False),
        ("Slope-v0", {}, "Slope-v0", {"angle": 2.0}, False),
        ("Slope-v0", {"angle": [1.0]}, "Slope-v0", {"angle": [1.0, 2.0]}, False),
        ("bandit", {}, "Slope-v0", {}, False),
        ("Slope-v0", {}, "bandit", {}, False),
        ("bandit", {}, "bandit", {}, True),
        ("bandit", {}, "galton/Bandit-v0", {"noise_std": 1.0}, True),
        ("galton/LQR-v0", {}, "lqr", {}, True),
        ("Slope-v0", {"angle": [1.0]}, "Slope-v0", {"angle": [1.0]}, True),
        ("json:Slope-v0", {}, "Slope-v0", {}, True),
    ],
)
def test_resuming_notices_another_environment_and_the_same_may_be_called_otherwise(
    name, constants, again, others, same, tmp_path
):
    own, other = environments(tmp_path, {"env": name, "env_kwargs": constants}, again, others)
    assert (own == other) == same


def test_where_nobody_knows_the_environment_the_spaces_decide(tmp_path):
    for known in ({}, {"env": 5, "env_kwargs": {}}, {"env": "lqr"}, {"env": "lqr", "env_kwargs": 1}):
        own, other = environments(tmp_path, known, "bandit", {})
        assert own == other


def test_a_resumed_run_in_another_environment_is_refused_and_left_alone(earlier, tmp_path):
    out = tmp_path / "run"
    put_in(out, earlier)
    with pytest.raises(UsageError, match=r"env is Bandit\(d=2, noise_std=3.0\), but the run in"):
        galton_train(out, training=small(200, env_kwargs='{"noise_std": 3.0}'), resume=True)
    assert content(out) == earlier


def test_a_resumed_run_with_another_setting_is_refused_and_left_alone(earlier, tmp_path):
    out = tmp_path / "run"
    put_in(out, earlier)
    with pytest.raises(UsageError, match="give the same options to resume it"):
        galton_train(out, training=small(200, eta=0.5), resume=True)
    assert content(out) == earlier


def test_a_resumed_run_says_what_it_is_now(earlier, tmp_path, monkeypatch):
    out = tmp_path / "run"
    put_in(out, earlier)
    fewer = dataclasses.replace(small(200), eval_episodes=3)
    with pytest.raises(UsageError, match=r"eval_episodes is 3, but the run in .* has \d+; give the same options"):
        galton_train(out, training=fewer, resume=True)
    assert content(out) == earlier
    monkeypatch.setattr(sys, "argv", ["galton", "train", "--resume"])
    galton_train(out, training=small(200), resume=True)
    now = json.loads((out / "config.json").read_text())
    assert (now["steps"], now["command"]) == (200, "galton train --resume")


def test_a_path_is_printed_as_it_is(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Model, "learn", lambda model, *_, **__: model)
    monkeypatch.chdir(tmp_path)
    for name in ("x[/y]", "x[bold]y", "[link=a]", ":smile:", "x[y", "%s{0}"):
        galton_train(name)
        assert f"run folder: {name}\n" in capsys.readouterr().out


def test_what_a_policy_has_to_beat_is_told_once_and_in_the_end_if_it_does_not(tmp_path, capsys):
    galton_train(tmp_path / "whole", training=small(200))
    told = capsys.readouterr().out.splitlines()
    first, *others = [json.loads(line) for line in (tmp_path / "whole" / "metrics.jsonl").read_text().splitlines()]
    rest, random = first["eval/doing_nothing"], first["eval/random_actions"]
    assert told[0] == f"doing nothing returns {rest:,.2f}, random actions {random:,.2f} (3 episodes of each)"
    assert not any("eval/doing_nothing" in other for other in others)
    assert ("is below that of" in told[-1]) == (others[-1]["eval/mean_reward"] < max(rest, random))
    galton_train(tmp_path / "cut", training=small(100))
    galton_train(tmp_path / "cut", training=small(200), resume=True)
    again = [json.loads(line) for line in (tmp_path / "cut" / "metrics.jsonl").read_text().splitlines()]
    assert [line.get("eval/doing_nothing") for line in again] == [rest] + [None] * (len(again) - 1)


def test_a_policy_that_ends_below_doing_nothing_is_said_to_in_the_last_line(tmp_path, capsys):
    galton_train(tmp_path / "run", training=small(5), loss="hl-gauss")
    last = capsys.readouterr().out.splitlines()[-1]
    assert re.search("the policy's return of.* is below that of.*`galton check bandit`", last)
