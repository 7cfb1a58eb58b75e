"""Tiles on disk read back as a whole: a run reads what it needs of each."""

import numpy as np

from lidar_buildings.io.results import tile_products


def load_products(path):
    """What `TileProducts.save` wrote."""
    sources = tile_products.load_sources(path)
    kinds = {"core": tile_products.CORE, "roofs": tile_products.ROOFS, "edges": tile_products.EDGES}
    rows = [
        np.concatenate([np.zeros(0, kind), *(tile_products.load_rows(path, name, one) for one in sources)])
        for name, kind in kinds.items()
    ]
    rasters = None if tile_products.load_raster_window(path) is None else tile_products.load_rasters(path)
    return tile_products.TileProducts(
        tile_products.load_stamp(path),
        *rows,
        *tile_products.load_shapes(path),
        facades=tile_products.load_facades(path),
        rasters=rasters,
    )
