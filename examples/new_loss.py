"""A loss of your own: HL-1-Hot with label smoothing. A class whose fields are its settings, and a line in LOSSES."""

import galton
from galton.losses import cross_entropy
from galton.types import Share


class Smoothed(galton.Loss):
    """Cross-entropy with a one-hot target that is smoothed."""

    family = "histogram"
    policy = "histogram"
    label = "smoothed 1-Hot"

    smoothing: Share = 0.1
    """The share of the target's mass that goes to all bins alike."""

    def target(self, distribution, action):
        one_hot = galton.targets.one_hot(distribution.bins, action)
        return (1 - self.smoothing) * one_hot + self.smoothing / distribution.bins.n_bins

    def __call__(self, distribution, action):
        return cross_entropy(distribution, self.target(distribution, action))


galton.LOSSES["smoothed"] = Smoothed

if __name__ == "__main__":
    galton.use_all_cores()
    for smoothing in (0.0, 0.1, 0.5):
        agent = galton.make_agent(loss="smoothed", smoothing=smoothing, n_steps=5, net_arch=(), learning_rate=0.05)
        result = galton.train("bandit", agent, range(20), total_timesteps=2_000)
        print(f"smoothing {smoothing}: final training return {result.final('training_return').mean():.2f} of 25")
