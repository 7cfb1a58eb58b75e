"""Benchmarks of every stage beside its peers and exact truth; run as `python -m bench.roofs.run`."""
