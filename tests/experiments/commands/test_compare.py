"""What is compared: losses with the settings of their task, and presets with those that were tuned for them."""

import json
import subprocess
import sys

import pytest

from galton.algorithms import find_algorithm
from galton.models.settings import all_words
from galton.presets import PAPER, Preset, find_preset
from galton_experiments.sweep.study import Setting

MADE_UP = {
    "classification": {"ppo": Preset("classification", "hl-gauss-centred", {"eta": 2.0})},
    "best": {"ppo": Preset("best", "hl-gauss-centred", {"n_envs": 4, "n_steps": 32, "eta": 3.0, "gamma": 0.9})},
    "gaussian": {"ppo": Preset("gaussian", "gaussian", {"log_std_init": -1.0, "learning_rate": 0.002})},
    PAPER: {},
}
PPO, A2C = (["Pendulum-v1", "--algorithm", name, "--losses"] for name in ("ppo", "a2c"))
ASKED = [
    [*PPO, "best", "gaussian", "hl-gauss"],
    [*PPO, "gaussian", "hl-gauss"],
    [*A2C, "best", "gaussian"],
    [*PPO, "best", "gaussian", "--gamma", "0.5", "--target-tails", "edges"],
    [*PPO, "bst"],
    [*PPO, "recommended", "gaussian"],
]
COMPARED = f"""
import json
from galton import UsageError, presets
from galton_experiments.commands import compare
from galton.presets import Preset
presets.PRESETS = compare.PRESETS = {MADE_UP!r}
for arguments in {ASKED!r}:
    options = compare.parse(compare.Options, "compare", arguments)
    try:
        found = compare._settings(dict(compare._compared(options, arguments)))
        print(json.dumps({{name: setting.record() for name, setting in found.items()}}))
    except UsageError as error:
        print(json.dumps(str(error)))
"""


@pytest.fixture(scope="module")
def compared():
    """The settings by their names for each of ASKED, from a process without the tests' checks of types."""
    done = subprocess.run([sys.executable, "-c", COMPARED], capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture
def of_model(monkeypatch):
    """What a model has of a preset and a loss, as a record."""
    monkeypatch.setattr("galton.presets.PRESETS", MADE_UP)

    def record(preset, loss=None, **typed):
        words = all_words(find_algorithm("ppo"), find_preset(preset, loss, "ppo"), None, typed, "Pendulum-v1")
        return json.loads(json.dumps(Setting(words).record()))

    return record


@pytest.mark.slow
def test_a_preset_brings_its_loss_and_its_settings_and_so_does_the_gaussian_beside_it(compared, of_model):
    assert compared[0] == {
        "hl-gauss-centred, preset best": of_model("best"),
        "gaussian, preset gaussian": of_model("gaussian"),
        "hl-gauss": of_model(PAPER, "hl-gauss"),
    }


def test_without_a_preset_beside_it_gaussian_is_the_loss(compared, of_model):
    assert compared[1] == {name: of_model(PAPER, name) for name in ("gaussian", "hl-gauss")}


def test_a_preset_of_another_algorithm_is_refused(compared):
    assert compared[2] == "preset is 'best', which is for ppo, not 'a2c'; take one of these algorithms"


def test_the_earlier_name_of_a_preset_is_that_preset(compared, of_model):
    assert compared[5] == {
        "hl-gauss-centred, preset classification": of_model("classification"),
        "gaussian, preset gaussian": of_model("gaussian"),
    }


def test_what_is_typed_goes_for_all_that_have_a_use_for_it(compared, of_model):
    typed = [of_model("best", gamma=0.5, target_tails="edges"), of_model("gaussian", gamma=0.5)]
    assert [*compared[3].values()] == typed


def test_a_word_that_is_neither_is_told_with_all_that_there_are(compared):
    assert compared[4].startswith("losses is 'bst'; choose from gaussian, hl-one-hot,")
    assert compared[4].endswith("best, paper; did you mean best?")
