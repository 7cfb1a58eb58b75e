"""Buildings as the layers of ``buildings.gpkg``, or as files of a layer each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.roof_lines import corner_kinds
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Face
from lidar_buildings.core.stages.facades.facade import NO_BUILDING, Facade
from lidar_buildings.io.models.survey_building import (
    BUILDING_FIELDS,
    FACE_FIELDS,
    READABLE_ID,
    Add,
    ModelHeading,
    SurveyBuilding,
    TerrainMesh,
)
from lidar_buildings.io.results.layer_looks import looks_in
from lidar_buildings.io.vectors.layers import VectorLayer, geopackage_file, write_flatgeobuf

_NAMES: dict[str, type] = {"building_id": int, READABLE_ID: str}
_ELEVATIONS: dict[str, type] = {"elevation_min": float, "elevation_max": float}
#: Layer → its columns.
LAYERS: dict[str, dict[str, type]] = {
    "outlines": BUILDING_FIELDS | {READABLE_ID: str},
    "traced": _NAMES,
    "roof_faces": {**_NAMES, "lod": str, "face": int, **FACE_FIELDS, **_ELEVATIONS},
    "roof_lines": {
        **_NAMES,
        "lod": str,
        "kind": str,
        "face": int,
        "other_face": int,
        "length": float,
        **_ELEVATIONS,
        "sigma_xy": float,
        "sigma_z": float,
    },
    "roof_corners": {
        **_NAMES,
        "lod": str,
        "kind": str,
        "elevation": float,
        "sigma_x": float,
        "sigma_y": float,
        "sigma_z": float,
    },
}
#: Those of what was seen from the street, which are there only where something was.
STREET_LAYERS: dict[str, dict[str, type]] = {
    "facades": {
        "facade_id": int,
        "building_id": int,
        "kind": str,
        "length": float,
        **_ELEVATIONS,
        "coverage": float,
        "seen_share": float,
        "sigma": float,
        "n_points": int,
        "confidence": float,
    },
    "street_lines": {
        "facade_id": int,
        "building_id": int,
        "seen": int,
        "length": float,
        "sigma": float,
        "confidence": float,
    },
}
_KINDS = {"outlines": "Polygon", "traced": "Polygon", "roof_faces": "Polygon Z", "roof_lines": "LineString Z"}
_KINDS |= {"facades": "Polygon Z", "street_lines": "LineString", "roof_corners": "Point Z"}
#: So many rows are written at a time.
_PORTION = 20_000
#: Decimals of a face's elevations, as of a building's.
_DECIMALS = 4
#: Lines that are shorter in plan have no direction [m].
_LEAST = 1e-6

_Rows = list[tuple[dict[str, Any], Any]]


@contextmanager
def building_layers_file(path: Path, heading: ModelHeading) -> Iterator[Add]:
    """Give a function that adds a building to a GeoPackage; the file appears when the block ends well."""
    looks = looks_in(heading.frame.vertical_unit)
    with geopackage_file(path, heading.frame.crs, looks) as append, _added(append, heading, _PORTION) as add:
        yield add


@contextmanager
def flatgeobuf_files(path: Path, heading: ModelHeading) -> Iterator[Add]:
    """Give a function that adds a building to FlatGeobuf files beside `path`; rows are held until the end."""

    def write(layer: VectorLayer) -> None:
        write_flatgeobuf(path.with_name(f"{layer.name}.fgb"), layer, heading.frame.crs)

    with _added(write, heading, math.inf) as add:
        yield add


@contextmanager
def _added(write: Callable[[VectorLayer], None], heading: ModelHeading, portion: float) -> Iterator[Add]:
    """Give a function that gathers rows; they are written in portions, at first all layers, even empty."""
    columns = LAYERS | STREET_LAYERS | {"outlines": heading.fields | {READABLE_ID: str}}
    rows: dict[str, _Rows] = {name: [] for name in columns}
    frame, begun = heading.frame, set[str]()

    def write_all() -> None:
        for name, own in rows.items():
            if own or name in LAYERS.keys() - begun:
                rows[name] = []
                geometries, known = [geometry for _, geometry in own], [row for row, _ in own]
                write(VectorLayer(name, geometries, columns[name], known, _KINDS[name]))
                begun.add(name)

    def add(building: SurveyBuilding | TerrainMesh | Facade) -> None:
        if isinstance(building, TerrainMesh):
            return
        if isinstance(building, Facade):
            rows["facades"].append(_facade(building, frame))
            rows["street_lines"] += _street_lines(building, frame)
            return
        names = {"building_id": building.building_id, READABLE_ID: building.readable_id}
        if building.outline is not None:
            rows["outlines"].append((building.attributes | names, _in_source(building.outline, frame)))
        if building.traced is not None:
            rows["traced"].append((names, _in_source(building.traced, frame)))
        rows["roof_faces"] += [(names | known, polygon) for known, polygon in _roof_faces(building, frame)]
        rows["roof_lines"] += [(names | known, line) for known, line in _roof_lines(building, frame)]
        rows["roof_corners"] += [(names | known, place) for known, place in _roof_corners(building, frame)]
        if len(rows["roof_faces"]) + len(rows["outlines"]) >= portion:
            write_all()

    yield add
    write_all()


def _facade(facade: Facade, frame: MapFrame) -> tuple[dict[str, Any], shapely.Polygon]:
    corners = frame.to_source(facade.ring)
    low, high = np.round([corners[:, 2].min(), corners[:, 2].max()], _DECIMALS).tolist()
    known = {
        **_of_facade(facade, facade.length, frame),
        "kind": facade.kind,
        "elevation_min": low,
        "elevation_max": high,
        "coverage": round(facade.coverage, _DECIMALS),
        "seen_share": round(facade.seen_share, _DECIMALS),
        "n_points": facade.n_points,
    }
    return known, shapely.Polygon(corners)


def _street_lines(facade: Facade, frame: MapFrame) -> Iterator[tuple[dict[str, Any], shapely.LineString]]:
    for line, is_seen in facade.stretches:
        length = float(np.hypot(*np.diff(line, axis=0).T).sum())
        known = _of_facade(facade, length, frame) | {"seen": int(is_seen)}
        yield known, shapely.LineString(frame.to_source(np.insert(line, 2, 0.0, axis=1))[:, :2])


def _of_facade(facade: Facade, length: float, frame: MapFrame) -> dict[str, Any]:
    return {
        "facade_id": facade.facade_id,
        "building_id": None if facade.building_id == NO_BUILDING else facade.building_id,
        "length": round(length / frame.vertical_unit, _DECIMALS),
        "sigma": round(facade.sigma / frame.vertical_unit, _DECIMALS),
        "confidence": round(facade.confidence, _DECIMALS),
    }


def _roof_faces(
    building: SurveyBuilding, frame: MapFrame
) -> Iterator[tuple[dict[str, Any], shapely.Polygon]]:
    solid = building.solid
    if solid is None:
        return
    faces = [f for f, kind in zip(solid.faces, solid.semantics, strict=True) if kind == ROOF_SURFACE]
    vertices = frame.to_source(solid.vertices)
    elevations = np.round(vertices[:, 2], _DECIMALS).tolist()
    polygons = _polygons(vertices, faces)
    for number, (face, polygon) in enumerate(zip(faces, polygons, strict=True), start=1):
        own = [elevations[row] for ring in face for row in ring]
        known = {"lod": building.lod, "face": number, "elevation_min": min(own), "elevation_max": max(own)}
        yield building.roof_faces[number - 1] | known, polygon


def _roof_lines(
    building: SurveyBuilding, frame: MapFrame
) -> Iterator[tuple[dict[str, Any], shapely.LineString]]:
    ends = np.array([line.ends for line in building.lines]).reshape(-1, 2, 3)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / frame.vertical_unit
    places = frame.to_source(ends.reshape(-1, 3)).reshape(-1, 2, 3)
    columns = [*np.sort(places[:, :, 2]).T, lengths]
    numbers = np.round(np.column_stack(columns), _DECIMALS).tolist()
    vertices = np.empty((0, 3)) if building.solid is None else building.solid.vertices
    sigma_at = {_place(vertices[row]): sigma for row, sigma in building.corner_sigmas.items()}
    for line, (low, high, length), shape in zip(
        building.lines, numbers, shapely.linestrings(places), strict=True
    ):
        known = {
            "lod": building.lod,
            "kind": line.kind,
            "face": line.faces[0],
            "other_face": line.faces[1] if len(line.faces) > 1 else None,
            "length": length,
            "elevation_min": low,
            "elevation_max": high,
            **_sigmas_of_line(line.ends, sigma_at),
        }
        yield known, shape


def _sigmas_of_line(
    ends: NDArray[np.float64], sigma_at: dict[tuple[int, ...], list[Any]]
) -> dict[str, float | None]:
    """Return the standard deviations of a line across in plan and along z: the means of its ends'."""
    own = [sigma_at[place] for place in map(_place, ends) if place in sigma_at]
    x, y = ends[1, :2] - ends[0, :2]
    length = max(math.hypot(x, y), _LEAST)
    plan = [math.hypot(one[0] * y, one[1] * x) / length for one in own if one[0] is not None]
    return {"sigma_xy": _mean(plan), "sigma_z": _mean([one[2] for one in own])}


def _mean(values: Sequence[float]) -> float | None:
    return round(sum(values) / len(values), _DECIMALS) if values else None


def _place(vertex: NDArray[np.float64]) -> tuple[int, ...]:
    return tuple(np.rint(vertex / GRID).astype(np.int64).tolist())


def _roof_corners(
    building: SurveyBuilding, frame: MapFrame
) -> Iterator[tuple[dict[str, Any], shapely.Point]]:
    if building.solid is None:
        return
    places = frame.to_source(building.solid.vertices)
    for row, kind in sorted(corner_kinds(building.solid, building.lines).items()):
        if row in building.corner_sigmas:
            sigmas = dict(zip(("sigma_x", "sigma_y", "sigma_z"), building.corner_sigmas[row], strict=True))
            elevation = round(float(places[row, 2]), _DECIMALS)
            known = {"lod": building.lod, "kind": kind, "elevation": elevation, **sigmas}
            yield known, shapely.Point(places[row])


def _polygons(vertices: NDArray[np.float64], faces: Sequence[Face]) -> NDArray[Any]:
    rings = [ring for face in faces for ring in face]
    corners = vertices[np.fromiter(chain.from_iterable(rings), dtype=np.intp)]
    number = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    of_face = np.repeat(np.arange(len(faces)), [len(face) for face in faces])
    polygons: NDArray[Any] = shapely.polygons(shapely.linearrings(corners, indices=number), indices=of_face)
    return polygons


def _in_source(outline: Outline, frame: MapFrame) -> shapely.Polygon:
    """Return an outline in source coordinates, empty where its ring is none."""
    return shapely.transform(
        outline.polygon, lambda xy: frame.to_source(np.insert(xy, 2, 0.0, axis=1))[:, :2]
    )
