"""One table says how everything was made: what stands there is what the files say."""

import dataclasses

from studies.paper import made
from studies.paper.registry import FIGURES
from studies.paper.trained import Trained

from . import made_up


def rows(trained):
    table = made.section(trained).table
    return [dict(zip(table.headings, row, strict=True)) for row in table.rows]


def test_a_row_for_each_sweep_says_how_to_train_it_again():
    data = made_up.data(lambda *_: 1.0, ("lqr", "lqr-again", "bandit", "bandit-noise-5"))
    found = {row["sweep"]: row for row in rows(data)}
    assert [*found] == ["bandit (Bandit)", "lqr (LQR)", "lqr-again", "bandit-noise-5"]
    lqr, again = found["lqr (LQR)"], found["lqr-again"]
    study = data.grids["lqr"].study
    assert (lqr["settings"], lqr["trials"], lqr["steps"]) == (f"{len(study.settings)}", "2", "400")
    assert (lqr["seed"], again["seed"]) == ("0", "1, in pairs")
    assert (lqr["episodes per steps"], again["episodes per steps"]) == ("1 per 100", "1 per 100, twice")
    assert (lqr["budget"], lqr["core minutes"], lqr["on"], lqr["with"]) == ("smoke", "2", "A", "A")
    assert [found[name]["word"] for name in found] == ["bandit", "lqr", "lqr", "figure-3"]


def test_versions_have_letters_and_what_all_share_is_said_once():
    data = made_up.data(lambda *_: 1.0, ("lqr", "bandit"))
    later = data.sweeps["lqr"].provenance | {
        "versions": [{"galton": "1", "jax": "0"}],
        "machines": ["yours", "<b>mine</b>"],
    }
    lqr = dataclasses.replace(data.sweeps["lqr"], provenance=later)
    trained = Trained(dict(data.sweeps) | {"lqr": lqr})
    assert [(row["on"], row["with"]) for row in rows(trained)] == [("A", "A"), ("B, A", "B")]
    *_, machines, versions = made.section(trained).paragraphs
    assert machines == "Machines: A <b>mine</b>; B yours."
    assert versions == "Versions: A galton 0; B galton 1; all with jax 0."


def test_every_sweep_has_a_word_that_reproduce_takes():
    words = {made._word(name) for name in made_up.SWEEPS}
    assert words <= {*FIGURES, *made.MAIN}
