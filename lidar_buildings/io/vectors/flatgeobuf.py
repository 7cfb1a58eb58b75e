"""Polygons and lines with attributes written to FlatGeobuf files, one layer each, with a spatial index."""

from __future__ import annotations

from pathlib import Path

from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.vectors.geopackage import FAILURES, VectorLayer, check_complete, write_layer


def write_flatgeobuf(path: Path, layer: VectorLayer, crs: str) -> None:
    """
    Write a layer; the format has its features in the order of the index and takes no more later.

    Parameters
    ----------
    path : Path
        An existing file is replaced.
    layer : VectorLayer
        All of it.
    crs : str
        ``"EPSG:28992"``, a WKT text, or empty if unknown.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with atomic_file(path, FAILURES) as temporary:
        write_layer(temporary, layer, crs, driver="FlatGeobuf")
        check_complete(temporary, {layer.name: len(layer.geometries)})
