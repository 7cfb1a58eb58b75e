"""Tiny clouds and layers of polygons for the score command."""

import laspy
import numpy as np
import pyogrio.raw
import shapely

ORIGIN = np.array([85_000.0, 447_000.0, 0.0])


def write_cloud(path, points, classes, truth=None):
    """A LAZ file with these classes, and with the true ones in an extra dimension if they are given."""
    path.parent.mkdir(parents=True, exist_ok=True)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, ORIGIN
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = (np.asarray(points, dtype=float) + ORIGIN).T
    cloud.classification = np.asarray(classes, dtype=np.uint8)
    if truth is not None:
        cloud.add_extra_dim(laspy.ExtraBytesParams(name="TrueClass", type=np.uint8))
        cloud.TrueClass = np.asarray(truth, dtype=np.uint8)
    cloud.write(path)
    return path


def write_polygons(path, polygons, layer="outlines", crs="EPSG:28992"):
    """A layer of polygons, given in metres from the origin."""
    path.parent.mkdir(parents=True, exist_ok=True)
    moved = shapely.transform(np.array(polygons, dtype=object), lambda xy: xy + ORIGIN[:2])
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(moved),
        field_data=[],
        fields=[],
        crs=crs,
        geometry_type="Polygon",
        layer=layer,
        append=path.exists(),
    )
    return path
