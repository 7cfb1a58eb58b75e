"""Messages of every topic with finite numbers that nobody measures: through the nodes' entrances, and on."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import MAX_DISTANCE, MAX_ELEVATION, are_held
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.parameters import spec_of
from lidar_buildings.core.model.tile import COLUMNS, PointTile
from lidar_buildings.core.scans.cloud_layout import members_of_fields
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.placing import ScanPlacer
from lidar_buildings.pipeline.config import PipelineConfig

#: Numbers at which loops break: limits of types and of what is held, and one that was reported.
_EDGES = np.array(
    [
        1.88e30,
        3.4e38,
        1e300,
        1e-300,
        1e-45,
        2.0**31,
        2.0**53,
        2.0**63,
        1e9,
        MAX_DISTANCE,
        MAX_ELEVATION,
        1e5,
        0.0,
    ]
)
#: Columns of a tile by what nodes send them on.
FIELDS_OF_TOPIC = {
    "points": (),
    "ground_points": ("classification", "height_above_ground"),
    "roof_points": ("classification", "height_above_ground", "facade"),
    "edge_points": ("facade", "linearity", "planarity", "normal_z", "neighbourhood_radius", "edge"),
    "building_points": ("facade", "linearity", "edge", "building_id"),
    "plane_points": ("facade", "edge", "building_id", "plane_id"),
}
_OF_SOURCE = ("intensity", "return_number", "number_of_returns", "gps_time", "scan_angle", "point_source_id")
_MOST_POINTS = 90
#: Clouds that a case takes in, with other extreme numbers in the same points.
A_CASE = 20


class HeldError(Exception):
    """What cannot be held came through an entrance."""


def numbers(random: np.random.Generator, n: int) -> NDArray[np.float64]:
    """Return finite numbers of any size."""
    found = np.where(
        random.random(n) < 0.5, random.choice(_EDGES, n), 10.0 ** random.uniform(-300.0, 300.0, n)
    )
    return found * random.choice([-1.0, 1.0], n)


def cloud(random: np.random.Generator, topic: str) -> Any:
    """Return a cloud of a topic: a house on the ground, of which some numbers are extreme."""
    return _message(_poked(_rows(random, topic), random), random)


def _rows(random: np.random.Generator, topic: str) -> NDArray[Any]:
    n = int(random.integers(1, _MOST_POINTS))
    names = [*(one for one in _OF_SOURCE if random.integers(3)), *FIELDS_OF_TOPIC[topic]]
    kind = "<f8" if random.integers(4) == 0 else "<f4"
    rows = np.zeros(n, [*((axis, kind) for axis in "xyz"), *((name, COLUMNS[name]) for name in names)])
    side = 0.7 * np.sqrt(n)
    is_roof = random.random(n) < 0.5
    rows["x"], rows["y"] = random.uniform(0.0, side, (2, n))
    rows["z"] = np.where(is_roof, 6.0, random.normal(0.0, 0.02, n))
    values = {
        "height_above_ground": rows["z"],
        "classification": np.where(is_roof, 6, 2),
        "building_id": np.where(is_roof, 77, random.choice([0, 77, 2**32 - 1])),
        **dict.fromkeys(("linearity", "planarity", "normal_z", "neighbourhood_radius", "plane_id"), 1.0),
        **dict.fromkeys(("return_number", "number_of_returns"), 1),
        "gps_time": np.arange(n) * 1e-5,
        "intensity": random.integers(0, 2000, n),
    }
    for name in names:
        rows[name] = values.get(name, 0)
    return rows


def _poked(rows: NDArray[Any], random: np.random.Generator) -> NDArray[Any]:
    """Return a table of points of which some numbers are extreme."""
    rows, n = rows.copy(), len(rows)
    for _ in range(random.integers(0, 4)):
        name = rows.dtype.names[random.integers(3 if random.integers(2) else len(rows.dtype.names))]
        own = random.integers(0, n, random.integers(1, 4)) if random.integers(8) else np.arange(n)
        wanted = numbers(random, len(own))
        dtype = rows.dtype[name]
        limits = np.finfo(dtype) if dtype.kind == "f" else np.iinfo(dtype)
        rows[name][own] = np.clip(wanted, float(limits.min), float(limits.max) * (1 - 2**-24)).astype(dtype)
    return rows


#: Numbers within all limits at which cells, angles and areas break.
_HELD = np.array([0.0, 1e-45, 1e-30, 1e-6, 1e-3, 0.5, 1.0, 1.0 + 2**-23, 100.0, 4095.9, 4096.0])
_SHAPES = 8


def odd_rows(random: np.random.Generator, topic: str) -> NDArray[Any]:
    """Return a table of points that can be held and lie as no survey's: alike, in lines, steep, far apart."""
    rows = _rows(random, topic)
    n, side, shape = (
        len(rows),
        float(random.choice([1e-6, 0.1, 5.0, 300.0, 8000.0], p=[0.1, 0.1, 0.6, 0.18, 0.02])),
        random.integers(_SHAPES),
    )
    if shape == 0:  # one place
        rows["x"], rows["y"] = random.choice(_HELD, 2)
    elif shape == 1:  # a line
        rows["x"] = np.linspace(0.0, side, n)
        rows["y"] = rows["x"] * random.choice([0.0, 1.0, 1e-7])
    elif shape == 2:  # a grid, some points twice
        k = max(int(np.sqrt(n)), 1)
        column, row = np.divmod(random.integers(0, k * k, n), k)
        rows["x"], rows["y"] = column * side / k, row * side / k
    elif shape == 3:  # a slope, up to nearly upright
        rows["x"], rows["y"] = random.uniform(0.0, side, (2, n))
        rows["z"] = rows["x"] * random.choice([0.1, 5.0, 1e3]) + random.normal(0.0, 1e-3, n)
    elif shape == 4:  # two heaps, far apart
        rows["x"] = random.uniform(0.0, 3.0, n) + np.where(random.random(n) < 0.5, side, 0.0)
    elif shape == 5:  # few numbers
        for axis in "xyz":
            rows[axis] = random.choice(_HELD, n) * random.choice([-1.0, 1.0], n)
    elif shape == 6:  # heights to the limits
        rows["z"] = random.choice([-MAX_ELEVATION, MAX_ELEVATION, 0.0, 1.0], n)
    if random.integers(3) == 0:  # columns to the limits of their types
        for name in rows.dtype.names[3:]:
            if random.integers(3) == 0:
                dtype = rows.dtype[name]
                ends = (
                    [0, 1, np.iinfo(dtype).max, np.iinfo(dtype).min]
                    if dtype.kind in "iu"
                    else [0, 1, -1, 1e4]
                )
                rows[name] = random.choice(ends, n)
    return rows


def _message(rows: NDArray[Any], random: np.random.Generator) -> Any:
    n = len(rows)
    stamp = SimpleNamespace(sec=int(random.integers(0, 2**31 - 1)), nanosec=0)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id="map"),
        height=1,
        width=n,
        fields=[SimpleNamespace(**one) for one in members_of_fields(rows.dtype)],
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.dtype.itemsize * n,
        data=rows.view(np.uint8).data,
        is_dense=True,
    )


def extreme_cloud(random: np.random.Generator) -> str:
    """Take clouds of any topic in, `A_CASE` of them; what comes through can be held."""
    from lidar_buildings.ros.point_cloud import from_message

    n_refused = 0
    rows = _rows(random, list(FIELDS_OF_TOPIC)[random.integers(len(FIELDS_OF_TOPIC))])
    for _ in range(A_CASE):
        try:
            tile = from_message(_message(_poked(rows, random), random)).tile
        except LidarBuildingsError:
            n_refused += 1
            continue
        if not are_held(tile.points).all():
            raise HeldError("a point of a tile cannot be held")
    return f"of {A_CASE} clouds {n_refused} refused"


def _tile(random: np.random.Generator, topic: str) -> PointTile:
    from lidar_buildings.ros.point_cloud import from_message

    message = _message(odd_rows(random, topic), random) if random.integers(4) else cloud(random, topic)
    tile = from_message(message).tile
    if not are_held(tile.points).all():
        raise HeldError("a point of a tile cannot be held")
    if random.integers(3) == 0:
        tile = _with_info(tile, random)
    return tile


def _with_info(tile: PointTile, random: np.random.Generator) -> PointTile:
    """Complete a tile by what `tile_info` says of it, as `TileInfos` does."""
    from std_msgs.msg import String

    from lidar_buildings.ros.tile_info import completed, infos_of

    low, high, spacing, dark = numbers(random, 4).tolist()
    said = {"stamp": tile.stamp, "bounds": [low, -20.0, high, None], "dark_limit": abs(dark)}
    said["point_spacing"] = float(random.choice([0.5, 1.5, abs(spacing)]))
    if random.integers(2):
        said["bounds"] = [-10.0, -10.0, 30.0, 30.0]
    _, infos = infos_of(String(data=json.dumps({"life": "a", "tiles": [said]})))
    return completed(tile, infos[tile.stamp])


def extreme_tile(random: np.random.Generator) -> str:
    """Take a cloud of a topic in, and do what its node does with the tile."""
    topic = list(FIELDS_OF_TOPIC)[random.integers(len(FIELDS_OF_TOPIC))]
    return _WORK[topic](_tile(random, topic), _configs()[random.integers(len(_configs()))])


@cache
def _configs() -> list[PipelineConfig]:
    """Return parameters of all ways: each method, each switch the other way round."""
    plain = PipelineConfig()
    found = [plain] * 8
    for stage in fields(plain):
        config = getattr(plain, stage.name)
        for one in fields(config):
            value = getattr(config, one.name)
            words = spec_of(one).choices if isinstance(value, str) else ()
            for other in [not value] if isinstance(value, bool) else words:
                if other != value:
                    found.append(replace(plain, **{stage.name: replace(config, **{one.name: other})}))
    return found


def _filter(tile: PointTile, config: PipelineConfig) -> str:
    from lidar_buildings.pipeline.tile_stages import filter_ground

    filter_ground(tile, config.ground_filter)
    return "ground_filter"


def _select(tile: PointTile, config: PipelineConfig) -> str:
    from lidar_buildings.core.stages.terrain.config import RasterConfig
    from lidar_buildings.pipeline.tile_stages import rasterise_tile, roof_points, select_roof_points

    roof_points(select_roof_points(tile, config.roof_selection))
    rasterise_tile(tile, RasterConfig(), MapFrame())
    return "roof_selector"


def _label(tile: PointTile, config: PipelineConfig) -> str:
    from lidar_buildings.pipeline.tile_stages import label_roof_edges

    label_roof_edges(tile, config.edge_labelling)
    return "edge_labeller"


def _trace(tile: PointTile, config: PipelineConfig) -> str:
    from lidar_buildings.pipeline.tile_outlines import regularise_outlines
    from lidar_buildings.pipeline.tile_tracing import trace_or_close

    traced = trace_or_close(tile, config.segmentation, config.boundary_tracing)
    regularise_outlines(traced.outlines, config.regularisation)
    return "building_tracer"


def _fit(tile: PointTile, config: PipelineConfig) -> str:
    from lidar_buildings.pipeline.tile_stages import fit_planes

    fit_planes(tile, config.plane_fitting)
    return "plane_fitter"


def _build(tile: PointTile, config: PipelineConfig) -> str:
    from lidar_buildings.core.model.outline import BuildingOutline, Outline
    from lidar_buildings.pipeline.tile_models import build_models

    ring = np.array([(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0)])
    outline = BuildingOutline(77, Outline(ring), 0.0)
    build_models(tile, (outline,), config.building_model)
    return "model_builder"


_WORK: dict[str, Callable[[PointTile, PipelineConfig], str]] = {
    "points": _filter,
    "ground_points": _select,
    "roof_points": _label,
    "edge_points": _trace,
    "building_points": _fit,
    "plane_points": _build,
}


def extreme_rings(random: np.random.Generator) -> str:
    """Take rings in, and regularise what they close."""
    from lidar_buildings.pipeline.tile_outlines import regularise_outlines
    from lidar_buildings.ros.polygons import CLOSING_ID, RingCollector, outlines_of

    collector, closed = RingCollector(), None
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0))
    for number in (5, 5, 6, CLOSING_ID):
        n = 0 if number == CLOSING_ID else int(random.integers(0, 9))
        angle = np.sort(random.uniform(0, 2 * np.pi, n))
        ring = np.column_stack([9 * np.cos(angle), 9 * np.sin(angle), np.zeros(n)]).astype(np.float32)
        if n and random.integers(3) == 0:
            with np.errstate(over="ignore"):
                wild = float(numbers(random, 1).astype(np.float32)[0])
            ring[random.integers(n), random.integers(3)] = wild if np.isfinite(wild) else 3e38
        if random.integers(20) == 0:
            number = int(random.choice([2**63 - 1, -(2**63), 2**32, -2]))
        points = [SimpleNamespace(**dict(zip("xyz", row, strict=True))) for row in ring.tolist()]
        polygon = SimpleNamespace(id=number, polygon=SimpleNamespace(points=points))
        closed = collector.add(SimpleNamespace(header=header, polygon=polygon))
    outlines = outlines_of(closed or {})
    if random.integers(50) == 0:
        regularise_outlines(outlines, PipelineConfig().regularisation)
        return "outline_regulariser"
    return "accepted"


def random_text(random: np.random.Generator) -> tuple[int, str]:
    """Return what topics of text carry, with extreme numbers: its place in `TEXTS`, and the text."""
    one, two, three, *corners = numbers(random, 12).tolist()
    kind = int(random.integers(len(TEXTS)))
    if kind == 0:
        quality = {"sigma": one, "max_offset": two, "bias": one, "status": "ok", "reason": ""}
        said: Any = {"stamp": three if random.integers(2) else 1, "outlines": {"7": quality}}
    elif kind == 1:
        said = {"life": "a", "tiles": [{"stamp": one}, {"stamp": 5}]}
    elif kind == 2:
        said = {"node": "a", "life": "b", "sequence": one, "tiles": {str(int(two)): ["a", [], ""]}}
    else:
        attributes = {"building_id": int(one) if random.integers(2) else 5, "status": "ok", "height": two}
        shell = [[[[0, 1, 2]], [[0, 1, 2]]]]
        semantics = {"surfaces": [{"type": "RoofSurface"}], "values": [[0, 0]]}
        solid = {"type": "Solid", "lod": "1.2", "boundaries": shell, "semantics": semantics}
        places = np.array(corners).reshape(3, 3)
        vertices = (places if random.integers(2) else np.clip(places, -1e6, 1e6).round()).tolist()
        thing = {"type": "Building", "attributes": attributes, "geometry": [solid]}
        said = {"type": "CityJSONFeature", "id": "a", "CityObjects": {"a": thing}, "vertices": vertices}
    return kind, json.dumps(said, separators=(",", ":"))


#: Topics of text.
TEXTS = ("outline_quality", "tile_info", "node_state", "city_model")


def extreme_text(random: np.random.Generator) -> str:
    """Take JSON with extreme numbers in: qualities, infos, states, features."""
    from std_msgs.msg import String

    from lidar_buildings.io.models.cityjson import checked_feature
    from lidar_buildings.ros.node_state import state_of
    from lidar_buildings.ros.text_messages import qualities_of
    from lidar_buildings.ros.tile_info import infos_of

    kind, text = random_text(random)
    if kind == 3:
        checked_feature(text)
    else:
        (qualities_of, infos_of, state_of)[kind](String(data=text))
    return TEXTS[kind]


@cache
def _placers() -> list[ScanPlacer]:
    return [ScanPlacer(ScanConfig()), ScanPlacer(ScanConfig(georeferenced=True))]


def extreme_pose(random: np.random.Generator) -> str:
    """Give a placer a pose or a scan with extreme numbers, and a survey what it places."""
    placer = _placers()[random.integers(2)]
    now = placer.n_scans + 1 + int(random.integers(0, 2))
    stamp = SimpleNamespace(sec=now // 10, nanosec=now % 10 * 10**8)
    if random.integers(2):
        place = random.uniform(-50.0, 50.0, 3)
        if random.integers(2):
            place[random.integers(3)] = numbers(random, 1)[0]
        turn = random.normal(size=4)
        turn /= np.linalg.norm(turn)
        if random.integers(8) == 0:
            turn[random.integers(4)] = numbers(random, 1)[0]
        position, rotation = (
            SimpleNamespace(**dict(zip("xyzw", one.tolist(), strict=False))) for one in (place, turn)
        )
        header = SimpleNamespace(stamp=stamp, frame_id="odom")
        pose = SimpleNamespace(pose=SimpleNamespace(position=position, orientation=rotation))
        placer.add_odometry(SimpleNamespace(header=header, child_frame_id="map", pose=pose))
        return "pose"
    scan = cloud(random, "points")
    scan.header.stamp = stamp
    try:
        placer.add_scan(scan)
    finally:
        for one in placer.placed():
            if len(one.points) and not np.isfinite(one.points).all():
                raise HeldError("a placed point is not finite")
    return "scan"


def extreme_frame(random: np.random.Generator) -> str:
    """Check origins, units and parameters."""
    from lidar_buildings.commands.settings import read_settings
    from lidar_buildings.io.files.reference_systems import check_place

    x, y, z, horizontal, vertical = numbers(random, 5).tolist()
    if random.integers(2):
        check_place(MapFrame("", (x, y, z), horizontal, vertical))
        return "map_origin"
    names = _parameter_names()
    read_settings(None, [f"{names[random.integers(len(names))]}={abs(x)!r}"])
    return "parameter"


@cache
def _parameter_names() -> list[str]:
    from dataclasses import fields

    from lidar_buildings.pipeline.config import STAGE_CONFIGS

    return [
        f"{stage}.{one.name}"
        for stage, config in STAGE_CONFIGS.items()
        for one in fields(config)
        if type(one.default) in (int, float)
    ]


def refused(target: Callable[[np.random.Generator], str]) -> Callable[[np.random.Generator], str]:
    """Return a target for which a stage's refusal of a tile, in one line, is an outcome."""

    def call(random: np.random.Generator) -> str:
        try:
            return target(random)
        except LidarBuildingsError:
            raise
        except ValueError as error:
            return f"refused: {str(error)[:40]}"

    return call


#: Name → target, and what share of the cases it gets.
EXTREMES = {
    "clouds, extreme": (extreme_cloud, 0.5),
    "tiles and stages, extreme": (refused(extreme_tile), 0.1),
    "rings, extreme": (extreme_rings, 0.1),
    "texts, extreme": (extreme_text, 0.1),
    "poses and scans, extreme": (extreme_pose, 0.25),
    "frames and parameters, extreme": (extreme_frame, 0.05),
}
