"""From results to numbers and figures: statistics over runs, a comparison of losses, and how plots are drawn."""

from galton.extras import require_libraries

require_libraries("galton.analysis", "pyarrow", "matplotlib")
