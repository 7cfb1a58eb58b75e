"""Scans of a moving sensor: layouts of messages, times of points, poses, and places in the map."""
