"""`python docs/figures/target.py` draws target.png: what a policy over bins is trained towards, and a Gaussian."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
from scipy.stats import norm

from galton import Bins, targets
from galton_experiments.analysis import plots

MEAN, STD, ETA = -0.2, 0.4, 1.0
BINS = Bins(-1.0, 1.0, 15)
ACTION = BINS.decode(jnp.array([10]))
"""The action that was taken, the center of its bin."""
PROBS = np.diff(norm.cdf(BINS.edges[0], MEAN, STD)) * (1 + 0.3 * np.cos(9 * BINS.centers[0]))
"""Of the policy over bins: of no simple shape, before they are made to sum to one."""


def main():
    """Draw the four panels and write the picture."""
    figure, axes = plots.panels(4, columns=2, width=3.3, height=2.3)
    softmax, density, histograms, point = axes
    draw_bins(softmax, histograms)
    draw_gaussian(density, point)
    for panel in axes:
        panel.grid(False)
        panel.set(xlim=(-1, 1), xticks=[-1, 0, 1])
        panel.plot(ACTION, 0, marker="^", color="#D55E00", ms=11, clip_on=False, zorder=5)
    for panel in (histograms, point):
        panel.set_xlabel("action")
    plots.settle(figure)
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=200)


def draw_bins(policy, target):
    """The softmax, and both targets of the action."""
    (label, one_hot, _), (other, gauss, _) = plots.look_of("hl-one-hot"), plots.look_of("hl-gauss")
    width = 0.88 * BINS.width[0]
    policy.bar(BINS.centers[0], PROBS / PROBS.sum(), width, color="#b0b0b0")
    policy.set(title="A policy over bins: a softmax", ylabel="probability", ylim=(0, 0.25))
    policy.text(0.98, 0.19, r"$\pi(j)$ of each bin $j$", ha="right")
    policy.annotate(
        "the action $a$\nthat was taken", (ACTION[0], 0.012), (0.97, 0.1), ha="right", arrowprops={"arrowstyle": "-"}
    )
    target.bar(BINS.centers[0], np.asarray(targets.hl_gauss(BINS, ACTION, ETA))[0], width, color=gauss)
    hot = np.asarray(targets.one_hot(BINS, ACTION))[0]
    target.bar(BINS.centers[0][hot > 0], hot[hot > 0], width, fill=False, edgecolor=one_hot, lw=2.5)
    target.set(title="Its target: bins to make likelier", ylabel="probability", ylim=(0, 1.1))
    target.text(0.3, 0.9, f"{label}:\nits bin alone", ha="right", va="center")
    target.text(-0.95, 0.58, "cross-entropy:\n" + r"$-\sum q(j)\,\log\,\pi(j)$", va="center")
    target.text(0.06, 0.25, f"{other}:\nits neighbours too", ha="right", va="center", color=gauss)


def draw_gaussian(policy, target):
    """The density, and the action that its mean is drawn to."""
    x, color = np.linspace(-1, 1, 201), plots.look_of("gaussian")[1]
    policy.plot(x, norm.pdf(x, MEAN, STD), color=color, lw=2)
    policy.fill_between(x, norm.pdf(x, MEAN, STD), color="#b0b0b0", alpha=0.5)
    policy.set(title="The usual policy: a Gaussian", ylabel="density", ylim=(0, 1.25), yticks=[0, 0.5, 1])
    policy.text(0.98, 0.95, "mean $\\mu$, width $\\sigma$", ha="right")
    target.set(title="Its target: the action itself", yticks=[], ylim=(0, 1.1))
    target.vlines(ACTION, 0, 1, color=color, lw=2.5)
    for panel in (policy, target):
        panel.vlines(MEAN, 0, 1, color=color, ls="--", lw=1.2)
        panel.text(MEAN, 1.04, r"$\mu$", ha="center")
    target.annotate("", (ACTION[0], 0.5), (MEAN, 0.5), arrowprops={"arrowstyle": "->", "lw": 1.5})
    target.text(-0.95, 0.8, "least squares:\n" + r"$(a - \mu)^2 /\ 2\sigma^2$", va="center")
    target.text(-0.95, 0.28, "the curve\nmoves as\na whole", va="center")


if __name__ == "__main__":
    main()
