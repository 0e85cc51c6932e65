"""From results to numbers and figures: statistics over runs, a comparison of losses, and how plots are drawn."""

import lazy_loader

from galton.extras import require_libraries

require_libraries("galton_experiments.analysis", "pyarrow", "matplotlib")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
