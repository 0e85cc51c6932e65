import importlib.metadata
import json
import platform
from pathlib import Path

import pytest

import galton
from galton import UsageError
from galton.saving import provenance
from galton.saving.result_folder import check_free, claimed, read_settings, write_settings
from galton_experiments.commands.compare import result_folder


def fill(folder, text):
    (folder / "config.json").write_text(json.dumps({"versions": {}, "text": text}))


def text_of(folder):
    return json.loads((folder / "config.json").read_text())["text"]


def refused(match, path, overwrite):
    with pytest.raises(UsageError, match=match), result_folder(path, overwrite=overwrite):
        pass


@pytest.mark.parametrize("empty", [False, True])
def test_the_folder_appears_whole_where_there_is_none_or_an_empty_one(empty, tmp_path):
    if empty:
        (tmp_path / "out").mkdir()
    with result_folder(tmp_path / "out", overwrite=False) as folder:
        fill(folder, "new")
        assert not [*(tmp_path / "out").glob("*")]
        refused("another process is filling", tmp_path / "out", overwrite=False)
    assert text_of(tmp_path / "out") == "new"
    assert list(tmp_path.iterdir()) == [tmp_path / "out"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_error_leaves_what_was_there_and_overwriting_replaces_everything(error, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    fill(out, "old")
    (out / "metrics.jsonl").write_text("old")

    def fail():
        with result_folder(out, overwrite=True) as folder:
            fill(folder, "new")
            raise error

    with pytest.raises(error):
        fail()
    assert text_of(out) == "old"
    with result_folder(out, overwrite=True) as folder:
        fill(folder, "new")
    assert [path.name for path in out.iterdir()] == ["config.json"]
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize("other", ["notes.txt", "src", "model.safetensors.bak"])
def test_a_folder_with_something_else_in_it_is_not_overwritten(other, tmp_path):
    fill(tmp_path, "old")
    (tmp_path / other).mkdir()
    refused(f"which also holds {other}", tmp_path, True)
    assert text_of(tmp_path) == "old"


@pytest.mark.parametrize("settings", ['{"theirs": 1}', '{"versions": 3}', "[]", "{}", "junk"])
def test_a_config_json_of_somebody_elses_makes_no_folder_of_results(settings, tmp_path):
    (tmp_path / "config.json").write_text(settings)
    refused(r"config\.json|not a folder of results", tmp_path, True)
    assert (tmp_path / "config.json").read_text() == settings


def test_results_survive_when_somebody_fills_the_folder_meanwhile(tmp_path):
    def meet():
        with result_folder(tmp_path / "out", overwrite=False) as folder:
            fill(folder, "ours")
            (tmp_path / "out").mkdir()
            fill(tmp_path / "out", "theirs")

    with pytest.raises(UsageError, match="the results are in"):
        meet()
    assert {text_of(path) for path in tmp_path.iterdir()} == {"ours", "theirs"}


def test_the_remains_of_a_killed_process_are_cleared_and_nothing_else(tmp_path):
    for name in (".out.galton-dead", ".out.backup", ".other.galton-x"):
        (tmp_path / name).mkdir()
    with result_folder(tmp_path / "out", overwrite=False) as folder:
        fill(folder, "new")
    assert {path.name for path in tmp_path.iterdir()} == {"out", ".out.backup", ".other.galton-x"}


def test_a_folder_with_hidden_files_of_somebodys_is_not_replaced(tmp_path):
    (tmp_path / "out").mkdir()
    fill(tmp_path / "out", "old")
    for name in (".DS_Store", ".nfs01", ".writing-host-1-ab.png"):
        (tmp_path / "out" / name).touch()
    check_free(tmp_path / "out", True)
    (tmp_path / "out" / ".notes.md").touch()
    refused("which also holds .notes.md", tmp_path / "out", True)


def test_a_file_in_the_way_and_a_name_that_is_too_long_are_named(tmp_path):
    fill(tmp_path, "mine")
    file, long = tmp_path / "config.json", "can't be written: File name too long"
    refused("which is a file", file, True)
    refused("can't be written", file / "out", True)
    with pytest.raises(UsageError, match=long):
        check_free(tmp_path / ("n" * 300), False)
    with pytest.raises(UsageError, match=long), claimed(tmp_path / ("n" * 252)):
        pass


def test_what_a_process_killed_between_two_renames_set_aside_is_put_back(tmp_path):
    (tmp_path / ".out.galton-dead" / "old").mkdir(parents=True)
    fill(tmp_path / ".out.galton-dead" / "old", "precious")

    def fail():
        with result_folder(tmp_path / "out", overwrite=False):
            raise RuntimeError

    with pytest.raises(UsageError, match="which is there already"):
        fail()
    assert text_of(tmp_path / "out") == "precious"


def test_settings_come_back_with_what_made_them_and_something_else_is_a_usage_error(tmp_path):
    assert read_settings(tmp_path) == {}
    write_settings(tmp_path, {"env": "lqr", "env_kwargs": {"noise_std": 0.5}})
    known = read_settings(tmp_path)
    assert (known["env"], known["env_kwargs"]) == ("lqr", {"noise_std": 0.5})
    assert known["versions"]["galton"]
    assert known["machine"]
    for text in ("", "{", "[1]", '"env"', "[" * 100_000):
        (tmp_path / "config.json").write_text(text)
        with pytest.raises(UsageError, match=r"config\.json"):
            read_settings(tmp_path)


def test_a_claim_ends_with_its_block_and_leaves_no_trace(tmp_path):
    out, told = tmp_path / "new" / "out", "another process is filling"
    for _ in range(2):
        with claimed(out), pytest.raises(UsageError, match=told), claimed(out):
            pass
        assert list((tmp_path / "new").iterdir()) == []


def test_only_folders_of_results_are_overwritten(tmp_path, monkeypatch):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter").write_text("precious")
    refused("not a folder of results", tmp_path / "thesis", True)
    fill(tmp_path, "mine")
    monkeypatch.chdir(tmp_path / "thesis")
    refused("the current folder is in", tmp_path, True)
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    refused("the current folder is in", Path(), False)
    assert (tmp_path / "thesis" / "chapter").read_text() == "precious"


def test_versions_are_those_of_what_is_installed():
    known = provenance.versions("pytest", "no-such-package")
    assert known["galton"] == galton.__version__
    for name in {*provenance.PACKAGES, "pytest"} - {"galton"}:
        assert known[name] == importlib.metadata.version(name)
    assert known["no-such-package"] is None
    assert known["python"] == platform.python_version()
    assert list(provenance.versions())[-2:] == ["commit", "python"]


def test_the_commit_is_that_of_this_checkout_or_none_and_the_machine_has_a_name():
    commit = provenance.commit()
    assert commit is None or len(commit.removesuffix("-dirty")) >= 12
    assert platform.node() in provenance.machine()
