"""A loss of your own: HL-1-Hot with label smoothing. A function on (distribution, action, eta) and a line in LOSSES."""

import galton
from galton import targets
from galton.losses import LOSSES, Loss, cross_entropy


def smoothed(distribution, action, eta):
    """A share `eta` of the target's mass goes to all bins alike."""
    target = targets.one_hot(distribution.bins, action)
    return cross_entropy(distribution, (1 - eta) * target + eta / distribution.bins.n_bins)


LOSSES["smoothed"] = Loss(smoothed, policy="histogram", label="smoothed 1-Hot", in_paper=False)

if __name__ == "__main__":
    galton.use_all_cores()
    config = galton.Config(loss="smoothed", n_steps=5, net_arch=())
    result = galton.train(galton.envs.Bandit(), config, galton.Hypers(0.05, eta=0.1), range(20), total_timesteps=2_000)
    print(f"final training return {result.final('training_return').mean():.2f} of 25")
