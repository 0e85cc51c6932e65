"""A loss of your own: HL-1-Hot with label smoothing. A function of (distribution, action, hypers), a line in LOSSES."""

import galton
from galton.losses import cross_entropy


def target(distribution, action, hypers):
    """A share `hypers.eta` of the target's mass goes to all bins alike."""
    one_hot = galton.targets.one_hot(distribution.bins, action)
    return (1 - hypers.eta) * one_hot + hypers.eta / distribution.bins.n_bins


def smoothed(distribution, action, hypers):
    """Cross-entropy with that target; as for any loss of this family the policy is the usual softmax."""
    return cross_entropy(distribution, target(distribution, action, hypers))


galton.LOSSES["smoothed"] = galton.Loss(
    smoothed,
    family="histogram",
    policy="histogram",
    label="smoothed 1-Hot",
    in_paper=False,
    uses=("eta",),
    target=target,
)

if __name__ == "__main__":
    galton.use_all_cores()
    config = galton.Config(loss="smoothed", n_steps=5, net_arch=())
    result = galton.train(galton.envs.Bandit(), config, galton.Hypers(0.05, eta=0.1), range(20), total_timesteps=2_000)
    print(f"final training return {result.final('training_return').mean():.2f} of 25")
