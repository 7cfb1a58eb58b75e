"""What a page shows of a result: which buildings, points and terrain fit into it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rasterio
import shapely
from numpy.typing import NDArray
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.windows import Window, from_bounds

from lidar_buildings.core.model.classes import PointClass, is_of_groups
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.grade import Grade
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.shell import (
    GROUND_SURFACE,
    OUTER_CEILING_SURFACE,
    ROOF_SURFACE,
    WALL_SURFACE,
)
from lidar_buildings.core.solids.triangulation import face_pieces, triangles_of
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.clouds.point_columns import xyz_of
from lidar_buildings.io.models.cityjson import load_feature
from lidar_buildings.io.results.classified_files import every_stretch, stretches
from lidar_buildings.io.results.run_folder import DTM
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.report.result_folder import ReportedBuilding, Result

#: What stands in cells that are not known.
UNKNOWN = -32_768
_RELIEF_STEPS = 65_000


@dataclass(frozen=True, eq=False)
class Relief:
    """Elevations, row by row from north to south."""

    #: Elevations are `middle` + `steps` × `step`; `UNKNOWN` where there are none. Shape (n_rows, n_columns).
    steps: NDArray[np.int16]
    #: Map frame [m].
    middle: float
    step: float
    #: Outer corner of the first cell, map frame [m].
    west: float
    north: float
    cell: tuple[float, float]  #: width and height of a cell [m]


def read_relief(path: Path, frame: MapFrame, box: Rectangle | None, most_cells: int) -> Relief:
    """Read a raster or a box of it, at most `most_cells` along a side; InputError if it cannot be read."""
    try:
        with rasterio.open(path) as file:
            window = _window(file, frame, box)
            coarser = max(window.width, window.height, most_cells) / most_cells
            shape = max(round(window.height / coarser), 1), max(round(window.width / coarser), 1)
            resampling = Resampling.average if coarser > 1 else Resampling.nearest
            read = file.read(1, window=window, out_shape=shape, masked=True, resampling=resampling)
            transform = file.window_transform(window)
            cell = tuple(
                size * file.res[axis] * frame.horizontal_unit / shape[1 - axis]
                for axis, size in enumerate((window.width, window.height))
            )
    except (RasterioError, OSError) as error:
        raise InputError(f"{path}: cannot be read ({error}): run it again") from error
    x, y, _ = frame.to_map(np.array([[transform.c, transform.f, 0.0]]))[0].tolist()
    elevations = read.astype(np.float64) * frame.vertical_unit - frame.origin[2]
    known = elevations.compressed()
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    middle, step = (low + high) / 2, max((high - low) / _RELIEF_STEPS, 0.01)
    steps = np.ma.filled(np.rint((elevations - middle) / step), UNKNOWN).astype(np.int16)
    return Relief(steps, middle, step, x, y, (cell[0], cell[1]))


def _window(file: rasterio.DatasetReader, frame: MapFrame, box: Rectangle | None) -> Window:
    whole = Window(0, 0, file.width, file.height)
    if box is None:
        return whole
    corners = np.insert(np.reshape(box, (2, 2)), 2, 0.0, axis=1)
    (west, south, _), (east, north, _) = frame.to_source(corners)
    wanted = from_bounds(west, south, east, north, file.transform)
    try:
        return wanted.intersection(whole).round_offsets().round_lengths()
    except rasterio.errors.WindowError:
        return whole


#: Kind of surface → its number in the page, where soffits look as walls do.
KINDS = {GROUND_SURFACE: 0, WALL_SURFACE: 1, ROOF_SURFACE: 2, OUTER_CEILING_SURFACE: 1}


class ModelArrays(NamedTuple):
    """Solids one after the other."""

    vertices: NDArray[np.int32]  #: each building's once, for all its levels [mm], shape (n_vertices, 3)
    #: Rows of the vertices, counter-clockwise from outside, shape (n_triangles, 3).
    triangles: NDArray[np.uint32]
    faces: NDArray[np.uint16]  #: number of the solid's face that a triangle is of, shape (n_triangles,)
    kinds: NDArray[np.uint8]  #: values of `KINDS`, shape (n_triangles,)
    #: The building's row, the level of detail times ten, its first triangle, and how many it has, shape
    #: (n_solids, 4).
    solids: NDArray[np.int32]
    n_left_out: int  #: buildings beyond the budget


def model_arrays(lines: Iterable[str], names: Sequence[str], most_triangles: int) -> ModelArrays:
    """
    Divide the solids of buildings, from their CityJSONFeatures, into triangles.

    Beyond the most triangles buildings are left out. InputError if a line is no such feature.
    """
    row_of = {name: row for row, name in enumerate(names)}
    vertices = [np.empty((0, 3), dtype=np.int32)]
    triangles = [np.empty((0, 3), dtype=np.uint32)]
    faces, kinds = [np.empty(0, dtype=np.uint16)], [np.empty(0, dtype=np.uint8)]
    solids: list[tuple[int, int, int, int]] = []
    n_vertices = n_triangles = n_left_out = 0
    for line in lines:
        if n_triangles >= most_triangles:
            n_left_out += 1
            continue
        feature = load_feature(line)[0]
        own = np.array(feature["vertices"], dtype=np.int32).reshape(-1, 3)
        for geometry in feature["CityObjects"][feature["id"]]["geometry"]:
            corners, face_numbers, surfaces = _triangles(geometry, own * GRID)
            level = round(10 * float(geometry["lod"]))
            solids.append((row_of[feature["id"]], level, n_triangles, len(corners)))
            triangles.append(corners + np.uint32(n_vertices))
            faces.append(face_numbers)
            kinds.append(surfaces)
            n_triangles += len(corners)
        vertices.append(own)
        n_vertices += len(own)
    return ModelArrays(
        np.concatenate(vertices),
        np.concatenate(triangles),
        np.concatenate(faces),
        np.concatenate(kinds),
        np.array(solids, dtype=np.int32).reshape(-1, 4),
        n_left_out,
    )


def _triangles(
    geometry: dict[str, Any], vertices: NDArray[np.float64]
) -> tuple[NDArray[np.uint32], NDArray[np.uint16], NDArray[np.uint8]]:
    """Return the triangles of a solid, the number of the face of each, and its kind."""
    surfaces = [KINDS[surface["type"]] for surface in geometry["semantics"]["surfaces"]]
    (shell,), (values,) = geometry["boundaries"], geometry["semantics"]["values"]
    by_face = [
        triangles_of(pieces)
        for pieces in face_pieces(vertices, [tuple(map(tuple, rings)) for rings in shell])
    ]
    counts = [len(one) for one in by_face]
    corners = chain.from_iterable(chain.from_iterable(by_face))
    return (
        np.fromiter(corners, dtype=np.uint32, count=3 * sum(counts)).reshape(-1, 3),
        np.repeat(np.arange(len(counts), dtype=np.uint16), counts),
        np.repeat(np.array([surfaces[value] for value in values], dtype=np.uint8), counts),
    )


#: Set in `classes` for points of walls.
FACADE = 128
#: Read beside the class; numbers of buildings are whole in float64, too.
_DIMENSIONS = ("BuildingId", "PlaneId", "EdgeLabel", "intensity", "HeightAboveGround", "red", "green", "blue")
#: Share of the budget that the points of buildings may take.
_OF_BUILDINGS = 0.6
_STEPS = 65_535


@dataclass(frozen=True, eq=False)
class ShownPoints:
    """Points without noise, in whole steps from a corner, sorted by building."""

    steps: NDArray[np.uint16]  #: coordinates are `corner` + `steps` × `step`, shape (n_points, 3)
    #: Map frame [m], shape (3,).
    corner: NDArray[np.float64]
    step: NDArray[np.float64]
    classes: NDArray[np.uint8]  #: ASPRS class, with `FACADE` added for walls, shape (n_points,)
    #: One more than the building's row, 0 for none of those that are shown, shape (n_points,).
    building: NDArray[np.uint16]
    #: The plane within its building, 0 for none, counted on from 1 after 255, shape (n_points,).
    plane: NDArray[np.uint8]
    edge: NDArray[np.bool_]  #: whether the point lies on an edge of a roof, shape (n_points,)
    intensity: NDArray[np.uint16]  #: the source's, 0 where it has none, shape (n_points,)
    height: NDArray[np.float32]  #: above ground [m], 0 where it is not known, shape (n_points,)
    colours: (
        NDArray[np.uint8] | None
    )  #: red, green and blue, None where the source has none, shape (n_points, 3)


def read_shown_points(
    clouds: Sequence[Path],
    frame: MapFrame,
    n_per_class: Mapping[int, int],
    rows: Mapping[int, int],
    box: Rectangle | None,
    most: int,
) -> ShownPoints:
    """
    Read the points of classified clouds, in a box or all, thinned by their number per class to the most.

    `rows` leads from a building's id to its row.
    """
    opened = [one for one in map(open_cloud, clouds) if one.point_count]
    opened = [one for one in opened if box is None or box.touches(limits_of(one, frame))]
    n_points = sum(one.point_count for one in opened)
    every = every_stretch(n_points)
    share = n_points / max(sum(n_per_class.values()), 1)
    n_roof = round(n_per_class.get(PointClass.BUILDING, 0) * share) // every
    roof_step = max(1, -(-n_roof // round(most * _OF_BUILDINGS)))
    other_step = max(1, -(-(n_points // every - n_roof) // max(most - n_roof // roof_step, 1)))
    chunks = chain.from_iterable(stretches(one, every) for one in opened)
    parts = [_thinned(chunk, frame, (roof_step, other_step)) for chunk in chunks]
    xyz = np.concatenate([*(one for one, _ in parts), np.empty((0, 3))])
    labels = np.concatenate([*(one for _, one in parts), np.empty((0, 1 + len(_DIMENSIONS)))])
    if box is not None:
        within = box.holds(xyz[:, 0], xyz[:, 1])
        xyz, labels = xyz[within], labels[within]
    labels[:, 1] = _rows_of(labels[:, 1], rows)
    order = np.argsort(labels[:, 1], kind="stable")[:most]
    low, high = (xyz.min(axis=0), xyz.max(axis=0)) if len(xyz) else (np.zeros(3), np.zeros(3))
    step = np.maximum((high - low) / _STEPS, 0.001)
    classes, building, plane, edge, intensity, height, *colours = labels[order].T
    return ShownPoints(
        np.rint((xyz[order] - low) / step).astype(np.uint16),
        low,
        step,
        classes.astype(np.uint8),
        building.astype(np.uint16),
        np.where(plane > 0, (plane - 1) % 255 + 1, 0).astype(np.uint8),
        edge > 0,
        intensity.astype(np.uint16),
        (height * frame.vertical_unit).astype(np.float32),
        _bytes_of(np.stack(colours, axis=1)),
    )


def _bytes_of(colours: NDArray[np.float64]) -> NDArray[np.uint8] | None:
    """Return colours of 16 bits, or of 8 as some writers leave them, as bytes; None if all are black."""
    most = colours.max(initial=0.0)
    return np.rint(colours / (257.0 if most > 255 else 1.0)).astype(np.uint8) if most else None


def limits_of(cloud: Cloud, frame: MapFrame) -> Rectangle:
    """Return where a cloud's points lie in the map frame [m]."""
    return Rectangle(*frame.to_map(np.stack([cloud.mins, cloud.maxs]))[:, :2].ravel().tolist())


def _thinned(
    chunk: Any, frame: MapFrame, steps: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return coordinates [m] and class and `_DIMENSIONS`: of roofs and of the rest every so many-th."""
    classes = np.asarray(chunk["classification"])
    is_roof = classes == PointClass.BUILDING
    is_rest = ~is_roof & ~is_of_groups(classes, ["noise"])
    chosen = [np.flatnonzero(which)[::step] for which, step in zip((is_roof, is_rest), steps, strict=True)]
    kept = np.sort(np.concatenate(chosen))
    few = chunk[kept]
    known = set(few.point_format.dimension_names)
    labels = np.zeros((len(few), 1 + len(_DIMENSIONS)))
    labels[:, 0] = np.minimum(classes[kept], FACADE - 1)
    if "Facade" in known:
        labels[:, 0] += FACADE * (np.asarray(few["Facade"]) > 0)
    for column, name in enumerate(_DIMENSIONS, start=1):
        if name in known:
            labels[:, column] = np.nan_to_num(np.asarray(few[name]))
    return frame.to_map(xyz_of(few)), labels


def _rows_of(ids: NDArray[np.float64], rows: Mapping[int, int]) -> NDArray[np.int64]:
    """Return one more than the row of each building id, 0 where it has none."""
    if not rows:
        return np.zeros(len(ids), dtype=np.int64)
    known = np.array(sorted(rows), dtype=np.int64)
    place = np.minimum(np.searchsorted(known, ids), len(known) - 1)
    row = np.array([rows[one] for one in known.tolist()], dtype=np.int64)
    return np.where(known[place] == ids, row[place] + 1, 0)


#: What fits into 20 MB: a triangle takes some 10 bytes of the page, a point 9, a building's attributes 200.
MOST_BUILDINGS, MOST_TRIANGLES, MOST_POINTS = 4_000, 900_000, 400_000
#: Cells of the terrain along its longer side.
MOST_CELLS = 300
#: Width of the strip that is shown round the buildings where not all are [m].
_MARGIN = 30.0
_MOST = 10
#: Grades from good to bad.
_GRADES = [grade.value for grade in Grade]
#: Statuses from bad to good; what is not among them is as good as `ok`.
_RANKS = {
    BuildingStatus.FAILED: 5,
    BuildingStatus.NO_SOLID: 4,
    BuildingStatus.DEGENERATE: 3,
    BuildingStatus.CUT_OFF: 2,
    BuildingStatus.TRACED_OUTLINE: 1,
}
#: A model whose points lie so far off on the root mean square is as bad as one that covers nothing [m].
_BAD_RMSE = 1.0


@dataclass(frozen=True, eq=False)
class Contents:
    """What a page shows."""

    result: Result
    buildings: list[ReportedBuilding]  #: those that can be clicked, by row
    others: list[ReportedBuilding]  #: those that are dots on the map
    models: ModelArrays
    points: ShownPoints
    #: Of what is shown and, where that is not all, of all.
    terrain: Relief | None
    overview: Relief | None
    worst: list[Worst]  #: to be looked at first
    focus: int | None = None  #: row of the building that the page opens with
    is_served: bool = False  #: whether other parts can be asked for


def contents_of(
    result: Result,
    focus: ReportedBuilding | None = None,
    middle: tuple[float, float] | None = None,
    is_served: bool = False,
) -> Contents:
    """
    Choose and read what a page shows; with a focus that building, with what is next to it.

    Of more buildings than a page holds it shows those nearest to `middle`, map frame [m], or to their own.
    """
    every = result.buildings
    worst = [] if focus else worst_buildings(every, result.unit)
    near, box = _beside(every, focus) if focus else _in_the_middle(every, middle)
    chosen = list({one.name: one for one in [*near, *(one.building for one in worst)]}.values())
    names = [one.name for one in chosen]
    path = result.folder / DTM if result.has(DTM) else None
    with ThreadPoolExecutor(1) as beside:  # decoding needs no interpreter
        reading = beside.submit(
            read_shown_points,
            result.clouds(),
            result.frame,
            {int(code): n for code, n in result.run.get("classes", {}).items()},
            {one.building_id: row for row, one in enumerate(chosen) if one.building_id},
            box,
            MOST_POINTS,
        )
        models = model_arrays(result.lines(set(names)), names, MOST_TRIANGLES)
        points = reading.result()
    return Contents(
        result=result,
        buildings=chosen,
        others=[] if focus or len(chosen) == len(every) else _without(every, set(names)),
        models=models,
        points=points,
        terrain=read_relief(path, result.frame, box, MOST_CELLS) if path else None,
        overview=read_relief(path, result.frame, None, MOST_CELLS) if path and box and not focus else None,
        worst=worst,
        focus=names.index(focus.name) if focus else None,
        is_served=is_served,
    )


def _in_the_middle(
    buildings: Sequence[ReportedBuilding], middle: tuple[float, float] | None
) -> tuple[Sequence[ReportedBuilding], Rectangle | None]:
    """Return the buildings, or the budget of them nearest to a place or their middle, and where these are."""
    if len(buildings) <= MOST_BUILDINGS:
        return buildings, None
    places = shapely.get_coordinates(shapely.centroid(_shapes(buildings)))
    if len(places) < len(buildings):  # some have no outline, so that nothing tells what is near
        return buildings[:MOST_BUILDINGS], None
    far = np.abs(places - (np.median(places, axis=0) if middle is None else middle)).max(axis=1)
    near = [buildings[row] for row in np.sort(np.argsort(far, kind="stable")[:MOST_BUILDINGS])]
    return near, _box_of(near)


def _beside(
    buildings: Sequence[ReportedBuilding], focus: ReportedBuilding
) -> tuple[Sequence[ReportedBuilding], Rectangle | None]:
    if focus.shape is None:
        return [focus], None
    box = _box_of([focus])
    is_near = shapely.intersects(_shapes(buildings), shapely.box(*box))
    return [one for one, near in zip(buildings, is_near, strict=True) if near or one is focus], box


def _without(buildings: Sequence[ReportedBuilding], names: set[str]) -> list[ReportedBuilding]:
    return [one for one in buildings if one.name not in names]


def _shapes(buildings: Sequence[ReportedBuilding]) -> NDArray[np.object_]:
    return np.array([one.shape for one in buildings], dtype=object)


def _box_of(buildings: Sequence[ReportedBuilding]) -> Rectangle:
    return Rectangle(*shapely.total_bounds(_shapes(buildings)).tolist()).grown(_MARGIN)


class Worst(NamedTuple):
    """One of the worst, and why."""

    building: ReportedBuilding
    why: str


def worst_buildings(buildings: Sequence[ReportedBuilding], unit: float) -> list[Worst]:
    """
    Return the ten worst, the worst first.

    A poor quality comes first, then a status that is not `ok`, then a missing level of detail, then what the
    points say: the share of the outline without support by points, and their distances to the model.
    """
    ordered = sorted(buildings, key=_badness, reverse=True)[:_MOST]
    return [Worst(one, why_bad(one, unit)) for one in ordered]


def why_bad(building: ReportedBuilding, unit: float) -> str:
    """Say in a few words what speaks against a building."""
    known = building.attributes
    words = [f"{building.quality}: {building.quality_reasons}"] if building.quality_reasons else []
    words.append(f"{building.status}: {known['reason']}" if known.get("reason") else building.status)
    if known.get("lod") not in (None, "2.2", "2.3"):
        words.append(f"finest level {known['lod'] or 'none'}")
    if known.get("coverage") is not None:
        words.append(f"coverage {known['coverage']:.2f}")
    if known.get("rmse") is not None:
        words.append(f"rmse {known['rmse'] * unit:.2f} m")
    if known.get("outline_max_offset"):
        words.append(f"outline off by {known['outline_max_offset'] * unit:.2f} m at most")
    return "; ".join(words)


def _badness(building: ReportedBuilding) -> tuple[float, ...]:
    known: dict[str, Any] = building.attributes
    coverage, rmse = known.get("coverage"), known.get("rmse")
    unsupported = 0.0 if coverage is None else 1.0 - coverage
    return (
        float(_GRADES.index(building.quality) if building.quality in _GRADES else 0),
        next((rank for status, rank in _RANKS.items() if status.value == building.status), 0),
        float(known.get("lod") not in (None, "2.2", "2.3")),
        unsupported + (rmse or 0.0) / _BAD_RMSE,
    )
