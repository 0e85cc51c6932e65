"""Optuna over a sweep."""

import itertools

import numpy as np

from galton import LOSSES, parts
from galton.sweep.grid import task_defaults
from galton.sweep.search import search

BASE = task_defaults("lqr")


def run(n, batch, fail=()):
    """The rounds of a search for the settings whose learning rate is close to 2e-3 and η to 1."""
    rounds = []

    def worth(setting):
        if setting["loss"] in fail:
            return -np.inf
        return -abs(np.log(setting["learning_rate"] / 2e-3)) - abs(np.log(setting["eta"]))

    def means(settings):
        rounds.append(settings)
        return {setting: worth(setting) for setting in settings}

    search(means, BASE, n, batch)
    return rounds


def test_each_round_adds_a_batch_per_loss_to_the_ones_before():
    rounds = run(10, 4)
    assert [len(settings) for settings in rounds] == [16, 32, 40]
    for before, after in itertools.pairwise(rounds):
        assert after[: len(before)] == before
    for loss in LOSSES:
        assert sum(s["loss"] == loss for s in rounds[-1]) == 10


def test_settings_stay_in_the_space_and_vary_only_what_matters():
    for setting in run(8, 8)[-1]:
        assert 7e-5 <= setting["learning_rate"] <= 7e-3
        assert setting["n_bins"] in (50, 100, 200)
        if "eta" in parts.settings(LOSSES[setting["loss"]]):
            assert 0.1 <= setting["eta"] <= 4
        else:
            assert setting["eta"] == 0.25


def test_run_again_it_proposes_the_same():
    assert run(8, 4) == run(8, 4)


def test_it_finds_what_is_worth_more():
    settings = [s for s in run(40, 4)[-1] if s["loss"] == "hl-gauss"]
    distance = [abs(np.log(s["learning_rate"] / 2e-3)) + abs(np.log(s["eta"])) for s in settings]
    assert np.mean(distance[-12:]) < 0.7 * np.mean(distance[:12])


def test_diverged_settings_do_not_stop_it():
    assert len(run(8, 4, fail=("gaussian",))[-1]) == 32
