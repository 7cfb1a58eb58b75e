"""Vector files: by the package's own writer, and any kind by GDAL."""

import warnings

import numpy as np
import pyogrio
import shapely

from lidar_buildings.io.vectors.layers import geopackage_file


def write_geopackage(path, layers, crs):
    with geopackage_file(path, crs) as add:
        for layer in layers:
            add(layer)


def write_vectors(path, shapes, *, crs="EPSG:28992", kind="Polygon", columns=None, **options):
    """Write shapes, None among them, with columns."""
    geometry = np.array([None if one is None else shapely.to_wkb(one) for one in shapes], dtype=object)
    columns = columns or {}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="'crs' was not provided")
        pyogrio.raw.write(
            path,
            geometry=geometry,
            field_data=[np.array(column) for column in columns.values()],
            fields=list(columns),
            geometry_type=kind,
            crs=crs,
            **options,
        )
    return path
