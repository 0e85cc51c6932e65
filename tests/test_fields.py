"""Every setting is checked by its annotation, whichever way the value came."""

import json
import subprocess
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from galton import UsageError
from galton.agents import read
from galton.words import values_of
from galton_experiments.sweep.grid import expand
from galton_experiments.sweep.study import Setting

from .wrong_values import COUNTS, FLAGS, LISTS


@pytest.mark.slow
def test_a_value_of_another_type_is_refused_by_name_from_python_and_from_grids(tmp_path, trust):
    command = [sys.executable, "-W", "error", str(Path(__file__).with_name("wrong_values.py")), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    *wrong, n = done.stdout.splitlines() or [""]
    assert (wrong, done.stderr) == ([], "")
    assert int(n) > 400
    promise = "A setting of the wrong type is refused by name, from Python and from a grid alike."
    trust("wrong-values", promise, topic="damage", figure=int(n), unit="values refused", at_least=400)


@pytest.mark.parametrize(
    ("name", "given", "kept"),
    [
        *((name, np.True_, True) for name in (*FLAGS, "entropy_target")),
        *((name, np.int32(30), 30) for name in COUNTS),
        *((name, np.array([8, 4]), (8, 4)) for name in LISTS),
        *((name, range(3, 5), (3, 4)) for name in LISTS),
        *((name, [np.uint8(5)], (5,)) for name in LISTS),
        *((name, [], ()) for name in LISTS),
    ],
)
def test_numpys_values_are_kept_as_pythons(name, given, kept):
    found = values_of({name: given})[name]
    assert found == kept
    assert json.dumps(found)  # which knows no types of numpy's
    assert type(found) is type(kept)


@pytest.mark.parametrize(
    "number", [1, 0.5, np.float32(0.5), np.int64(1), np.array([0.5, 1.0]), jnp.ones(3), np.float64(1.0)]
)
def test_one_number_or_an_array_of_them_is_as_good(number):
    agent = read(dict.fromkeys(("gamma", "learning_rate", "eta", "log_std_min"), number))
    for found in (agent.algorithm.gamma, agent.optimizer.learning_rate, agent.loss.eta, agent.policy.log_std_min):
        np.testing.assert_array_equal(found, number)


def test_a_setting_is_one_run():
    with pytest.raises(UsageError, match=r"eta is .*; give one number"):
        Setting({"eta": np.ones(2)})
    assert len(expand([{"eta": [0.5, 1]}], {})) == 2
