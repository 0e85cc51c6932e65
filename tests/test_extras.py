"""What is not installed is named by the extra that brings it, and the core works without any extra."""

import importlib.metadata
import json
import re
import subprocess
import sys
import tomllib
import urllib.request
from pathlib import Path

import pytest

import galton
from galton import MissingExtraError, extras
from galton.envs.others import MODULES

ROOT = Path(galton.__file__).parent
PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"
DISTRIBUTIONS = {"PIL": "pillow", "Box2D": "box2d", "pygame": "pygame-ce", "mujoco_playground": "playground"}
DISTRIBUTIONS |= {"mujoco.mjx": "mujoco-mjx"}
"""The name of a library on the package index, where it is another."""

# Runs commands and lines of Python in one process, as one in which these libraries were not installed.
WITHOUT = """
import contextlib, io, json, sys
hidden, asked = json.load(sys.stdin)

class Without:
    def __init__(self, finder):
        self.finder = finder
    def __getattr__(self, name):
        return getattr(self.finder, name)
    def find_spec(self, name, path=None, target=None):
        return None if name.partition(".")[0] in hidden else self.finder.find_spec(name, path, target)

sys.meta_path[:] = [Without(finder) for finder in sys.meta_path]
from galton.cli import main
from galton.errors import UsageError
for call in asked:
    said, done, sys.argv = io.StringIO(), io.StringIO(), ["galton", *call]
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(done):
        if isinstance(call, list):
            code = main._run(call[0], call[1:])
        else:
            try:
                code = exec(call, {})
            except UsageError as error:
                code = f"{type(error).__name__}: {error}"
    print(json.dumps([code, said.getvalue()]))
"""

STUDIES = f"{extras.installing('experiments')}\n"
FEW = ["--algorithm", "a2c", "--steps", "200", "--logs", "1"]
FEW += ["--eval-episodes", "1", "--net-arch", "4", "--n-bins", "5"]
EXPORT = "import galton.deploy; galton.deploy.export(galton.A2C('bandit'), 'policy')"
WANDB = "import galton; galton.callbacks.WeightsAndBiases()"

CORE = [
    (["--version"], 0, ""),
    (["train", "bandit", "--out", "run", *FEW, "--tensorboard"], 0, ""),
    (["export", "run", "--format", "card"], 0, ""),
    (["compare", "bandit"], 2, f"galton: compare needs pyarrow and matplotlib: {STUDIES}"),
    (["sweep", "bandit"], 2, f"galton: sweep needs pyarrow and fsspec: {STUDIES}"),
    (["sweep", "status", "x"], 2, f"galton: sweep status needs pyarrow and fsspec: {STUDIES}"),
    (
        ["watch", "run", "--out", "x.mp4"],
        2,
        f"galton: --out is x.mp4, which needs imageio_ffmpeg: {extras.installing('video')}\n",
    ),
    (["watch", "run", "--out", "x.gif"], 2, f"galton: --out is x.gif, which needs PIL: {extras.installing('video')}\n"),
    (["watch", "run"], 2, f"galton: watch needs imageio_ffmpeg: {extras.installing('video')}\n"),
    (["watch", "nothing"], 2, "galton: run is nothing, which does not exist\n"),
    (
        ["train", "Reacher-v5", *FEW],
        2,
        f"galton: environment 'Reacher-v5' needs mujoco and imageio: {extras.installing('mujoco')}\n",
    ),
    (
        ["train", "LunarLanderContinuous-v3", *FEW],
        2,
        f"galton: environment 'LunarLanderContinuous-v3' needs Box2D: {extras.installing('box2d')}\n",
    ),
    *(
        (
            ["train", f"{library}:Task", *FEW],
            2,
            f"galton: environment '{library}:Task' needs {needed}: {extras.installing(library)}\n",
        )
        for library, needed in (*{"gymnax": "gymnax", "brax": "brax"}.items(), *MODULES.items())
    ),
    (["benchmark", "my.toml"], 2, f"galton: benchmark needs pyarrow and matplotlib: {STUDIES}"),
    (["export", "run", "--format", "onnx"], 2, f"galton: the format onnx needs onnx: {extras.installing('onnx')}\n"),
    (EXPORT, f"MissingExtraError: the format onnx needs onnx: {extras.installing('onnx')}", ""),
    ("import galton.torch", f"MissingExtraError: galton.torch needs torch: {extras.installing('torch')}", ""),
    (WANDB, f"MissingExtraError: WeightsAndBiases needs wandb: {extras.installing('wandb')}", ""),
    (
        "from galton_experiments import sweep; sweep.Study",
        f"MissingExtraError: galton_experiments.sweep needs pyarrow and fsspec: {extras.installing('experiments')}",
        "",
    ),
]
"""What is asked of an environment with the core alone; the exit code or the error; and what stands on stderr."""

WITH_STUDIES = [
    (
        ["sweep", "bandit", "--scheduler", "tcp://h:1"],
        2,
        f"galton: a scheduler needs distributed: {extras.installing('cluster')}\n",
    ),
]


def answers(hidden, asked, folder):
    """What each call came to where these libraries can't be found, in one process."""
    given = json.dumps([hidden, [call for call, _, _ in asked]])
    done = subprocess.run([sys.executable, "-c", WITHOUT], input=given, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    return answers(list(extras.LIBRARIES), CORE, tmp_path_factory.mktemp("bare"))


@pytest.fixture(scope="module")
def with_studies(tmp_path_factory):
    hidden = [library for library, extra in extras.LIBRARIES.items() if extra == "cluster"]
    return answers(hidden, WITH_STUDIES, tmp_path_factory.mktemp("studies"))


def name_of(call):
    return " ".join(call[:4]) if isinstance(call, list) else call


@pytest.mark.slow
@pytest.mark.parametrize("index", range(len(CORE)), ids=[name_of(call) for call, _, _ in CORE])
def test_the_core_alone_works_or_names_the_extra_in_one_line(index, bare):
    assert bare[index] == list(CORE[index][1:])


@pytest.mark.slow
@pytest.mark.parametrize("index", range(len(WITH_STUDIES)), ids=["cluster"])
def test_a_sweep_names_the_extra_that_an_option_needs(index, with_studies):
    assert with_studies[index] == list(WITH_STUDIES[index][1:])


def test_every_extra_is_missed_once():
    said = " ".join(f"{code} {line}" for _, code, line in [*CORE, *WITH_STUDIES])
    assert set(re.findall(r"pip install \S+\[(\w+)\]", said.replace("-e ", ""))) == set(extras.LIBRARIES.values())


def test_libraries_and_their_extras_are_those_of_pyproject():
    project = tomllib.loads(PYPROJECT.read_text())["project"]
    for library, extra in extras.LIBRARIES.items():
        wanted = DISTRIBUTIONS.get(library, library).replace("_", "-")
        there = [re.split(r"[<>=]", line)[0].replace("_", "-") for line in project["optional-dependencies"][extra]]
        assert wanted in there, f"{library} is not in the extra {extra}"
        core = [re.split(r"[<>=]", line)[0] for line in project["dependencies"]]
        assert wanted not in core


INSTALLED = {
    "an editable folder": ({"url": "file://PLACE", "dir_info": {"editable": True}}, "pip install -e 'PLACE[video]'"),
    "a folder": ({"url": "file://PLACE", "dir_info": {}}, "pip install 'PLACE[video]'"),
    "a wheel": ({"url": "file://PLACE/galton.whl", "archive_info": {}}, "pip install 'PLACE/galton.whl[video]'"),
    "a folder that is gone": ({"url": "file://PLACE/gone", "dir_info": {}}, "pip install 'galton[video]'"),
    "a repository": ({"url": "https://example.org/galton.git", "vcs_info": {}}, "pip install 'galton[video]'"),
    "an index": (None, "pip install 'galton[video]'"),
}
"""What pip notes of where Galton came from, and the command that installs an extra from there."""


@pytest.mark.parametrize("came", INSTALLED)
def test_an_extra_is_installed_from_where_galton_came(came, tmp_path, monkeypatch):
    noted, told = INSTALLED[came]
    place = tmp_path / "a folder"
    place.mkdir()
    (place / "galton.whl").touch()

    class Installed(importlib.metadata.PathDistribution):
        def read_text(self, name):
            assert name == "direct_url.json"
            return noted and json.dumps(noted).replace("PLACE", urllib.request.pathname2url(str(place)))

    monkeypatch.setattr(importlib.metadata, "distribution", lambda _: Installed(place))
    assert extras.installing("video") == told.replace("PLACE", str(place))


def test_where_nothing_is_installed_an_extra_has_the_name_of_the_package(monkeypatch):
    def distribution(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", distribution)
    assert extras.installing("video") == "pip install 'galton[video]'"


def test_a_library_that_is_there_and_can_not_be_loaded_is_told_with_the_cause():
    with (
        pytest.raises(MissingExtraError, match=r"^it needs onnx: pip install .*\[onnx\]' \(no such symbol\)$"),
        extras.needed("it", "onnx"),
    ):
        raise ImportError("no such\nsymbol")


@pytest.mark.parametrize(
    ("told", "extra"),
    [
        ('MuJoCo is not installed, run `pip install "gymnasium[mujoco]"`', "mujoco"),
        ("pygame is not installed, run `pip install swig`", "video"),
    ],
)
def test_gymnasiums_advice_is_said_in_our_extras(told, extra, monkeypatch):
    for library in ("mujoco", "pygame"):
        monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingExtraError, match=rf"^watching needs \w+: pip install .*\[{extra}\]'$"):
        extras.check_named("watching", RuntimeError(told))


def test_another_librarys_error_is_left_alone():
    extras.check_named("watching", RuntimeError("mujoco and pygame are there; box2d is not"))
