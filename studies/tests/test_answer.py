"""The head of the page: the sentence and the tasks say what the runs do."""

import re

import pytest

from galton.tasks import TASKS
from galton_experiments.page.page import VERDICTS
from studies.paper.answer import answer
from studies.paper.registry import FIGURES
from studies.paper.report import claims

from . import made_up

TRAINED = [f"{task}{part}" for task in TASKS for part in ("", "-again")]


def head(final_of, names=TRAINED, trials=12):
    trained = made_up.data(final_of, names, trials=trials, above_rest=True)
    return answer(trained, claims(trained))


def ends(better_on):
    """Classification ends higher on these tasks, lower on the others."""

    def final(name, setting):
        is_classification = setting["loss"] != "gaussian"
        return 2.0 + 3 * (is_classification == (name.removesuffix("-again") in better_on))

    return final


def test_the_sentence_counts_the_tasks_each_way():
    found = head(ends({"bandit", "lqr"}))
    assert found.sentences[0] == (
        "The paper says that classification ends higher than regression almost everywhere but on Acrobot. Here it "
        "clearly does on 2 of 6 others (Bandit, LQR), clearly ends lower on 4 (Mountain Car, Reacher, HalfCheetah, "
        "Ant); on Acrobot it ends lower, as the paper says."
    )
    assert (
        "By the deterministic policy, without the noise of exploration, 2 of 7 end clearly higher and 5 lower."
        in found.sentences[1]
    )
    for title, (training, deterministic, verdict) in found.matrix.rows.items():
        is_higher = title in ("Bandit", "LQR")
        assert {training.verdict, deterministic.verdict, verdict.verdict} == {VERDICTS[0 if is_higher else 2]}
        assert verdict.text == ("higher" if is_higher else "lower")
        assert training.text.startswith("+3.0" if is_higher else "−3.0")


def test_all_are_told_without_the_others():
    others = ", ".join(task.title for name, task in TASKS.items() if name != "acrobot")
    told = f"Here it clearly does on 6 of 6 others ({others}); on Acrobot it ends higher, too."
    assert head(ends(TASKS)).sentences[0].endswith(told)


def test_null_tasks_and_few_runs_are_named_and_not_counted():
    found = head(ends({"lqr"}), ("lqr", "lqr-again"), trials=2)
    assert (
        found.sentences[0]
        == "Whether classification ends higher than regression can be decided on none of the tasks here."
    )
    assert "Too few runs to decide: LQR." in found.sentences[1]
    assert found.matrix.rows["LQR"][2].text == "too few runs"
    nothing = head(lambda *_: -1.0, ("mountain-car", "mountain-car-again"))
    assert "Mountain Car is left out (null: 0 of" in nothing.sentences[1]
    assert [cell.text for cell in nothing.matrix.rows["Mountain Car"]] == ["—", "—", "null task"]


def test_the_statements_are_those_of_the_claims():
    trained = made_up.data(ends(TASKS), TRAINED, trials=12, above_rest=True)
    judged = claims(trained)
    told = answer(trained, judged).sentences[1]
    counts = dict(zip(("hold", "hold in part", "do not hold", "can't be decided here"), VERDICTS, strict=True))
    assert f"Of {len(judged)} statements of the paper" in told
    for words, verdict in counts.items():
        n = sum(claim.verdict == verdict for claim in judged)
        assert (re.search(rf"\b{n} {words}\b", told) is not None) == (n > 0)


@pytest.mark.parametrize("names", [(), ("lqr",), ("propositions",)])
def test_whatever_is_missing_there_is_an_answer(names):
    trained = made_up.data(lambda *_: 1.0, names)
    found = answer(trained, [])
    assert found.sentences
    assert (found.figure is None) == (not names or names == ("propositions",))


def test_the_curves_are_figure_2s_of_the_papers_losses():
    trained = made_up.data(ends(TASKS), TRAINED)
    small, large = answer(trained, []).figure.axes, FIGURES["figure-2"].draw(trained).axes
    for ours, theirs in zip(small, large, strict=True):
        drawn = {line.get_gid(): list(line.get_ydata()) for line in theirs.get_lines()}
        curves = {line.get_gid(): list(line.get_ydata()) for line in ours.get_lines()}
        assert {"Gaussian", "HL-1-Hot", "HL-Gauss"} <= {*curves}
        assert "Centred HL-Gauss (ours)" not in curves
        assert all(drawn[name] == values for name, values in curves.items())
