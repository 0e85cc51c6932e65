"""How records that know nothing of a command line are read from one."""

import dataclasses
import json
import math
import subprocess
import sys
from typing import NamedTuple

import pytest
import tyro

from galton import Config, Hypers
from galton.cli import _reading
from galton.types import Number


class Grown(NamedTuple):
    """Hypers as a later version may have them."""

    learning_rate: Number = 7e-4
    bound: Number = math.inf
    """The largest ratio."""
    floor: Number = -math.inf
    count: Number = 3


def read(*arguments):
    return tyro.cli(Grown, args=list(arguments), registry=_reading.REGISTRY)


def test_a_field_that_is_added_is_an_option_of_one_number():
    assert read() == Grown()
    assert read("--bound", "2.5", "--floor", "-1e3", "--count", "4") == Grown(7e-4, 2.5, -1000.0, 4.0)
    assert read("--bound", "inf", "--floor", "-inf") == Grown()


def test_its_docstring_is_the_help(capsys):
    with pytest.raises(SystemExit):
        read("--help")
    said = capsys.readouterr().out
    assert "--bound FLOAT" in said
    assert "The largest ratio. (default: inf)" in said


def parsed(*arguments):
    """What `galton train` makes of its arguments, in a process without the tests' checks of types."""
    script = (
        "import dataclasses, json, sys; from galton.cli._options import parse; from galton.cli.train import "
        "Options; options = parse(Options, 'train', sys.argv[1:]); kinds = [type(x).__name__ for x in "
        "(options.training.config, options.training.hypers)]; print(json.dumps([dataclasses.asdict(options), kinds]))"
    )
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def test_options_make_the_records_themselves():
    options, kinds = parsed("lqr", "--n-bins", "7", "--eta", "0.5", "--loss", "gaussian")
    assert kinds == ["Config", "Hypers"]
    assert options["loss"] == "gaussian"
    assert options["training"]["config"] == dataclasses.asdict(Config(n_bins=7)) | {"net_arch": [64, 64]}
    assert options["training"]["hypers"] == list(Hypers(eta=0.5))


def test_the_tasks_settings_are_the_defaults():
    training = parsed("bandit", "--n-steps", "6")[0]["training"]
    assert training["steps"] == 2_000
    assert (training["config"]["n_steps"], training["config"]["net_arch"]) == (6, [])
    assert training["hypers"][0] == 0.05
