"""Thousands of runs: a grid of settings, the plan on disk, its shards, what carries them out, and the results.

A study says what is trained (study, grid, search); a plan deals its runs into shards (plan, shard); an engine gives
them to executors (engine, executors, cluster); and store, parquet and results keep what comes of them.
"""
