"""Segmentation: roof points that belong to one building."""
