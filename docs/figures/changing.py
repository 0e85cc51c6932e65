"""`python docs/figures/changing.py` draws changing.png: the course of five heads on two tasks that change."""

import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

HERE = Path(__file__).parent
FOUND = json.loads((HERE.parents[1] / "results" / "benchmarks" / "changing.json").read_text())
PANELS = {"jump": ("bandit whose optimum jumps", 4_000), "lqr": ("regulator whose inputs are reversed", 6_400)}
LOOKS = {
    "centred HL-Gauss, diffusion": ("#0072B2", "-"),
    "Gaussian, floor": ("#000000", "-"),
    "Gaussian": ("#000000", ":"),
    "centred HL-Gauss": ("#0072B2", ":"),
    "HL-1-Hot": ("#D55E00", "--"),
}


def main():
    """Draw both panels and write the picture."""
    plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "font.size": 10})
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.3), layout="constrained", sharey=True)
    for axis, (task, (title, updates)) in zip(axes, PANELS.items(), strict=True):
        for head, (color, style) in LOOKS.items():
            curve = FOUND[head][task]["curve"]
            steps = np.arange(1, len(curve) + 1) * updates / len(curve)
            axis.plot(steps[:-1], curve[:-1], color=color, linestyle=style, linewidth=1.6, label=head)
        for change in (1, 2, 3):
            axis.axvline(change * updates / 4, color="#bbbbbb", linewidth=0.8, zorder=0)
        axis.set(title=title, xlabel="updates", ylim=(-1.05, 1.05), xlim=(0, updates))
    axes[0].set_ylabel("share of the optimum")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(HERE / "changing.png", dpi=150)


if __name__ == "__main__":
    main()
