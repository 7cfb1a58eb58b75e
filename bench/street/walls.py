"""
Walls seen from a vehicle: lines found in virtual scenes against true walls.

    python -m bench.street.walls [--scenes SCENE ...] [--seeds N ...] [--tops DEG ...] [--poses exact noisy]
                             [--methods planes facades] [--beams N] [--tolerance M] [--details]
    python -m bench.street.walls --result FILE --truth FILE [--layer street_lines] [--tolerance M]

Of true walls the pieces count for completeness on which at least 5 points per 0.25 m lie; any true wall
counts for correctness. Noisy poses: 2 cm and 0.1°.

planes    the peer: sequential RANSAC of vertical planes on the true points of buildings that are no roof
facades   the stage `core/stages/facades` on all points, ground and heights as they truly are

The second form scores a layer of lines or 3D polygons of a run against `truth.gpkg` of its survey; lines are
called seen where a column `seen`, if there is one, says so.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
import shapely.ops

from bench.common.tables import table
from bench.street.lines import WallScore, wall_score
from bench.street.planes import vertical_planes
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.io.vectors.layers import read_layer
from lidar_buildings.simulation import make_scene
from lidar_buildings.simulation.live import Scan, VehicleConfig, drive
from lidar_buildings.simulation.live.vehicle import PULSE_RATE_OF_BEAM
from lidar_buildings.simulation.scanner import StripPoints, joined
from lidar_buildings.simulation.scene import VirtualScene
from lidar_buildings.simulation.truth_layers import SeenParts, seen_wall_pieces

HEADINGS = (
    *("survey", "method", "seen [m]", "called seen [m]", "assumed [m]"),
    *("completeness", "correctness", "honest", "RMSE [cm]", "s"),
)
#: What a wall's column of the result may say for seen.
TRUE_WORDS = {"1", "true", "seen", "yes"}


class Lines(NamedTuple):
    """Wall lines that a method found [m]."""

    seen: list[shapely.Geometry]
    assumed: list[shapely.Geometry]


class Ride(NamedTuple):
    """A drive through a scene, and its true walls [m]."""

    name: str
    scene: VirtualScene
    points: StripPoints
    seen: list[shapely.Geometry]
    walls: list[shapely.Geometry]


def ride_of(name: str, seed: int, config: VehicleConfig, *, details: bool = False) -> Ride:
    """Drive through a scene, and count what is seen of its walls."""
    scene = make_scene(name, seed, details=details)
    scans = [event.truth for event in drive(scene, seed, config).events() if isinstance(event, Scan)]
    counts = SeenParts(scene)
    for scan in scans:
        counts.add(scan)
    pieces = seen_wall_pieces(counts)
    poses = "noisy" if config.position_noise else "exact"
    label = f"{name} {seed}, {config.beams} to {config.highest_deg:+g}°, {poses}"
    walls = [line for line, _ in pieces]
    return Ride(label, scene, joined(scans), [line for line, row in pieces if row["seen"]], walls)


def planes(ride: Ride) -> Lines:
    """Fit planes to the true points of buildings."""
    points = ride.points
    is_wall = (points.true_class == PointClass.BUILDING) & (points.true_plane == 0)
    return Lines(list(vertical_planes(points.points[is_wall])), [])


def facades(ride: Ride) -> Lines:
    """Find façades in all points, with the true ground."""
    from lidar_buildings.core.stages.facades.finding import find_facades

    points, truth = ride.points.points, ride.points
    height = points[:, 2] - ride.scene.terrain.at(points[:, :2])
    return facade_lines(find_facades(points, height, truth.true_class == PointClass.GROUND))


def facade_lines(found: Iterable[Any]) -> Lines:
    """Cut façades of the stage where they begin or cease to be seen."""
    lines = Lines([], [])
    for facade in found:
        line, steps = shapely.LineString(facade.foot), len(facade.is_seen)
        cuts = np.flatnonzero(np.diff(facade.is_seen)) + 1
        for begin, end in zip([0, *cuts], [*cuts, steps], strict=True):
            piece = shapely.ops.substring(line, begin / steps, end / steps, normalized=True)
            (lines.seen if facade.is_seen[begin] else lines.assumed).append(piece)
    return lines


METHODS: dict[str, Callable[[Ride], Lines]] = {"planes": planes}
if find_spec("lidar_buildings.core.stages.facades"):
    METHODS["facades"] = facades


def cells(name: str, method: str, score: WallScore, seconds: float) -> list[str]:
    """Return the figures in the order of `HEADINGS`."""
    lengths = (score.true_length, score.found_length, score.assumed_length)
    shares = (score.completeness, score.correctness, score.honesty)
    return [
        *(name, method, *(f"{one:.0f}" for one in lengths), *(f"{one:.3f}" for one in shares)),
        *(f"{100 * score.rmse:.1f}", f"{seconds:.1f}"),
    ]


def read_lines(path: Path, layer: str) -> Lines:
    """Read the lines of a layer, and of 3D polygons their feet, by whether they are called seen."""
    read = read_layer(path, layer)
    called = read.columns.get("seen")
    lines = Lines([], [])
    for row, geometry in enumerate(read.geometries):
        is_seen = called is None or str(called[row]).lower() in TRUE_WORDS
        (lines.seen if is_seen else lines.assumed).append(_in_plan(geometry))
    return lines


def _in_plan(geometry: shapely.Geometry) -> shapely.Geometry:
    """A line, or the foot of an upright polygon, whose ring leads along it and back."""
    if "Polygon" not in geometry.geom_type:
        return shapely.force_2d(geometry)
    feet = []
    for part in shapely.get_parts(geometry):
        xyz = shapely.get_coordinates(part.exterior, include_z=True)[:-1]
        levels = xyz[:, 2] <= (xyz[:, 2].min() + xyz[:, 2].max()) / 2
        first = int(np.argmax(levels & ~np.roll(levels, 1)))
        turned = np.roll(xyz, -first, axis=0)[: int(levels.sum()), :2]
        if len(turned) > 1:
            feet.append(shapely.LineString(turned))
    return shapely.MultiLineString(feet)


def score_files(result: Path, truth: Path, layer: str, tolerance: float) -> WallScore:
    """Score a layer of a run against the truth of its survey."""
    lines, walls = read_lines(result, layer), read_layer(truth, "walls")
    seen = walls.geometries[walls.columns["seen"] == 1]
    return wall_score(lines.seen, lines.assumed, list(seen), list(walls.geometries), tolerance)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line per survey and method."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", default=["village", "street_canyon"], metavar="SCENE")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 11, 12, 13], metavar="N")
    parser.add_argument("--tops", nargs="+", type=float, default=[2.0, 20.0], metavar="DEG")
    parser.add_argument("--poses", nargs="+", choices=("exact", "noisy"), default=["exact", "noisy"])
    parser.add_argument("--methods", nargs="+", choices=tuple(METHODS), default=tuple(METHODS))
    parser.add_argument("--beams", type=int, default=32)
    parser.add_argument("--profile", action="store_true", help="a tilted profile scanner")
    parser.add_argument("--details", action="store_true", help="eaves, windows and doors in every scene")
    parser.add_argument("--tolerance", type=float, default=0.1, metavar="M")
    parser.add_argument("--result", type=Path, metavar="FILE", help="GeoPackage of a run")
    parser.add_argument("--truth", type=Path, metavar="FILE", help="truth.gpkg of its survey")
    parser.add_argument("--layer", default="street_lines")
    options = parser.parse_args(arguments)
    if options.result:
        score = score_files(options.result, options.truth, options.layer, options.tolerance)
        print(table(HEADINGS, [cells(options.result.parent.name, options.layer, score, 0.0)]))
        return 0
    rows = [one for scene in options.scenes for seed in options.seeds for one in _rows(options, scene, seed)]
    print(table(HEADINGS, rows))
    return 0


def _rows(options: argparse.Namespace, scene: str, seed: int) -> list[list[str]]:
    exact = VehicleConfig(
        beams=options.beams, pulse_rate=options.beams * PULSE_RATE_OF_BEAM, is_profiler=options.profile
    )
    rows = []
    for top in options.tops:
        for poses in options.poses:
            noise = {"position_noise": 0.02, "angle_noise_deg": 0.1} if poses == "noisy" else {}
            config = replace(exact, highest_deg=top, **noise)
            ride = ride_of(scene, seed, config, details=options.details)
            for method in options.methods:
                begin = time.perf_counter()
                lines = METHODS[method](ride)
                seconds = time.perf_counter() - begin
                score = wall_score(lines.seen, lines.assumed, ride.seen, ride.walls, options.tolerance)
                rows.append(cells(ride.name, method, score, seconds))
                print("  ".join(rows[-1]), file=sys.stderr, flush=True)
    return rows


if __name__ == "__main__":
    sys.exit(main())
