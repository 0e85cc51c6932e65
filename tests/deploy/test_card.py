"""What a model card says of a run, and how little a run may have told."""

import re

import numpy as np
import pytest
from markdown_it import MarkdownIt
from scipy import stats

import galton
from galton.deploy.card import card

from .drifting import HIGH, LOW, Drifting

STEP = "time/total_timesteps"
POINTS = [
    {STEP: 16.0 * i, "rollout/ep_rew_mean": float(i), "eval/mean_reward": 0.0 - (i - 10) ** 2, "eval/std_reward": 2.0}
    for i in range(1, 41)
]
SETTINGS = {
    "env": "Drifting-v0",
    "env_kwargs": {"mass": 2},
    "eval_episodes": 5,
    "command": "galton train Drifting-v0 --eta 2",
    "versions": {"galton": "0.1.0", "mujoco": None, "commit": "abc"},
}


@pytest.fixture(scope="module")
def model():
    """A model that passes for one that was trained for 640 steps: a card asks for no more."""
    made = galton.A2C(lambda: Drifting(LOW[:2], HIGH[:2]), "hl-gauss", seed=1, n_bins=5, net_arch=(4,), n_steps=16)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(made), "num_timesteps", 640)
        yield made


def rows_of(text):
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]


def lines(text, start):
    return [line for line in text.splitlines() if line.startswith(start)]


def test_it_says_what_was_trained_and_how_and_chooses_no_licence_for_anybody(model):
    text = card(model, SETTINGS, POINTS)
    assert text.startswith("---\nlibrary_name: galton\npipeline_tag: reinforcement-learning\ntags:\n")
    assert "# Drifting-v0: A2C with hl-gauss\n" in text
    assert "```\ngalton train Drifting-v0 --eta 2\n```" in text
    rows = rows_of(text)
    assert ["Its keyword arguments", '`{"mass": 2}`'] in rows
    assert ["`n_steps`", "`16`"] in rows
    assert ["`seed`", "`1`"] in rows
    assert not [row for row in rows if row[0] == "`gamma`"]  # as it is by default
    assert ["galton", "`0.1.0`"] in rows
    assert not [row for row in rows if row[0] == "mujoco"]
    assert "license" not in text.split("---")[1]
    assert "Whoever publishes it chooses one" in text


def test_the_interval_is_students_over_the_episodes_of_an_evaluation(model):
    returns = np.array([-910.0, -900.0, -890.0, -905.0, -895.0])
    point = {STEP: 640.0, "eval/mean_reward": returns.mean(), "eval/std_reward": returns.std()}
    low, high = stats.t.interval(0.95, 4, returns.mean(), stats.sem(returns))
    assert ["This policy", "640", "5", "-900.00", f"{low:,.2f} to {high:,.2f}"] in rows_of(
        card(model, SETTINGS, [point])
    )


def test_the_best_evaluation_is_told_apart_from_this_policys(model):
    rows = rows_of(card(model, SETTINGS, POINTS))
    assert ["This policy", "640", "5", "-900.00", "-902.78 to -897.22"] in rows
    assert [row[:4] for row in rows if row[0] == "The best of its run's 40"] == [
        ["The best of its run's 40", "160", "5", "0.00"]
    ]
    rows = rows_of(card(model, SETTINGS, POINTS[:-1]))
    assert [row[1] for row in rows if row[0] == "The last of its run"] == ["624"]


def test_the_curve_has_ten_rows_from_the_first_point_to_the_last(model):
    rows = rows_of(card(model, SETTINGS, POINTS).split("## How it learned")[1].split("##")[0])[2:]
    assert len(rows) == 10
    assert rows[0] == ["16", "1.00", "-81.00"]
    assert rows[-1] == ["640", "40.00", "-900.00"]


def test_what_a_run_does_not_know_is_not_made_up(model):
    text = card(model, {}, [])
    assert "# Drifting: A2C with hl-gauss\n" in text
    assert "what the policy returns without exploration is not known" in text
    assert "The run has no log points." in text
    assert "## Versions" not in text
    assert "nan" not in text
    one = card(model, SETTINGS | {"eval_episodes": 1}, [POINTS[-1], {STEP: 641.0}])
    assert ["This policy", "640", "1", "-900.00", "not known"] in rows_of(one)
    assert ["641", "not known", "not known"] in rows_of(one)


LINKS = ("[evil](javascript:alert(1))", "![evil](https://evil.example/x.png)", "https://evil.example")
ODD = [*LINKS, '<img src=x onerror="alert(1)">', "evil | b", "evil \\| b", "evil\n\n# b", "__evil__", "&lt;evil&gt;"]


@pytest.mark.parametrize("odd", ODD)
def test_what_a_file_says_is_code_and_no_markup(odd, model):
    text = card(model, dict.fromkeys(SETTINGS, odd) | {"versions": {odd: odd}}, POINTS)
    html = MarkdownIt("commonmark", {"html": True}).enable("table").render(text.split("---\n", 2)[2])
    for row in re.findall(r"<tr>.*?</tr>", html, re.DOTALL):
        assert len(re.findall("</t[hd]>", row)) in (2, 3, 5), row
    assert ("evil" in html) or ("alert" in html)
    bare = re.sub(r"<code[^>]*>.*?</code>", "", html, flags=re.DOTALL)
    assert not re.findall(r"evil|alert|<img|<a |<strong|<h1>.*b", bare)
    assert html.count("<h1>") == 1


@pytest.mark.parametrize("odd", ["x`|```\n## y", 5, None, [], {"a": "|"}])
def test_settings_of_strangers_make_no_other_markdown(odd, model):
    settings = dict.fromkeys(SETTINGS, odd)
    plain = card(model, SETTINGS, POINTS)
    text = card(model, settings | {"versions": {"a": odd}}, POINTS)
    assert lines(text, "## ") == lines(plain, "## ")
    assert len(lines(text, "```")) in (4, 2)  # the command, if it is one, and how to use the policy
    assert {line.count(" | ") for line in lines(text, "| a |")} <= {1}


def test_it_loads_the_file_that_it_is_of(model):
    assert 'galton.Model.load("best_model.safetensors")' in card(model, SETTINGS, POINTS, "best_model.safetensors")
