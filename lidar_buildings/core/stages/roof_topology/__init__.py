"""
How the planes of a roof border on one another: ridges, hips, valleys, step edges, and the kind of roof.

Lengths are in point spacings and were chosen on the virtual roofs of `bench.pages.roof_topology` unless said.
"""
