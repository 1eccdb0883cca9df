"""How accurate the suite is, for how much time: `python -m benchmarks --help`."""
