"""Thousands of runs: the grid, the plan on disk, the shards, and what carries them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
