"""Messages in the words of the command line, and what comes near a wrong word."""

import json
import re
import subprocess
import sys

import pytest

from galton import UsageError
from galton.cli import train, watch
from galton.cli._words import in_its_words, resaid
from galton.errors import did_you_mean, unknown
from galton_experiments.commands import compare
from galton_experiments.commands.sweep import run as sweep

HELP = """
import contextlib, importlib, io, json
from galton.cli._words import options_of
many = [f"galton_experiments.commands.{name}" for name in ("compare", "sweep.run", "benchmark", "sweep.rerun")]
for name in ("galton.cli.train", "galton.cli.watch", *many):
    command, told = importlib.import_module(name), io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.suppress(SystemExit):
        command.main(["lqr", "--help-all"])
    print(json.dumps([name, told.getvalue(), sorted(set(options_of(command.Options).values()))]))
"""


def test_every_option_of_a_command_is_one_that_its_whole_help_shows():
    """In a process without the tests' checks of types, which don't know tyro's MISSING."""
    done = subprocess.run([sys.executable, "-c", HELP], capture_output=True, text=True, check=True)
    for name, told, options in map(json.loads, done.stdout.splitlines()):
        typed = [option for option in options if option.startswith("--")]
        assert len(typed) > 2
        assert [option for option in typed if not re.search(rf" {option}[ ,\n]", told)] == [], name
        assert "None" not in told
        assert "(default: )" not in told


@pytest.mark.parametrize(
    ("below", "above"),
    [
        ("total_timesteps is 0; it must be an integer", "--steps is 0; it must be an integer"),
        ("n_logs is 0", "--logs is 0"),
        ("n_eval_episodes is -1", "--eval-episodes is -1"),
        ("learning_rate is inf; it must be finite", "--learning-rate is inf; it must be finite"),
        ("loss is 'mse'; choose from a", "--loss is 'mse'; choose from a"),
        ("seed is -1", "--seed is -1"),
        ("save_every is 0", "--save-every is 0"),
        ("an entry of net_arch is 0", "an entry of --net-arch is 0"),
        ("normalize_advantage needs more: raise n_steps", "--normalize-advantage needs more: raise n_steps"),
        ("batch_size is 3, but n_steps · n_envs = 5", "--batch-size is 3, but --n-steps · --n-envs = 5"),
        ("n_envs is 3; leave n_envs out.", "--n-envs is 3; leave --n-envs out."),
        ("out is n_steps/n_bins, a n_logs.txt", "--out is n_steps/n_bins, a n_logs.txt"),
        ("env_kwargs is '{\"n_envs\": 3}'", "--env-kwargs is '{\"n_envs\": 3}'"),
        ("env_kwargs is {'n_envs': 3}, no", "--env-kwargs is {'n_envs': 3}, no"),
        ("environment is 'x'; no such", "environment is 'x'; no such"),
        ("the seed is kept", "the seed is kept"),
        ("seeds of n_stepsize", "seeds of n_stepsize"),
    ],
)
def test_a_message_names_the_option_that_is_typed(below, above):
    assert resaid(below, train.Options) == above


def test_what_a_file_says_keeps_the_files_words():
    told = "grid is 'my.toml': n_bins is 1; it must be an integer of at least 2"
    assert resaid(told, sweep.Options) == f"--{told}"


def test_each_command_has_its_own_words():
    assert resaid("loss is 'mse'", compare.Options) == "--losses is 'mse'"
    assert resaid("env is 5", watch.Options) == "--env is 5"
    assert resaid("env is 5", train.Options) == "env is 5"


def test_an_error_stays_what_it_is_but_for_its_words():
    class SpecialError(UsageError):
        """A kind of its own."""

    with pytest.raises(SpecialError, match=r"^--n-steps is 3$"), in_its_words(train.Options):
        raise SpecialError("n_steps is 3")
    with pytest.raises(UsageError, match=r"^n_steps is 3$"), in_its_words(None):
        raise UsageError("n_steps is 3")


KNOWN = ("--learning-rate", "--n-envs", "--steps", "--out", "hl-gauss", "gaussian")


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("--stpes", "--steps"),
        ("--lr", "--learning-rate"),
        ("--learning_rate", "--learning-rate"),
        ("--num-envs", "--n-envs"),
        ("hl_gauss", "hl-gauss"),
        ("HLGauss", "hl-gauss"),
        ("gausian", "gaussian"),
        ("--ouput", "--out"),
    ],
)
def test_the_nearest_word_is_suggested(word, meant):
    assert did_you_mean(word, KNOWN) == f"; did you mean {meant}?"


@pytest.mark.parametrize("word", ["", "--", "mse", "--verbose", "x" * 500, 5, None])
def test_nothing_is_suggested_where_nothing_is_near(word):
    assert did_you_mean(word, KNOWN) == ""


def test_an_unknown_word_is_told_with_its_choices():
    assert str(unknown("loss", "mse", KNOWN[-2:])) == "loss is 'mse'; choose from hl-gauss, gaussian"
