"""
The files of more buildings than one file should hold: a folder per block, and an index of the blocks.

Blocks are the squares of a quadtree. The index is a GeoJSON like a collection of items of STAC
(https://stacspec.org), without dates, so that equal surveys give equal bytes.
"""

from __future__ import annotations

import json
import pickle
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO

import numpy as np
import shapely

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.files.atomic_files import atomic_folder
from lidar_buildings.io.files.reference_systems import reprojected
from lidar_buildings.io.models.survey_building import SurveyBuilding, TerrainMesh
from lidar_buildings.io.results.building_files import write_buildings
from lidar_buildings.io.results.model_heading import ModelHeading
from lidar_buildings.io.results.output_config import TILES
from lidar_buildings.io.results.run_folder import BLOCKS
from lidar_buildings.io.results.squares import Square, squares_of
from lidar_buildings.io.results.survey_buildings import SurveyBuildings, SurveyPart

INDEX = "index.json"
#: What a block has instead of a GeoPackage: one layer a file, which readers over a network can read in parts.
_INSTEAD = {"gpkg": "flatgeobuf"}
_DEGREES = "EPSG:4326"
_DECIMALS = 7


def write_in_blocks(
    folder: Path,
    buildings: SurveyBuildings,
    formats: Collection[str],
    heading: ModelHeading,
    terrain: Iterable[TerrainMesh] = (),
    *,
    largest: int,
) -> tuple[list[str], dict[str, int]]:
    """
    Write buildings as `write_buildings` does, the files of each block into a folder of its own.

    FlatGeobuf stands for GeoPackage there. 3D Tiles are divided by themselves, and not again.

    Parameters
    ----------
    folder, buildings, formats, heading, terrain
        As of `write_buildings`.
    largest : int
        Buildings a block may have.

    Returns
    -------
    files : list of str
        The folder of the blocks, and that of 3D Tiles.
    statuses : dict
        As of `write_buildings`.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    in_blocks = {_INSTEAD.get(name, name) for name in formats if name != TILES}
    squares = squares_of(buildings.places(), largest)
    tiles: list[str] = []
    total: Counter[str] = Counter()
    items = []
    with atomic_folder(folder / BLOCKS) as blocks, TemporaryFile(dir=blocks) as file:
        meshes = _TerrainOfSquares(file, [square for square, _ in squares], terrain)
        parts = buildings.parts(rows for _, rows in squares)
        for number, ((square, rows), part) in enumerate(zip(squares, parts, strict=True)):
            measured = _Measured(part)
            block = blocks / _name(square, buildings.frame)
            block.mkdir()
            files, statuses = write_buildings(block, measured.part, in_blocks, heading, meshes.of(number))
            total.update(statuses)
            items.append(_item(block, files, {"buildings": len(rows), "statuses": statuses}, measured))
        lines = ",\n".join(json.dumps(item, ensure_ascii=False) for item in items)
        index = f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'
        (blocks / INDEX).write_text(index, encoding="utf-8")
        if TILES in formats:
            tiles, _ = write_buildings(folder, buildings, [TILES], heading, meshes.all())
    return [BLOCKS, *tiles], dict(sorted(total.items()))


class _TerrainOfSquares:
    """Keeps pieces of terrain in a file, and which square each is of: that around it, or nearest to it."""

    def __init__(self, file: BinaryIO, squares: list[Square], terrain: Iterable[TerrainMesh]) -> None:
        self._file = file
        self._starts: list[list[int]] = [[] for _ in squares]
        for mesh in terrain:
            middle = (mesh.vertices[:, :2].min(axis=0) + mesh.vertices[:, :2].max(axis=0)) / 2.0
            nearest = min(range(len(squares)), key=lambda number: squares[number].distance(middle))
            self._starts[nearest].append(file.tell())
            pickle.dump(mesh, file, protocol=pickle.HIGHEST_PROTOCOL)

    def of(self, number: int) -> Iterator[TerrainMesh]:
        """Yield the pieces of a square."""
        for start in self._starts[number]:
            self._file.seek(start)
            yield pickle.load(self._file)

    def all(self) -> Iterator[TerrainMesh]:
        """Yield the pieces of all squares."""
        for number in range(len(self._starts)):
            yield from self.of(number)


class _Measured:
    """A part of a survey, and where the buildings lie that were read of it."""

    def __init__(self, part: SurveyPart) -> None:
        self.part = replace(part, read=self._read)
        self._whole = part
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)

    @property
    def box(self) -> Any:
        """The box around solids and outlines in source coordinates, None if there is nothing."""
        corners = np.array([[*self._low, 0.0], [*self._high, 0.0]])
        if not np.isfinite(corners).all():
            return None
        return shapely.box(*self.part.frame.to_source(corners)[:, :2].ravel())

    @property
    def crs(self) -> str:
        """The part's horizontal reference system."""
        return self.part.frame.crs

    def _read(self) -> Iterator[SurveyBuilding]:
        for building in self._whole:
            outline = building.outline or building.traced
            vertices = [outline.exterior] if outline is not None else []
            if building.solid is not None:
                vertices.append(building.solid.vertices[:, :2])
            for xy in vertices:
                self._low = np.minimum(self._low, xy.min(axis=0, initial=np.inf))
                self._high = np.maximum(self._high, xy.max(axis=0, initial=-np.inf))
            yield building


def _item(block: Path, files: list[str], facts: dict[str, Any], measured: _Measured) -> dict[str, Any]:
    """Return what the index says of a block: where it lies, on the earth too, counts, and files."""
    item: dict[str, Any] = {"type": "Feature", "stac_version": "1.0.0", "id": block.name, "geometry": None}
    properties: dict[str, Any] = {"datetime": None, **facts}
    if measured.box is not None:
        properties["proj:bbox"] = np.round(measured.box.bounds, 3).tolist()
    if measured.box is not None and measured.crs:
        properties["proj:code" if measured.crs.startswith("EPSG:") else "proj:wkt2"] = measured.crs
        (around,) = reprojected(np.array([measured.box]), measured.crs, _DEGREES, str(block))
        if np.isfinite(around.bounds).all():
            item["geometry"] = json.loads(shapely.to_geojson(shapely.set_precision(around, 10.0**-_DECIMALS)))
            item["bbox"] = np.round(around.bounds, _DECIMALS).tolist()
    assets = {
        file: {"href": f"{block.name}/{file}", "file:size": (block / file).stat().st_size} for file in files
    }
    return item | {"properties": properties, "assets": assets, "links": []}


def _name(square: Square, frame: MapFrame) -> str:
    x, y, _ = frame.to_source(np.array([[square.west, square.south, 0.0]]))[0]
    return f"block-{x:.0f}-{y:.0f}"
