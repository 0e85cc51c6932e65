import pytest

from studies.paper.standings import ahead, clear, readme_table

from . import made_up
from .test_claims import winning

TASKS = ("lqr", "acrobot", "mountain-car")
SWEEPS = tuple(f"{task}{part}" for task in TASKS for part in ("", "-again"))


def mixed(name, setting):
    """HL-Gauss wins the LQR, the Gaussian Acrobot; nobody learns on Mountain Car."""
    if name.startswith("mountain"):
        return -1.0
    return winning("hl-gauss" if name.startswith("lqr") else "gaussian")(name, setting)


@pytest.fixture(scope="module")
def data():
    return made_up.judgeable(mixed, SWEEPS)


def test_bold_is_a_loss_ahead_of_the_gaussian_or_the_gaussian_ahead_of_all(data):
    assert ahead(data) == {("lqr", "hl-gauss"), ("acrobot", "gaussian")}
    some = made_up.judgeable(
        lambda name, s: 5.0 if s["loss"] in ("gaussian", "hl-one-hot") else 1.0, ("lqr", "lqr-again")
    )
    assert ahead(some) == set()


def test_all_decisions_of_the_table_are_adjusted_together():
    """Five runs against five have no p below 0.008: alone they are clear, beside twenty other decisions they aren't."""
    few = made_up.judgeable(winning("hl-gauss"), ("lqr", "lqr-again"), trials=5)
    assert clear(few)["lqr", "hl-gauss"] == "✓"
    names = [f"{task}{part}" for task in ("lqr", "bandit", "reacher", "ant") for part in ("", "-again")]
    assert set(clear(made_up.judgeable(winning("hl-gauss"), names, trials=5)).values()) == {"≈"}


def test_the_readmes_table(data):
    text = readme_table(data).splitlines()
    assert text[0].startswith("| | runs | Gaussian | HL-1-Hot | HL-Gauss | Centred HL-Gauss")
    assert {line.count("|") for line in text} == {7}
    rows = {line.split("|")[1].strip(): line for line in text[2:]}
    assert [*rows] == ["LQR (optimum −9.77)", "Mountain Car (null)", "Acrobot"]
    assert rows["LQR (optimum −9.77)"].count("**") == 2
    assert "| 12 | −25.0" in rows["LQR (optimum −9.77)"]
    assert "| **−495" in rows["Acrobot"]
