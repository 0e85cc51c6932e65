"""Figure 4: what HL-Gauss is sensitive to."""

from galton.studies.sensitivity import study

FIGURE = study("hl-gauss", "HL-Gauss", ("learning_rate", "n_bins", "eta"))
