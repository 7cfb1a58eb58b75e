"""Layers of polygons written to one GeoPackage."""

from lidar_buildings.io.vectors.geopackage import GeoPackageWriter


def write_geopackage(path, layers, crs):
    with GeoPackageWriter(path, crs) as writer:
        for layer in layers:
            writer.append(layer)
