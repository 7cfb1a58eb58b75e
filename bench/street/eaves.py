"""
LoD2.3 of a village seen from above and by a vehicle, against its true walls and eaves.

    python -m bench.street.eaves --result FOLDER --truth FILE

FOLDER is that of `lidar-buildings run AIRBORNE.laz VEHICLE_FOLDER`, FILE the `truth.gpkg` of the vehicle's
survey (`simulate --details --scanner vehicle`). Along true walls that were seen the nearest wall of the
models is looked for; across true eaves under which the wall was seen their overhang is measured.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely

from bench.common.tables import table
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, Solid
from lidar_buildings.core.stages.building_model.model import LOD23
from lidar_buildings.evaluation.readers.city_model import read_city_model
from lidar_buildings.evaluation.scores.models import faces_of
from lidar_buildings.io.vectors.layers import read_layer

#: Walls are asked at steps of this, away from their ends [m].
STEP, AWAY = 0.25, 0.5
#: How near a model's wall has to lie, and an overhang [m].
NEAR_WALL, NEAR_OVERHANG = 0.03, 0.10
#: A wall farther than this from all of the models' is of a building, or a part, that has no model [m].
_MISSED = 1.5
#: An eave is asked where so much of its wall was seen.
_SEEN = 0.5
HEADINGS = (
    "buildings",
    "LoD2.3",
    "seen wall [m]",
    "with a model",
    "within 3 cm",
    "median [cm]",
    "eaves",
    "overhang within 10 cm",
    "median [cm]",
)


def plans_of(solids: Sequence[Solid]) -> tuple[shapely.Geometry, shapely.Geometry]:
    """Return a building's plan at the ground, and that of its roof."""
    ground, roof = (
        [
            [ring[:, :2] for ring in solid.face_rings(face)]
            for solid in solids
            for face in faces_of(solid, kind)
        ]
        for kind in (GROUND_SURFACE, ROOF_SURFACE)
    )
    return _joined(ground), _joined(roof)


def _joined(faces: Sequence[Sequence[np.ndarray]]) -> shapely.Geometry:
    polygons = np.array([shapely.Polygon(rings[0], rings[1:]) for rings in faces], dtype=object)
    return shapely.union_all(shapely.make_valid(polygons), grid_size=0.001)


def score(result: Path, truth: Path) -> tuple[object, ...]:
    """Return the row of a result."""
    buildings = read_city_model(result / "city_model.city.jsonl").buildings
    plans = [plans_of(one.solids[LOD23]) for one in buildings if LOD23 in one.solids]
    feet = shapely.union_all([shapely.boundary(ground) for ground, _ in plans])
    walls = read_layer(truth, "walls")
    is_seen = (walls.columns["seen"] == 1) & (walls.columns["building_number"] >= 0)
    places = np.concatenate([_places(line) for line in walls.geometries[is_seen]])
    away = shapely.distance(feet, shapely.points(places))
    known = away[away < _MISSED]
    eaves = read_layer(truth, "eaves")
    errors = []
    for k in np.flatnonzero(eaves.columns["seen_share"] >= _SEEN):
        eave, overhang = eaves.geometries[k], eaves.columns["overhang"][k]
        middle = shapely.line_interpolate_point(eave, 0.5, normalized=True)
        over = [(g, r) for g, r in plans if shapely.distance(r, middle) < 0.5]
        for ground, roof in over[:1]:
            line = shapely.get_coordinates(eave)
            along = line[-1] - line[0]
            across = np.array([-along[1], along[0]]) / np.hypot(*along)
            ray = shapely.LineString([(middle.x, middle.y) + side * 3.0 * across for side in (-1.0, 1.0)])
            ends = [
                shapely.distance(ray.intersection(shapely.boundary(one)), middle) for one in (roof, ground)
            ]
            errors.append(abs(abs(ends[1]) - overhang) if np.isfinite(ends).all() else np.inf)
    off = np.array(errors)
    return (
        len(buildings),
        len(plans),
        round(len(places) * STEP),
        f"{len(known) / max(len(away), 1):.3f}",
        f"{np.mean(known <= NEAR_WALL):.3f}",
        f"{100 * np.median(known):.1f}",
        len(off),
        f"{np.mean(off <= NEAR_OVERHANG):.3f}",
        f"{100 * np.median(off):.1f}",
    )


def _places(line: shapely.LineString) -> np.ndarray:
    """Return places along a line, away from its ends."""
    along = np.arange(AWAY, line.length - AWAY, STEP)
    return shapely.get_coordinates(shapely.line_interpolate_point(line, along))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--result", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    options = parser.parse_args(arguments)
    print(table(HEADINGS, [tuple(map(str, score(options.result, options.truth)))]))


if __name__ == "__main__":
    main()
