"""The paper, whole: what is trained for it, every figure, its claims, and the page that says what holds.

A figure with its sweeps, table and claims is one record (figure.FigureStudy), in a file here and a line in
registry.FIGURES; reproduce trains and measures what figures need, and report makes the page of it.
"""

import lazy_loader

from galton.extras import require_libraries

require_libraries("galton.paper", "pyarrow", "matplotlib", "fsspec")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
