"""One colour for one loss, in every figure, and the same file for the same figure."""

import io
import re

import numpy as np

from galton import LOSSES
from galton_experiments.analysis.plots import colors_of, look_of, panels, svg


def test_the_first_series_of_a_loss_has_its_colour_and_no_two_have_the_same():
    losses = ["gaussian", "gaussian", "hl-gauss-centred", "hl-one-hot", "hl-gauss-centred", "hl-gauss", "hl-gauss"]
    colors = colors_of(losses)
    assert [colors[losses.index(loss)] for loss in LOSSES] == [look_of(loss)[1] for loss in LOSSES]
    assert len({*colors}) == len(losses)


def places(image):
    """The numbers of an SVG's paths, translations and uses, in its order."""
    found = re.findall(rb'\b[dxy]="([^"]*)"|translate\(([^)]*)\)', image)
    return np.array([float(x) for both in found for x in re.findall(rb"-?\d+(?:\.\d+)?", both[0] or both[1])])


def test_a_figure_on_another_processor_is_the_same_file_and_as_matplotlib_draws_it():
    x = np.linspace(0, 1, 50)
    images = []
    for noise in (0.0, 1e-13):
        figure, (axes,) = panels(1)
        axes.plot(x, np.sin(9 * x) + noise)
        axes.set_ylim(-1, 1)
        images.append(svg(figure))
    assert images[0] == images[1]
    as_drawn = io.BytesIO()
    figure.savefig(as_drawn, format="svg", metadata={"Date": None})
    drawn, ours = places(as_drawn.getvalue()), places(images[0])
    np.testing.assert_allclose(ours, drawn, atol=0.005 + 1e-9)
    assert len(ours) > 200
    assert (ours != drawn).any()
