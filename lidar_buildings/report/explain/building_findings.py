"""How a building came about: walls and holes of its outline; planes, points and lines of its roof."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import CLASS_NAMES, PointClass
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.parameters import StageConfig, spec_of
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid, face_plane
from lidar_buildings.core.stages.building_model.quality import distance_to_surface
from lidar_buildings.core.surfaces.roof_planes import fitted_planes
from lidar_buildings.io.clouds.las import open_cloud
from lidar_buildings.io.clouds.point_columns import xyz_of
from lidar_buildings.io.results.building_layers import READABLE_ID
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.io.vectors.layers import read_layer
from lidar_buildings.pipeline.config import STAGE_CONFIGS
from lidar_buildings.report.contents import limits_of
from lidar_buildings.report.result_folder import ReportedBuilding
from lidar_buildings.report.summary_words import changed_parameters

_Config = TypeVar("_Config", bound=StageConfig)


class Finding(NamedTuple):
    """One line, and which parameters would change what it tells."""

    text: str
    parameters: tuple[str, ...] = ()  #: ``stage.name``


class Limits:
    """The values of a run's parameters, of which many are multiples of the building's point spacing [m]."""

    def __init__(self, run: dict[str, Any], spacing: float) -> None:
        self._told = run.get("parameters", {})
        self._spacing = spacing

    def value(self, parameter: str) -> Any:
        """Return what a parameter was set to; lengths in spacings as metres."""
        value, member = self._of(parameter)
        return value * self._spacing if spec_of(member).unit == "spacings" else value

    def config(self, kind: type[_Config]) -> _Config:
        """Return a stage's config as it was in the run."""
        told = {f"{kind.stage}.{one.name}" for one in fields(kind)}
        return kind(**{name.split(".")[1]: self._of(name)[0] for name in told})

    def lines(self, parameters: Iterable[str]) -> list[str]:
        """Return a line on each of some parameters, those first that differ from their defaults."""
        once = dict.fromkeys(parameters)
        found = [(parameter, *self._of(parameter)) for parameter in once]
        lines = []
        for parameter, value, member in sorted(found, key=lambda one: bool(one[1] == one[2].default)):
            unit = spec_of(member).unit
            here = f", {value * self._spacing:.2f} m here" if unit == "spacings" else ""
            changed = f", the default is {member.default}" if value != member.default else ""
            what = f"{parameter} = {value} {unit}".rstrip()
            lines.append(f"{what}{here}{changed}: {spec_of(member).description}")
        return lines

    def other_changes(self, parameters: Iterable[str]) -> list[str]:
        """Return a line on each stage's parameter that differs from its default and is not among these."""
        known = set(parameters)
        return [
            f"{name} = {value}, the default is {default}"
            for name, value, default in changed_parameters({"parameters": self._told})
            if name not in known and name.split(".")[0] in STAGE_CONFIGS
        ]

    def _of(self, parameter: str) -> tuple[Any, Field[Any]]:
        stage, name = parameter.split(".")
        member = next(one for one in fields(STAGE_CONFIGS[stage]) if one.name == name)
        return self._told.get(stage, {}).get(name, member.default), member


_COLUMNS = {
    "classification": "classification",
    "height": "HeightAboveGround",
    "facade": "Facade",
    "building_id": "BuildingId",
    "plane_id": "PlaneId",
    "return_number": "return_number",
    "number_of_returns": "number_of_returns",
}


@dataclass(frozen=True, eq=False)
class Site:
    """Points within a box, noise left out."""

    points: NDArray[np.float64]  #: map frame [m], shape (n, 3)
    #: As the clouds say; 0 where they do not. Heights above ground [m]. Shape (n,).
    classification: NDArray[np.float64]
    height: NDArray[np.float64]
    facade: NDArray[np.float64]
    building_id: NDArray[np.float64]
    plane_id: NDArray[np.float64]
    return_number: NDArray[np.float64]
    number_of_returns: NDArray[np.float64]

    def select(self, chosen: NDArray[np.bool_]) -> Site:
        """Return some of the points."""
        return Site(*(values[chosen] for values in self.__dict__.values()))

    def per_class(self) -> str:
        """Say how many points there are of each class."""
        codes, counts = np.unique(self.classification, return_counts=True)
        named = sorted(zip(counts.tolist(), codes.astype(int).tolist(), strict=True), reverse=True)
        return ", ".join(f"{n:,} {CLASS_NAMES.get(code, f'class {code}')}" for n, code in named) or "none"


def read_site(clouds: Iterable[Path], frame: MapFrame, box: Rectangle) -> Site:
    """Read the points of classified clouds within a box; InputError if one cannot be read."""
    parts = [np.empty((0, 3 + len(_COLUMNS)))]
    for path in clouds:
        cloud = open_cloud(path)
        if not box.touches(limits_of(cloud, frame)):
            continue
        known = set(cloud.header.point_format.dimension_names)
        for chunk in cloud.chunks():
            xyz = frame.to_map(xyz_of(chunk))
            inside = box.holds(xyz[:, 0], xyz[:, 1])
            inside &= ~np.isin(chunk["classification"], (PointClass.LOW_NOISE, PointClass.HIGH_NOISE))
            columns = [
                np.asarray(chunk[name], dtype=np.float64)[inside] if name in known else np.zeros(inside.sum())
                for name in _COLUMNS.values()
            ]
            parts.append(np.column_stack([xyz[inside], *columns]))
    table = np.concatenate(parts)
    height = table[:, 4] * frame.vertical_unit
    return Site(table[:, :3], table[:, 3], height, *table[:, 5:].T)


_NOISE = ("regularisation.noise", "regularisation.wall_cost", "regularisation.min_step")
#: Walls shorter than so many spacings are detail that chance may have made, and so many of them are jagged.
_SHORT, _JAGGED = 3.0, 0.35


def outline_findings(building: ReportedBuilding, spacing: float, limits: Limits) -> Iterator[Finding]:
    """Yield what there is to say of a building's outline."""
    outline, traced = building.outline, building.traced
    if outline is None or outline.is_empty:
        yield Finding("It has no outline: " + (building.attributes.get("reason") or "the run ended before"))
        return
    corners = shapely.get_coordinates(outline.exterior)[:-1]
    n_holes = len(outline.interiors)
    yield Finding(f"{len(corners)} walls, {outline.area:,.1f} m², {counted(n_holes, 'courtyard')}")
    if building.status == "traced_outline":
        yield Finding("The outline is the traced ring: it could not be regularised.", _NOISE)
    if traced is not None and not traced.is_empty:
        n_traced = len(traced.exterior.coords) - 1
        yield Finding(
            f"Traced with {n_traced} corners and {counted(len(traced.interiors), 'courtyard')}; "
            f"walls may leave out what scatters by {limits.value('regularisation.noise'):.2f} m."
        )
        if len(traced.interiors) != n_holes:
            yield Finding(
                f"Traced with {counted(len(traced.interiors), 'courtyard')}, of which {n_holes} kept.",
                ("boundary_tracing.min_courtyard_area",),
            )
    walls = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    n_short = int((walls < _SHORT * spacing).sum())
    if n_short > _JAGGED * len(walls):
        yield Finding(
            f"Jagged: {n_short} of {len(walls)} walls are shorter than {_SHORT * spacing:.1f} m "
            f"({_SHORT:g} spacings).",
            (*_NOISE, "regularisation.bridge_concavities", "boundary_tracing.window"),
        )


def shape_of(points: NDArray[np.float64], spacing: float) -> shapely.Geometry:
    """Return the area that points cover: discs of 1.5 spacings, drawn in again by one."""
    discs = shapely.buffer(shapely.points(points[:, :2]), 1.5 * spacing, quad_segs=2)
    return shapely.buffer(shapely.union_all(discs), -spacing)


#: A point agrees with the model if it is nearer than this [m], as for the attribute `coverage`.
AGREES = 0.3
_MOST_PLANES, _MOST_PATCHES = 12, 5
#: As usual a share of points in no plane.
_FEW = 0.05
#: Planes that scatter by more are several surfaces taken for one [m].
_BENT = 0.15
#: Patches of fewer points are chance.
_FEWEST = 4
_SMALL = ("plane_fitting.min_plane_area", "plane_fitting.min_plane_points")
_FACES = ("building_model.min_face_area", "plane_fitting.max_plane_distance")
_BENDING = ("plane_fitting.max_plane_distance", "plane_fitting.max_normal_angle_deg")
_LAYER = "roof_lines"
#: Shorter steps are dormers' and chimneys' [m].
_LONG_STEP = 5.0
_STEPS = ("segmentation.split_at_steps", "segmentation.min_step_height")


def roof_findings(
    roof: Site, solid: Solid | None, spacing: float, frame: MapFrame, limits: Limits
) -> Iterator[Finding]:
    """Yield what there is to say of a building's roof."""
    numbers = np.unique(roof.plane_id[roof.plane_id > 0])
    place = np.where(roof.plane_id > 0, np.searchsorted(numbers, roof.plane_id) + 1, 0).astype(np.uint16)
    planes = dict(zip(numbers.astype(int).tolist(), fitted_planes(roof.points, place), strict=True))
    yield Finding(f"{counted(len(planes), 'plane')} of {len(roof.points):,} roof points; the largest:")
    by_size = sorted(planes.items(), key=lambda item: item[1].n_points, reverse=True)
    for number, one in by_size[:_MOST_PLANES]:
        x, y, z = one.normal.tolist()
        slope, azimuth = math.degrees(math.acos(min(z, 1.0))), math.degrees(math.atan2(x, y)) % 360.0
        yield Finding(
            f"  plane {number}: {one.n_points:,} points, {one.n_points * spacing**2 / max(z, 0.1):.1f} m², "
            f"slope {slope:.0f}°, faces {round(azimuth) % 360}°, rms {one.rms:.3f} m"
        )
    bent = [f"{number}" for number, one in by_size if one.rms > _BENT]
    if bent:
        yield Finding(f"Plane {', '.join(bent)}: several surfaces fitted as one, or a curved one.", _BENDING)
    n_free = int((roof.plane_id == 0).sum())
    if n_free:
        limit = limits.value("plane_fitting.min_plane_area")
        share = n_free / len(roof.points)
        yield Finding(
            f"{n_free:,} points ({share:.0%}) are in no plane: surfaces below {limit:g} m², rougher than "
            f"{limits.value('plane_fitting.max_plane_distance'):g} m, or edges and chimneys.",
            (*_SMALL, "plane_fitting.max_plane_distance") if share > _FEW else (),
        )
    above = np.full(1, np.nan) if solid is None else heights_above(solid, roof.points)
    if not np.isnan(above).all():
        yield from _patches(roof, above, spacing, frame, limits)


def heights_above(solid: Solid, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return how far points lie above a solid's roof, at right angles to it; NaN beside it [m].

    Of points that are nearer to another face, as a wall, it is the distance to this one, with the same sign.
    """
    above = np.full(len(points), np.nan)
    places = shapely.points(points[:, :2])
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        rings = solid.face_rings(face)
        if kind == ROOF_SURFACE and (plane := face_plane(rings)) is not None:
            polygon = shapely.Polygon(rings[0][:, :2], [ring[:, :2] for ring in rings[1:]])
            shapely.prepare(polygon)
            rows = np.flatnonzero(shapely.intersects(polygon, places))
            rise = points[rows, 2] - points[rows, :2] @ plane[:2] - plane[2]
            above[rows] = rise / np.sqrt(1.0 + plane[0] ** 2 + plane[1] ** 2)
    far = np.flatnonzero(np.nan_to_num(np.abs(above)) > AGREES)
    off = distance_to_surface(points[far], solid, np.abs(above[far]))
    above[far] = np.copysign(off, above[far])
    return above


def _patches(
    roof: Site, above: NDArray[np.float64], spacing: float, frame: MapFrame, limits: Limits
) -> Iterator[Finding]:
    """Say where the model does not agree with the points: above it and below it."""
    known = ~np.isnan(above)
    rmse = float(np.sqrt((above[known] ** 2).mean()))
    share = float((np.abs(above[known]) > AGREES).mean())
    furthest = float(above[known][np.abs(above[known]).argmax()])
    yield Finding(
        f"Points over the finest model: rmse {rmse:.3f} m at right angles to its faces; {share:.1%} are off "
        f"by more than {AGREES} m, the furthest {furthest:+.2f} m."
    )
    patches = []
    for sign, side in ((1.0, "above"), (-1.0, "below")):
        rows = np.flatnonzero(sign * np.nan_to_num(above) > AGREES)
        for area, own in _grouped(roof.points[rows], spacing):
            patches.append((area, side, rows[own]))
    for area, side, own in sorted(patches, key=lambda one: len(one[2]), reverse=True)[:_MOST_PATCHES]:
        x, y, _ = frame.to_source(roof.points[own].mean(axis=0, keepdims=True))[0]
        far = float(np.median(np.abs(above[own])))
        text = f"  {len(own)} points on {area:.1f} m² lie {far:.2f} m {side} it at {x:.1f}, {y:.1f}"
        yield _patch_finding(text, area, roof.plane_id[own], limits)
    if patches:
        yield Finding(
            "  The model omits parts smaller than building_model.min_face_area, and those that explain less "
            "than their corners cost."
        )


def _patch_finding(text: str, area: float, planes: NDArray[np.float64], limits: Limits) -> Finding:
    """Say of which planes points off the model are, which cover so much [m²]."""
    named = ", ".join(f"{int(one)}" for one in np.unique(planes[planes > 0]))
    least = limits.value("plane_fitting.min_plane_area")
    if int((planes == 0).sum()) > len(planes) / 2:
        small = area < least
        why = f"smaller than plane_fitting.min_plane_area ({least:g} m²)" if small else "too rough for one"
        return Finding(f"{text}: most of them in no plane, {why}: a lost dormer, a chimney, a tree?", _SMALL)
    return Finding(f"{text}: of plane {named}, not as it lies there", _FACES)


def _grouped(points: NDArray[np.float64], spacing: float) -> Iterator[tuple[float, NDArray[np.intp]]]:
    if len(points) < _FEWEST:
        return
    parts = shapely.get_parts(shape_of(points, spacing))
    parts = parts[shapely.area(parts) > 0]
    if not len(parts):
        return
    row, part = shapely.STRtree(parts).query(
        shapely.points(points[:, :2]), predicate="dwithin", distance=spacing
    )
    for number, shape in enumerate(parts):
        own = row[part == number]
        if len(own) >= _FEWEST:
            yield float(shape.area), own


def line_findings(path: Path, name: str, unit: float) -> Iterator[Finding]:
    """Yield the kinds of roof lines of a building with their number and length."""
    if _LAYER not in {str(layer) for layer, _ in pyogrio.list_layers(path)}:
        return
    columns = read_layer(path, _LAYER).columns
    numbers: Counter[str] = Counter()
    lengths: Counter[str] = Counter()
    for owner, kind, length in zip(columns[READABLE_ID], columns["kind"], columns["length"], strict=True):
        if owner == name:
            numbers[kind] += 1
            lengths[kind] += float(length) * unit
    if not numbers:
        return
    told = (f"{n} {kind} ({lengths[kind]:.1f} m)" for kind, n in numbers.most_common())
    yield Finding(f"Lines: {', '.join(told)}")
    if lengths["step"] >= _LONG_STEP:
        yield Finding(
            f"Steps of {lengths['step']:.1f} m divide the roof: possibly touching buildings, or planes that "
            "should meet.",
            _STEPS,
        )
