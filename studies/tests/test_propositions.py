"""The propositions' figure and table show what the samples say."""

import numpy as np
import pyarrow as pa

from galton.losses import LOSSES
from studies.paper import propositions
from studies.paper.propositions import FIGURE
from studies.paper.trained import Trained

from .samples import SHARED, plain, table


def trained(samples):
    return Trained({}, {propositions.NAME: samples})


def test_the_figure_has_a_row_per_task_and_names_its_series():
    known = table(plain)
    figure = FIGURE.draw(trained(known))
    assert len(figure.axes) == 8
    labels = {loss.label for loss in LOSSES.values()} | {propositions.PRINTED_LABEL}
    missing = {0: {propositions.PRINTED_LABEL}, 3: {"HL-1-Hot", "Centred HL-Gauss (ours)"}}
    for i, axes in enumerate(figure.axes):
        gids = {artist.get_gid() for artist in axes.get_children()} - {None}
        assert gids == labels - missing.get(i % 4, set())
        assert axes.get_title().startswith(("Mountain Car: ", "LQR: "))
        assert axes.get_ylabel()
    one = known.filter(pa.array(np.array(known.column("task").to_pylist()) == "lqr"))
    assert len(FIGURE.draw(trained(one)).axes) == 4


def test_the_figure_divides_each_sample_by_its_own_advantage():
    """The advantages of `plain` grow; its bound per advantage does not."""
    _, bound, norm, _ = FIGURE.draw(trained(table(plain, ("lqr",)))).axes
    for axes, expected in ((bound, 2 * SHARED), (norm, SHARED / 2)):
        (line,) = [line for line in axes.get_lines() if line.get_gid() == "Gaussian"]
        np.testing.assert_allclose(line.get_ydata(), expected)


def test_the_table_has_a_row_for_each_series_and_a_cell_for_each_finding():
    made = propositions.bounds(trained(table(plain)))
    assert len(made.rows) == 10
    assert made.rows[0] == ["Mountain Car", "Gaussian", "2", "0.25", "4", "2", "1", "0", "0", "−1"]
