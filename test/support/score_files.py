"""Tiny clouds and layers of polygons for the score command."""

import laspy
import numpy as np
import pyogrio.raw
import shapely

ORIGIN = np.array([85_000.0, 447_000.0, 0.0])


def write_cloud(path, points, classes=0, truth=None, colour=None, origin=ORIGIN, **dimensions):
    """A LAZ file with these classes; the true ones, if given, and what else is are extra dimensions."""
    if truth is not None:
        dimensions["TrueClass"] = np.asarray(truth, dtype=np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    header = laspy.LasHeader(point_format=6 if colour is None else 7, version="1.4")
    header.scales, header.offsets = [0.001] * 3, origin
    for name, values in dimensions.items():
        header.add_extra_dim(laspy.ExtraBytesParams(name, values.dtype))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = (np.asarray(points, dtype=float) + origin).T
    cloud.classification = np.broadcast_to(np.asarray(classes, dtype=np.uint8), len(points))
    for name, values in dimensions.items():
        cloud[name] = values
    if colour is not None:
        cloud.red, cloud.green, cloud.blue = np.asarray(colour, dtype=np.uint16).T
    cloud.write(path)
    return path


def write_polygons(path, polygons, layer="outlines", crs="EPSG:28992", **attributes):
    """A layer of polygons, given in metres from the origin, with columns of numbers."""
    path.parent.mkdir(parents=True, exist_ok=True)
    moved = shapely.transform(np.array(polygons, dtype=object), lambda xy: xy + ORIGIN[:2])
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(moved),
        field_data=[np.array(column, dtype=np.float64) for column in attributes.values()],
        fields=list(attributes),
        crs=crs,
        geometry_type="Polygon",
        layer=layer,
        append=path.exists(),
    )
    return path
