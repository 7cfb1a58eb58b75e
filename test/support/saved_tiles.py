"""Tiles on disk read back as a whole: a run reads what it needs of each."""

import numpy as np

from lidar_buildings.io.results.tile_products import (
    CORE,
    EDGES,
    ROOFS,
    TileProducts,
    load_raster_window,
    load_rasters,
    load_rows,
    load_shapes,
    load_sources,
    load_stamp,
)


def load_products(path):
    """What `TileProducts.save` wrote."""
    sources = load_sources(path)
    core, roofs, edges = (
        np.concatenate([np.zeros(0, kind), *(load_rows(path, name, source) for source in sources)])
        for name, kind in (("core", CORE), ("roofs", ROOFS), ("edges", EDGES))
    )
    rasters = None if load_raster_window(path) is None else load_rasters(path)
    return TileProducts(load_stamp(path), core, roofs, edges, *load_shapes(path), rasters)
