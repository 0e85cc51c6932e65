"""What `galton compare` and `galton sweep` have computed outlives the disk, the reader and the folder."""

import errno
import os
from pathlib import Path

import pytest

from galton.cli._options import Training
from galton.errors import UsageError
from galton.saving import files
from galton.saving.checkpoint import read
from galton_experiments.commands import compare
from galton_experiments.commands.sweep import _folder, status
from galton_experiments.sweep import results
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import work
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study

from .test_output import galton, unread_pipe


def no_room(*_, **__):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def galton_compare(out, **options):
    """What `galton compare bandit` does with these options; tyro can't read them where types are checked."""
    training = Training(100, 2, 0, words=Training.of_task("bandit").words)
    usual = {"training": training, "losses": ("gaussian",), "seeds": 2, "out": Path(out)}
    options = compare.Options("bandit", **{**usual, **options})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compare, "parse", lambda *_, **__: options)
        compare.main([])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "broken"), [(files, "write"), (compare, "write_settings"), (compare, "save"), (files, "replacing")]
)
def test_a_comparison_that_no_disk_takes_is_still_shown(where, broken, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(where, broken, no_room)
    with pytest.raises(UsageError, match=r"out is .*, which can't be written: No space left on device"):
        galton_compare(tmp_path / "out")
    told = capsys.readouterr().out
    assert "Gaussian" in told
    assert "final returns: mean over runs" in told
    assert "figure and numbers" not in told
    assert list(tmp_path.iterdir()) == []


def test_a_comparison_is_not_begun_where_its_last_loss_cannot_be_trained(tmp_path, monkeypatch):
    monkeypatch.setattr(compare, "train", no_room)
    training = Training(100, 2, 0, words={"weighting": "awr", "negative_target": "one-hot"})
    with pytest.raises(UsageError, match="with weighting 'awr' no weight is negative"):
        galton_compare(tmp_path / "out", training=training, losses=("gaussian", "hl-gauss"))


def test_a_comparison_that_could_not_be_kept_or_has_too_many_seeds_is_not_begun(tmp_path, monkeypatch):
    monkeypatch.setattr(compare, "train", no_room)
    for out in ("n" * 300, "/proc/galton", "/dev/null/x"):
        with pytest.raises(UsageError, match="can't be written"):
            galton_compare(out)
    with pytest.raises(UsageError, match="seeds is 10000000000 of them, too many"):
        galton_compare(tmp_path / "out", seeds=10**10)
    assert list(tmp_path.iterdir()) == []


WORDS = ["bandit", "--algorithm", "a2c", "--steps", "100", "--logs", "2", "--eval-episodes", "0"]


@pytest.mark.slow
def test_a_run_whose_reader_goes_away_is_kept(tmp_path):
    write = unread_pipe()
    done = galton("train", *WORDS, "--out", tmp_path / "run", stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")
    assert read(tmp_path / "run" / "model.safetensors")[0]["step"] == 100


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A sweep that is done, in a folder whose name rich takes for markup."""
    out = tmp_path_factory.mktemp("sweep") / "x[" / "y]"
    settings = expand([{"loss": "gaussian", "n_steps": 5, "net_arch": (), "learning_rate": 0.01}], {})
    store, plan = Store(str(out)), Plan.create(Study("bandit", settings, 2, 50, logs=1, eval_episodes=0), 2)
    plan.save(store)
    work(store.url, 0)
    results.save(store, results.collect(store, plan))
    return store


@pytest.mark.slow
def test_results_are_shown_where_nothing_can_be_written(trained, monkeypatch, capsys):
    """A sweep that has its results needs nothing written; another shows them too, and says why it can't keep them."""
    monkeypatch.setattr(files, "write", no_room)
    plan = _folder.load(trained, ())
    _folder.conclude(trained, plan)
    shown = capsys.readouterr().out
    assert "learning rate" in shown
    assert f"2 runs: {trained.url}/results.parquet\n" in shown
    monkeypatch.setattr(results, "FILE", "other.parquet")
    with pytest.raises(UsageError, match="there is no room left"):
        _folder.conclude(trained, plan)
    assert "learning rate" in capsys.readouterr().out


def test_results_of_more_runs_replace_those_that_are_there_and_status_shows_the_folder(trained, capsys, monkeypatch):
    before = trained.read(results.FILE)
    trained.write(results.FILE, b"of fewer")
    results.save(trained, results.collect(trained, Plan.load(trained)))
    assert trained.read(results.FILE) == before
    monkeypatch.setattr(status, "read_options", lambda *_: _folder.Folder(trained.url))
    status.main([])
    assert f"{trained.url}: bandit\n" in capsys.readouterr().out
