"""Figure 5: what HL-1-Hot is sensitive to."""

from galton.studies.sensitivity import study

FIGURE = study("hl-one-hot", "HL-1-Hot", ("learning_rate", "n_bins"))
