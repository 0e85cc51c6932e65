"""Under Adam the mean of a softmax moves about 0.8 σ as fast as a Gaussian's at the same learning rate (P4).

With the advantage A = α (a − μ) + noise of σ_A, a step of Adam is the learning rate times signal over noise. A
Gaussian's mean has the signal α and the noise σ_A / σ, with the policy's σ. What is told of both is in units of
lr · α / σ_A.
"""

import numpy as np
import pytest

from galton import targets

K = 100
CENTERS = (np.arange(K) + 0.5) / K * 2 - 1


def steps(std, eta):
    """How far the means of a Gaussian and of a softmax with that policy move: the latter by its closed form."""
    probs = np.exp(-(CENTERS**2) / (2 * std**2))
    probs /= probs.sum()
    of_rows = np.asarray(targets.hl_gauss_of_center(K, np.arange(K), eta, "reflected"), np.float64)
    moves = of_rows - probs @ of_rows  # of the logits, for each action
    signal = (probs * CENTERS) @ moves
    noise = np.sqrt(probs @ moves**2)
    return std, (probs * CENTERS) @ (signal / noise)


@pytest.mark.parametrize("std", [0.05, 0.1, 0.2])
def test_a_wide_target_moves_the_mean_nearly_as_fast_as_predicted_and_a_narrow_one_does_not(std):
    gaussian, wide = steps(std, 9.0)
    _, narrow = steps(std, 0.1)
    predicted = np.sqrt(2 / np.pi) * std
    assert 0.7 < wide / gaussian / predicted < 1.1
    assert narrow / gaussian < 0.45 * predicted


def test_a_simulation_of_adam_agrees():
    """Both policies learn from the same noisy advantages; how far their means come in the first steps."""
    rng, std, alpha, rate, batch, n_steps = np.random.default_rng(0), 0.2, 1.0, 1e-4, 64, 400
    probs = np.exp(-(CENTERS**2) / (2 * std**2))
    of_rows = np.asarray(targets.hl_gauss_of_center(K, np.arange(K), 9.0, "reflected"), np.float64)
    first, logits, mean = np.log(probs / probs.sum()), np.zeros(K), np.zeros(1)
    moments = {name: [np.zeros(size), np.zeros(size)] for name, size in (("softmax", K), ("gaussian", 1))}

    def adam(name, gradient, t):
        first_moment, second = moments[name]
        first_moment[:] = 0.9 * first_moment + 0.1 * gradient
        second[:] = 0.999 * second + 0.001 * gradient**2
        return rate * first_moment / (1 - 0.9**t) / (np.sqrt(second / (1 - 0.999**t)) + 1e-8)

    for t in range(1, n_steps + 1):
        now = np.exp(first + logits)
        now /= now.sum()
        index = rng.choice(K, batch, p=now)
        noise = 5 * rng.normal(size=batch)
        credit = alpha * CENTERS[index] + noise
        logits += adam("softmax", (credit[:, None] * (of_rows[index] - now @ of_rows)).mean(0), t)
        action = mean + std * rng.normal(size=batch)
        mean += adam("gaussian", np.atleast_1d(((alpha * action + noise) * (action - mean) / std**2).mean()), t)
    moved = np.exp(first + logits) @ CENTERS / np.exp(first + logits).sum()
    assert moved / mean[0] == pytest.approx(np.sqrt(2 / np.pi) * std, rel=0.5)
