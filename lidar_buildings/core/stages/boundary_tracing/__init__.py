"""Boundary tracing: the rings round a building's points."""
