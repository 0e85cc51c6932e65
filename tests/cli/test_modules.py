"""A module in the current folder runs if the command line names it, and never because a file does."""

import importlib
import json
import subprocess
import sys

import gymnasium
import pytest

from galton.cli._runs import environment_of
from galton.errors import UsageError
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study

OWN = """
import pathlib
pathlib.Path(__file__).with_suffix(".ran").touch()
import gymnasium
gymnasium.register("Own-v0", entry_point=lambda **kwargs: gymnasium.make("Pendulum-v1", **kwargs))
"""
SETTINGS = expand([{"n_steps": 5, "net_arch": [], "n_bins": 5, "loss": "gaussian"}], {})


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A current folder with two modules, as a process finds it whose path has no trace of it."""
    for name in ("in_the_folder", "beside_it"):
        (tmp_path / f"{name}.py").write_text(OWN)
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path != ""])
    importlib.invalidate_caches()
    yield tmp_path
    for name in ("in_the_folder", "beside_it"):
        sys.modules.pop(name, None)
    gymnasium.registry.pop("Own-v0", None)


def planned(folder, env="bandit", imports=()):
    Plan.create(Study(env, SETTINGS, 1, 10, 1, 0, imports=imports), 1).save(Store(str(folder / "sweep")))


def command(name, *arguments):
    more = {"shard": ["0"], "rerun": ["--to", "again"]}.get(name, [])
    importlib.import_module(f"galton_experiments.commands.sweep.{name}").main(["sweep", *more, *arguments])


def ran(folder):
    return {path.stem for path in folder.glob("*.ran")}


@pytest.mark.parametrize(
    ("name", "plan"),
    [
        *((name, {"imports": ("in_the_folder",)}) for name in ("status", "results", "shard", "rerun")),
        *((name, {"env": "in_the_folder:Own-v0"}) for name in ("shard", "rerun")),
    ],
)
def test_what_a_plan_names_is_not_looked_for_in_the_current_folder(here, name, plan):
    planned(here, **plan)
    with pytest.raises(UsageError, match=r"give --imports in_the_folder$"):
        command(name)
    assert not ran(here)


def test_that_another_module_was_typed_changes_nothing_and_a_plan_can_not_reach_the_folder_by_an_odd_name(here):
    for name in (".in_the_folder", "", "in_the_folder.py", "./in_the_folder"):
        planned(here, imports=(name,))
        with pytest.raises(UsageError, match="can't be imported"):
            command("status")
    assert not ran(here)
    planned(here, imports=("in_the_folder",))
    with pytest.raises(UsageError, match=r"imports names 'in_the_folder', .*give --imports in_the_folder$"):
        command("status", "--imports", "beside_it")
    assert ran(here) == {"beside_it"}


@pytest.mark.few
@pytest.mark.parametrize(
    ("name", "plan"),
    [
        ("status", {"imports": ("in_the_folder",)}),
        ("shard", {"imports": ("in_the_folder",)}),
        ("shard", {"env": "in_the_folder:Own-v0"}),
    ],
)
def test_what_was_typed_too_runs(here, name, plan, capsys):
    planned(here, **plan)
    command(name, "--imports", "in_the_folder")
    assert ran(here) == {"in_the_folder"}
    assert "shard" in capsys.readouterr().out


def test_so_does_what_lies_on_pythonpath(here, monkeypatch, capsys):
    planned(here, imports=("in_the_folder",))
    monkeypatch.syspath_prepend(here)
    command("status")
    assert ran(here) == {"in_the_folder"}
    assert "shards" in capsys.readouterr().out


@pytest.mark.few
@pytest.mark.parametrize(
    ("arguments", "code", "found"),
    [
        (["sweep", "status", "sweep"], 2, set()),
        (["sweep", "status", "sweep", "--imports", "in_the_folder"], 0, {"in_the_folder"}),
        (["sweep", "in_the_folder:Own-v0", "--plan-only", "--trials", "1"], 0, {"in_the_folder"}),
        (["sweep", "bandit", "--plan-only", "--imports", "beside_it"], 0, {"beside_it"}),
    ],
)
def test_the_command_itself_keeps_the_rule(here, arguments, code, found):
    planned(here, imports=("in_the_folder",))
    done = subprocess.run([sys.executable, "-m", "galton", *arguments], capture_output=True, text=True)
    assert (done.returncode, ran(here)) == (code, found), done.stderr


def test_a_runs_library_in_jax_brings_nothing_of_the_current_folder_and_its_own_module_must_be_named(here):
    def of_run(env, typed=None):
        (here / "config.json").write_text(json.dumps({"env": env, "env_kwargs": {}}))
        return environment_of(here / "model.safetensors", typed, None)

    before = [*sys.path]
    assert of_run("brax:ant") == ("brax:ant", {})
    with pytest.raises(UsageError, match="which imports a module; give it with --env if you trust it"):
        of_run("in_the_folder:Own-v0")
    assert sys.path == before
    of_run("in_the_folder:Own-v0", "in_the_folder:Own-v0")
    assert sys.path != before
