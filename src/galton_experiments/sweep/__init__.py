"""Thousands of runs: a grid of settings, the plan on disk, its shards, what carries them out, and the results.

A study says what is trained (study, grid, search); a plan deals its runs into shards (plan, shard); an engine gives
them to executors (engine, executors, cluster); and store, parquet and results keep what comes of them.
"""

import lazy_loader

from galton.extras import require_libraries

require_libraries("galton_experiments.sweep", "pyarrow", "fsspec")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
