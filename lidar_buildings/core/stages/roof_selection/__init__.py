"""Roof selection: find the roofs among all points, and give every point its final class."""
