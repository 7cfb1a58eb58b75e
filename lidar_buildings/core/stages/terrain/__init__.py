"""Terrain: the ground's TIN as elevations anywhere, heights above it, and rasters of ground and surface."""
