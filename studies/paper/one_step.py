"""Figure 1: what each loss does to one policy when the same three actions are sampled (§4.2)."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from galton import Bins
from galton.losses import LOSSES, find_loss, surrogate
from galton.policies import Distribution, Gaussian, Histogram
from galton.types import Params
from galton_experiments.analysis.plots import finish, look_of, panels
from studies.paper.figure import figure

BINS = Bins(-3.0, 3.0, 30)
ACTIONS = BINS.centers[0, [7, 17, 23]]
ADVANTAGES = np.array([-1.2, 0.4, 0.8], np.float32)
"""The advantages of the three actions: zero on average, as with a baseline that is right."""
ETAS = {"hl-gauss": 0.75, "hl-gauss-centred": 2.0}
"""The η of the losses that have one: the widest of the paper's grid, and what the centred loss is trained with."""
STEP_SIZES = {"gaussian": 0.6, "histogram": 6.0}
"""The size of the one step of gradient descent, by policy: large, so that it can be seen."""

_DENSITY = 0.87
_FLOOR, _ARROW = -0.19, 0.13
"""In densities: the highest shown, where the arrows start, and their length for an advantage of 1."""


def start(loss: str) -> Params:
    """The parameters before the step: of N(0, 1), or of its histogram for a loss on histograms."""
    if find_loss(loss).family == "density":
        return {"mean": jnp.zeros(1), "log_std": jnp.zeros(1)}
    return {"logits": -0.5 * jnp.asarray(BINS.centers) ** 2}


def policy(params: Params) -> Distribution:
    """The distribution of actions with these parameters, in the only state there is."""
    if "mean" in params:
        return Gaussian(params["mean"], params["log_std"], BINS.low, BINS.high)
    return Histogram(BINS, params["logits"])


def step(loss: str) -> Params:
    """The parameters after one step of gradient descent on the surrogate."""
    kind: Any = find_loss(loss)
    entry, params = kind(**{"eta": ETAS.get(loss, 1.0)} if hasattr(kind, "eta") else {}), start(loss)

    def objective(params: Params) -> Array:
        losses = jax.vmap(lambda action: entry(policy(params), action))(ACTIONS[:, None])
        return surrogate(jnp.asarray(ADVANTAGES), losses)

    size = STEP_SIZES[entry.policy]
    stepped: Params = jax.tree.map(lambda p, g: p - size * g, params, jax.grad(objective)(params))
    return stepped


def density(distribution: Distribution, x: Float[np.ndarray, " n"]) -> Float[Array, " n"]:
    """Of a policy at actions x; a histogram's is that of its bins."""
    action = jnp.asarray(x, float)[:, None]
    if isinstance(distribution, Histogram):
        return distribution.probs[0, BINS.encode(action)[:, 0]] / BINS.width
    assert isinstance(distribution, Gaussian)
    return jnp.exp(distribution.log_prob(action))


@jax.jit
def densities() -> dict[str, tuple[Array, Array]]:
    """Each loss's policy before and after the step, at `_at(loss)`; all are compiled together, which takes a second."""
    return {loss: (density(policy(start(loss)), _at(loss)), density(policy(step(loss)), _at(loss))) for loss in LOSSES}


def _at(loss: str) -> Float[np.ndarray, " n"]:
    """The actions at which a loss's policy is drawn: a histogram's bins, for a Gaussian many."""
    is_histogram = find_loss(loss).family == "histogram"
    return np.asarray(BINS.centers[0]) if is_histogram else np.linspace(BINS.low[0], BINS.high[0], 301)


def draw() -> Figure:
    """A panel per loss: the policy before the step, the sampled actions with their advantages, the policy after."""
    drawing, axes = panels(len(LOSSES), height=2.9)
    heights = densities()
    for panel, loss in zip(axes, LOSSES, strict=True):
        look = look_of(loss)
        before, after = map(np.asarray, heights[loss])
        _draw_policy(panel, loss, before, ("before the step", "#9a9a9a", "-"), 0.9, 0.0)
        _draw_policy(panel, loss, after, look, 1.5, 0.15)
        _draw_actions(panel)
        panel.set_title(look[0] + (f", η = {ETAS[loss]:g}" if loss in ETAS else ""), fontsize=10)
    axes[0].set_ylabel("density")
    axes[0].text(-0.5, _FLOOR + 0.02, "advantage", fontsize=8, color="#333333", ha="center")
    finish(drawing, axes)
    return drawing


def _draw_policy(
    axes: Axes, loss: str, heights: Float[np.ndarray, " n"], look: tuple[str, str, str], width: float, shade: float
) -> None:
    name, color, linestyle = look
    if find_loss(loss).family == "histogram":
        axes.stairs(heights, BINS.edges[0], baseline=None, color=color, ls=linestyle, lw=width, gid=name, label=name)
        axes.stairs(heights, BINS.edges[0], fill=True, color=color, alpha=shade, gid=name)
    else:
        x = _at(loss)
        axes.plot(x, heights, color=color, ls=linestyle, lw=width, gid=name, label=name)
        axes.fill_between(x, heights, color=color, alpha=shade, linewidth=0, gid=name)


def _draw_actions(axes: Axes) -> None:
    axes.axhline(_FLOOR, color="#333333", lw=0.6)
    for action, advantage in zip(ACTIONS, ADVANTAGES, strict=True):
        axes.annotate(
            "",
            (action, _FLOOR + _ARROW * advantage),
            (action, _FLOOR),
            arrowprops={"arrowstyle": "-|>", "color": "#333333", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9},
        )
        axes.axvline(action, color="#333333", lw=0.5, ls=":", zorder=0)
    axes.set_ylim(_FLOOR - 0.16, _DENSITY)
    axes.set_xlim(BINS.low[0], BINS.high[0])
    axes.set_yticks([0, 0.25, 0.5, 0.75])
    axes.set_xlabel("action")


FIGURE = figure("figure-1", lambda _: draw())
