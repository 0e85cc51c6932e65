"""How records that know nothing of a command line are read from one."""

import dataclasses
import json
import math
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import tyro

from galton import UsageError
from galton.cli import _reading, _registry
from galton.cli._options import folder_name
from galton.cli._parsing import parse
from galton.cli.train import Options
from galton.types import Number
from galton.words import vocabulary, without_idle


class Grown(NamedTuple):
    """Numbers as a part may have them."""

    learning_rate: Number = 7e-4
    bound: Number = math.inf
    """The largest ratio."""
    floor: Number = -math.inf
    count: Number = 3


def read(*arguments):
    return tyro.cli(Grown, args=list(arguments), registry=_registry.REGISTRY)


def test_a_field_that_is_added_is_an_option_of_one_number_and_its_docstring_the_help(capsys):
    assert read() == Grown()
    assert read("--bound", "2.5", "--floor", "-1e3", "--count", "4") == Grown(7e-4, 2.5, -1000.0, 4.0)
    assert read("--bound", "inf", "--floor", "-inf") == Grown()
    with pytest.raises(SystemExit):
        read("--help")
    said = capsys.readouterr().out
    assert "--bound FLOAT" in said
    assert "The largest ratio. (default: inf)" in said


def parsed(*arguments):
    """What `galton train` makes of its arguments, in a process without the tests' checks of types."""
    script = (
        "import dataclasses, json, sys; from galton.cli._parsing import parse; from galton.cli.train import "
        "Options; options = parse(Options, 'train', sys.argv[1:]); kind = type(options.training).__name__; "
        "print(json.dumps([dataclasses.asdict(options), kind]))"
    )
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.slow
def test_options_make_the_training_itself_with_the_words_of_every_part():
    options, kind = parsed("lqr", "--algorithm", "a2c", "--n-bins", "7", "--eta", "0.5", "--loss", "gaussian")
    assert kind == "Training"
    assert options["loss"] == "gaussian"
    typed = {"loss": "gaussian", "n_bins": 7, "eta": 0.5}
    used = without_idle(vocabulary().usual | typed, vocabulary().usual)
    assert options["training"]["words"] == used | {"net_arch": [64, 64], "ordered": [], "per_entry": []}
    training = parsed("bandit", "--algorithm", "a2c", "--n-steps", "6")[0]["training"]
    assert training["steps"] == 2_000, "the task's settings are the defaults"
    assert [training["words"][name] for name in ("n_steps", "net_arch", "learning_rate")] == [6, [], 0.05]


def test_a_setting_that_no_part_uses_is_refused_where_nobody_named_the_loss():
    for typed in (["--n-bins", "5"], ["--preset", "gaussian", "--eta", "2"]):
        with pytest.raises(
            UsageError, match=rf"^{typed[-2][2:].replace('-', '_')} is [25].*; it goes with .*, not 'ga"
        ):
            parse(Options, "train", ["lqr", *typed])
    words = parse(Options, "train", ["lqr", "--preset", "classification", "--n-bins", "5"]).training.words
    assert words["n_bins"] == 5


WRITTEN = {"1e5": 10**5, "100_000": 10**5, "2E3": 2_000, "1.5e3": 1_500, "12.0": 12, "-1": -1, "+7": 7, "0": 0}


def test_an_integer_may_be_written_as_people_write_it_and_what_is_none_is_refused_at_once():
    for text, number in (WRITTEN | {"1e10": 10**10}).items():
        found = _registry.integer(text)
        assert (found, type(found)) == (number, int)
    for text in ("1.5", "1e-3", "five", "", " ", "1,000", "inf", "nan", "-inf", "1e999999999", "0x10"):
        said = re.escape(f"{text!r} is no integer; write it like 100000, 100_000 or 1e5")
        with pytest.raises(ValueError, match=said):
            _registry.integer(text)


@dataclasses.dataclass(frozen=True)
class Numbers:
    """Every kind of option that holds integers."""

    one: int = 1
    some: tuple[int, ...] = ()
    perhaps: int | None = None
    file: Path | None = None
    """Where it
    goes."""


def read_numbers(*arguments):
    return _reading.read_options(Numbers, "test", arguments)


def test_every_integer_option_is_read_alike_and_what_can_not_be_read_is_one_sentence():
    assert read_numbers("--one", "1e2", "--some", "1e1", "2_0", "--perhaps", "3e0") == Numbers(100, (10, 20), 3)
    assert read_numbers() == Numbers()
    assert read_numbers("--perhaps", "4", "--file", "None").file == Path("None")
    for arguments, message in UNREADABLE:
        with pytest.raises(UsageError) as caught:
            read_numbers(*arguments)
        assert str(caught.value).startswith(message)
        assert not {"\n", "│"} & {*str(caught.value)}


UNREADABLE = [
    (("--one", "1.5"), "--one: '1.5' is no integer; write it like 100000, 100_000 or 1e5"),
    (("--perhaps", "x"), "--perhaps: 'x' is no integer"),
    (("--one",), "Missing value for argument '--one'"),
    (("--onr", "1"), "--onr is no option of `galton test`; did you mean --one?"),
    (("--verbose=2",), "--verbose is no option of `galton test`; `galton test --help` lists the options"),
    (("extra",), "'extra' is one argument too many"),
    (("--some", "64,64"), "--some: '64,64' is no integer; write it like"),
    (("--one", "2", "false"), "'false' is one argument too many; a switch stands alone"),
    (("--onr", "1", "--one"), "--onr is no option of `galton test`; did you mean --one?"),
]


def test_help_shows_no_none_and_whole_sentences(capsys):
    with pytest.raises(SystemExit) as left:
        read_numbers("--help")
    assert left.value.code == 0
    told = capsys.readouterr().out
    for shown in ("--file PATH", "Where it goes.", "--one INT", "(default: 1)"):
        assert shown in told
    for hidden in ("None", "default: )"):
        assert hidden not in told


@pytest.mark.slow
def test_help_has_the_defaults_of_the_task_and_the_algorithm_what_matters_first_and_a_group_for_each_part():
    script = "from galton_experiments.commands.sweep.run import main; main(['bandit', '--algorithm', 'ppo', '--help'])"
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    told = re.sub(r"[\s│]+", " ", told)
    assert "--n-steps INT Steps per environment and update. (default: 2048)" in told
    assert "at the start of training. (default: 0.0003)" in told
    assert "--steps INT Environment steps per run. (default: 2000)" in told
    order = ["--grid", "--trials", "--workers INT", "training options", "--steps INT", "rollout options", "--n-steps"]
    order += ["loss options", "--eta FLOAT", "policy options", "--policy {", "--n-bins", "critic options", "--critic {"]
    order += ["algorithm options", "--gamma", "--n-epochs", "credit options", "--weighting", "entropy options"]
    order += ["--entropy-target", "network options", "--net-arch", "optimizer options", "--learning-rate"]
    places = [told.index(f" {shown}") for shown in order]
    assert places == sorted(places)
    assert told.count(" options ─") == 12  # those of the command itself and of its workers are the other two


HELP = """
import contextlib, importlib, sys
for name in ("galton.cli.train", "galton_experiments.commands.compare"):
    for words in (["-h"], ["lqr", "--gamma", "0.5", "--help"]):
        with contextlib.suppress(SystemExit):
            importlib.import_module(name).main(words)
        print("---")
"""
BOTH = {"help", "algorithm", "out", "overwrite", "steps", "eval-episodes", "n-envs", "learning-rate", "gamma"}


@pytest.mark.slow
def test_help_is_the_dozen_options_that_people_use_and_says_how_to_see_all():
    done = subprocess.run([sys.executable, "-c", HELP], capture_output=True, text=True, check=True)
    shown = [set(re.findall(r" --(?!no-|help-all)([a-z-]+)", told)) for told in done.stdout.split("---\n")[:-1]]
    assert shown == [BOTH | {"loss", "preset", "seed", "resume"}] * 2 + [BOTH | {"losses", "seeds"}] * 2
    for name in ("train", "compare"):
        assert done.stdout.count(f"\ngalton {name} --help-all lists all options.\n") == 2


def test_a_folder_is_called_after_the_task():
    for name in ("lqr", "galton/LQR-v0"):
        assert [folder_name(name, algorithm) for algorithm in ("a2c", "ppo")] == ["lqr", "lqr-ppo"]
    assert folder_name("Pendulum-v1", "a2c") == "Pendulum-v1"
    assert folder_name("x" * 300 + "-v0", "a2c") != folder_name("x" * 300 + "-v1", "a2c")
