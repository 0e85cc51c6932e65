"""Every field of the records of settings is checked by its annotation, whichever way the value came."""

import json
import subprocess
import sys
import typing
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from galton import Config, Hypers, UsageError
from galton.fields import AtLeast, Within, annotations, checked
from galton.sweep.grid import expand
from galton.sweep.study import Setting
from galton.types import check_hypers

FLAGS = [name for name, kind in annotations(Config).items() if kind is bool]
COUNTS = [name for name, kind in annotations(Config).items() if typing.get_origin(kind) is typing.Annotated]
CHOICES = [name for name, kind in annotations(Config).items() if typing.get_origin(kind) is typing.Literal]
NAMES = [name for name, kind in annotations(Config).items() if kind is str]


def test_every_field_is_of_a_kind_that_is_checked():
    assert {*FLAGS, *COUNTS, *CHOICES, *NAMES, "net_arch"} == {*annotations(Config)}
    assert all(isinstance(annotations(Config)[name].__metadata__[0], AtLeast) for name in COUNTS)
    assert all(isinstance(kind.__metadata__[0], Within) for kind in annotations(Hypers).values())


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
        *((name, np.True_, True) for name in FLAGS),
        *((name, np.int32(30), 30) for name in COUNTS),
        ("net_arch", np.array([8, 4]), (8, 4)),
        ("net_arch", range(3, 5), (3, 4)),
        ("net_arch", [np.uint8(5)], (5,)),
        ("net_arch", [], ()),
    ],
)
def test_numpys_values_are_kept_as_pythons(name, given, kept):
    found = checked(name, given, annotations(Config)[name])
    assert found == kept
    assert json.dumps(found)  # which knows no types of numpy's
    assert type(found) is type(kept)


@pytest.mark.parametrize(
    "number", [1, 0.5, np.float32(0.5), np.int64(1), np.array([0.5, 1.0]), jnp.ones(3), np.float64(1.0)]
)
def test_one_number_or_an_array_of_them_is_as_good(number):
    check_hypers(Hypers(**dict.fromkeys(("gamma", "learning_rate", "eta", "log_std_min"), number)))


def test_a_setting_is_one_run():
    with pytest.raises(UsageError, match=r"eta is .*; give one number"):
        Setting.of_record({"eta": np.ones(2)})
    assert len(expand([{"eta": [0.5, 1]}], {})) == 2
