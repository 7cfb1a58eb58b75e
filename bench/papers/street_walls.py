"""
Edge labels on walls that were seen from the street (Santos, outlook: terrestrial scans), against their truth.

The façade stage finds the walls of a simulated drive; the points near each are laid flat (along the wall, up,
out of it) and labelled as a roof's are. True edges are the wall's ends and the rims of its windows and doors.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.papers.close_neighbours import labellings
from bench.papers.pages import markdown, spread
from bench.street.walls import Ride, ride_of
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.stages.edge_labelling.labelling import label_edges
from lidar_buildings.core.stages.facades.facade import STRAIGHT, Facade
from lidar_buildings.core.stages.facades.finding import find_facades
from lidar_buildings.evaluation.scores.cells import ratio
from lidar_buildings.simulation.facades import Part, parts_of
from lidar_buildings.simulation.live import VehicleConfig

#: Scene and seeds of the drives, the scanner's beams, its highest one [deg], rays a second.
SCENE, SEEDS, BEAMS, HIGHEST, RAYS = "village", (0,), 16, 20.0, 60_000.0
#: Points so near to a façade lie on it, and so near in plan is its true wall [m].
ON_WALL, NEAR_WALL = 0.08, 0.3
#: Walls are thinned to a point for each square of this [m]: points of one row lie close, rows do not.
CELL = 0.08
#: Points nearer to a true edge should be edges, and edges should lie no farther than that [spacings].
SHOULD, MAY = 0.75, 1.5
#: Fewer points tell nothing.
FEWEST = 300


class FlatWall(NamedTuple):
    """A wall laid flat."""

    points: NDArray[np.float64]  #: along, up, out [m], shape (n_points, 3)
    ends: shapely.Geometry  #: sides of the wall and of what was seen of it
    openings: shapely.Geometry  #: rims of windows and doors


def flat_walls(ride: Ride) -> list[FlatWall]:
    """Find façades, and lay each flat with the truth about it."""
    points, truth = ride.points.points, ride.points
    height = points[:, 2] - ride.scene.terrain.at(points[:, :2])
    found = find_facades(points, height, truth.true_class == PointClass.GROUND)
    parts = [parts_of(building).parts for building in ride.scene.buildings]
    flat = [_flat(one, points, parts) for one in found if one.kind == STRAIGHT]
    return [one for one in flat if one is not None]


def _flat(facade: Facade, points: NDArray[np.float64], parts: list[list[Part]]) -> FlatWall | None:
    """Lay a façade flat; None if there are few points or it is no true wall."""
    start, along = facade.foot[0], facade.foot[-1] - facade.foot[0]
    length = float(np.hypot(*along))
    along = along / length
    frame = np.array([[along[0], -along[1]], [along[1], along[0]]])
    uv = (points[:, :2] - start) @ frame
    near = (np.abs(uv[:, 1]) <= ON_WALL) & (uv[:, 0] >= -0.5) & (uv[:, 0] <= length + 0.5)
    near &= (points[:, 2] >= facade.bottom - 0.2) & (points[:, 2] <= facade.top + 0.2)
    own = np.column_stack((uv[near, 0], points[near, 2], uv[near, 1]))
    _, first = np.unique(np.floor(own[:, :2] / CELL), axis=0, return_index=True)
    own = own[np.sort(first)]
    walls = [(part, one) for one in parts for part in one if part.layer == "walls"]
    placed = [(_span(part, start, frame), part, one) for part, one in walls]
    mine = [
        (span, part, one)
        for span, part, one in placed
        if np.abs(span[:, 1]).max() <= NEAR_WALL
        and min(span[:, 0].max(), length) - max(span[:, 0].min(), 0.0) > 1.0
    ]
    if len(own) < FEWEST or not mine:
        return None
    ends, rims = [], []
    for span, part, one in mine:
        ends += [shapely.LineString([(s, part.low), (s, part.high)]) for s in span[:, 0]]
        ends.append(shapely.LineString([(span[0, 0], part.high), (span[1, 0], part.high)]))
        row = one.index(part)
        for opening in (other for other in one if other.layer == "openings" and other.wall == row):
            along_it = np.sort(_span(opening, start, frame)[:, 0])
            rims.append(shapely.box(along_it[0], opening.low, along_it[1], opening.high).exterior)
    return FlatWall(own, shapely.union_all(ends), shapely.union_all(rims))


def _span(part: Part, start: NDArray[np.float64], frame: NDArray[np.float64]) -> NDArray[np.float64]:
    return (np.array([part.start, part.end]) - start) @ frame


def scores_of(wall: FlatWall, config: Any) -> tuple[float, float, float]:
    """Return the shares of points at ends and at openings that are edges, and of edges that are at either."""
    spacing = measure_spacing(wall.points)
    edge = label_edges(wall.points, config, point_spacing=spacing).edge == 1
    places = shapely.points(wall.points[:, :2])
    to_ends, to_rims = (shapely.distance(places, one) for one in (wall.ends, wall.openings))
    to_rims = np.where(np.isnan(to_rims), np.inf, to_rims)
    shares = [
        ratio(int((edge & (far <= SHOULD * spacing)).sum()), int((far <= SHOULD * spacing).sum()))
        for far in (to_ends, to_rims)
    ]
    may = np.minimum(to_ends, to_rims) <= MAY * spacing
    return shares[0], shares[1], ratio(int((edge & may).sum()), int(edge.sum()))


def street_walls(names: Mapping[str, str], folder: Path | None) -> str:
    """Return the table: a line per way to label edges."""
    rides = [
        ride_of(SCENE, seed, VehicleConfig(beams=BEAMS, highest_deg=HIGHEST, pulse_rate=RAYS), details=True)
        for seed in SEEDS
    ]
    walls = [wall for ride in rides for wall in flat_walls(ride)]
    rows = []
    for name, (method, config) in labellings().items():
        found = np.array([scores_of(wall, config) for wall in walls])
        cells = [spread(100 * column, 0) for column in found.T]
        rows.append([f"{names[method]}, {name.partition(', ')[2]}", *cells])
    if folder is not None:
        _draw(folder / "santos_street_walls.png", walls)
    headings = (
        "edges",
        "wall ends and tops found [%]",
        "rims of openings found [%]",
        "of the edges are either [%]",
    )
    return markdown(headings, rows) + (
        f"\n\nMean / median / root mean square of {len(walls)} walls, {SCENE}, "
        f"seed {' and '.join(map(str, SEEDS))}, {BEAMS} beams up to {HIGHEST:+g}°."
    )


def _draw(path: Path, walls: list[FlatWall]) -> None:
    """Draw the edges of the largest walls, as published and by default."""
    from bench.common.plotting import plt

    ways = ("k_means_linearity_planarity, published", "k_means_linearity_planarity, default")
    largest = sorted(walls, key=lambda wall: -len(wall.points))[:3]
    figure, axes = plt.subplots(len(largest), 2, figsize=(22, 7 * len(largest)), squeeze=False)
    for row, wall in zip(axes, largest, strict=True):
        for panel, way in zip(row, ways, strict=True):
            edge = label_edges(wall.points, labellings()[way][1]).edge == 1
            panel.scatter(*wall.points[:, :2].T, s=2, c=np.where(edge, "tab:blue", "lightgrey"))
            for geometry in (wall.ends, wall.openings):
                for line in shapely.get_parts(geometry):
                    panel.plot(*shapely.get_coordinates(line).T, color="tab:red", linewidth=0.7)
            panel.set(aspect="equal", title=way)
    figure.savefig(path, dpi=60, bbox_inches="tight")
    plt.close(figure)
