"""From algorithm and environment to trained runs: rollouts, evaluation, the loop over many runs."""
