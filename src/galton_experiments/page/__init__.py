"""One self-contained HTML page: claims, figures as inline SVG with the numbers behind them, and how they were made."""

import lazy_loader

from galton.extras import require_libraries

require_libraries("galton_experiments.page", "matplotlib", "jinja2")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
