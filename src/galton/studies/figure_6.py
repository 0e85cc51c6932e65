"""Figure 6: what the Gaussian is sensitive to."""

from galton.studies.sensitivity import study

FIGURE = study("gaussian", "the Gaussian", ("learning_rate",))
