"""Extremes, damaged files and interrupted runs: `python -m benchmarks stability`."""
