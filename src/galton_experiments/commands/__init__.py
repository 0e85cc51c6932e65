"""The commands of many runs: compare, sweep, benchmark and plot."""
