"""Polygons and attributes in GIS files."""
