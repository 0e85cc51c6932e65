"""One colour for one loss, in every figure."""

from galton import LOSSES
from galton_experiments.analysis.plots import colors_of, look_of


def test_the_first_series_of_a_loss_has_its_colour_and_no_two_have_the_same():
    losses = ["gaussian", "gaussian", "hl-gauss-centred", "hl-one-hot", "hl-gauss-centred", "hl-gauss", "hl-gauss"]
    colors = colors_of(losses)
    assert [colors[losses.index(loss)] for loss in LOSSES] == [look_of(loss)[1] for loss in LOSSES]
    assert len({*colors}) == len(losses)
