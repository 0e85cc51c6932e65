"""Thousands of runs: the grid, the plan on disk, the shards, and what carries them."""
