"""
Roof selection: find the roofs among all points, and give every point its final class.

`selection` is the stage. `smooth_patches` is the default method, started by `roof_patches`; `wet_roofs`
adds roofs of which only the rims came back. `published_methods` are the others.
"""
