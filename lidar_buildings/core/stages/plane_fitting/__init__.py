"""
Roof planes: connected pieces of surface, as many as pay; or RANSAC as published.

Constants were chosen on the roofs of `bench.planes.run` unless said otherwise.
"""
