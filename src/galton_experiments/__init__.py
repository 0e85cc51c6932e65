"""Experiments with Galton: sweeps of thousands of runs, statistics, benchmarks and pages that show what was found."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
