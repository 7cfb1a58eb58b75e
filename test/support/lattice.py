"""Jittered points over a rectangle: level ground to raise things on."""

import numpy as np


def lattice(width, depth, spacing=0.8, seed=0, jitter=0.8, is_centred=False):
    """Points over a level rectangle from or about the origin, moved by a share of the spacing, 2 cm rough."""
    random = np.random.default_rng(seed)
    west, south = (-width / 2, -depth / 2) if is_centred else (0.0, 0.0)
    x, y = np.meshgrid(np.arange(west, west + width, spacing), np.arange(south, south + depth, spacing))
    xy = np.column_stack((x.ravel(), y.ravel())) + random.uniform(0, jitter * spacing, (x.size, 2))
    return np.column_stack((xy, random.normal(0, 0.02, x.size)))
