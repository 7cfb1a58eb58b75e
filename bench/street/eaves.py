"""
LoD2.3 of a village seen from above and by a vehicle, against its true walls and eaves.

    python -m bench.street.eaves --result FOLDER --truth FILE

FOLDER is that of `lidar-buildings run AIRBORNE.laz VEHICLE_FOLDER`, FILE the `truth.gpkg` of the vehicle's
survey (`simulate --details --scanner vehicle`). Along true walls that were seen the nearest wall of the
models is looked for; across true eaves under which the wall was seen their overhang is measured.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyogrio
import shapely

from bench.common.tables import table

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
    "soffits measured",
)


def plans_of(path: Path) -> Iterator[tuple[shapely.Geometry, shapely.Geometry, list[bool]] | None]:
    """
    Yield each building's plan at the ground and of its roof at LoD2.3, and whether each soffit was measured.

    None where there is no such level.
    """
    header, *lines = path.read_text(encoding="utf-8").splitlines()
    transform = json.loads(header)["transform"]
    for line in lines:
        feature = json.loads(line)
        (thing,) = feature["CityObjects"].values()
        if thing["type"] != "Building":
            continue
        found = [one for one in thing["geometry"] if one["lod"] == "2.3"]
        if not found:
            yield None
            continue
        corners = np.array(feature["vertices"]) * transform["scale"] + transform["translate"]
        surfaces = found[0]["semantics"]["surfaces"]
        plans: dict[str, list[shapely.Polygon]] = {"GroundSurface": [], "RoofSurface": []}
        for face, number in zip(found[0]["boundaries"][0], found[0]["semantics"]["values"][0], strict=True):
            if surfaces[number]["type"] in plans:
                rings = [corners[ring, :2] for ring in face]
                plans[surfaces[number]["type"]].append(shapely.Polygon(rings[0], rings[1:]))
        measured = [one["measured"] for one in surfaces if "measured" in one]
        ground, roof = (
            shapely.union_all(shapely.make_valid(np.array(own, dtype=object)), grid_size=0.001)
            for own in plans.values()
        )
        yield ground, roof, measured


def score(result: Path, truth: Path) -> tuple[object, ...]:
    """Return the row of a result."""
    models = list(plans_of(result / "city_model.city.jsonl"))
    plans = [one for one in models if one is not None]
    feet = shapely.union_all([shapely.boundary(ground) for ground, _, _ in plans])
    walls = pyogrio.read_dataframe(truth, layer="walls")
    walls = walls[walls["seen"].astype(bool) & (walls["building_number"] >= 0)]
    places = np.concatenate([_places(line) for line in walls.geometry])
    away = shapely.distance(feet, shapely.points(places))
    known = away[away < _MISSED]
    eaves = pyogrio.read_dataframe(truth, layer="eaves")
    errors = []
    for eave in eaves[eaves["seen_share"] >= _SEEN].itertuples():
        middle = shapely.line_interpolate_point(eave.geometry, 0.5, normalized=True)
        over = [(g, r) for g, r, _ in plans if shapely.distance(r, middle) < 0.5]
        for ground, roof in over[:1]:
            line = shapely.get_coordinates(eave.geometry)
            along = line[-1] - line[0]
            across = np.array([-along[1], along[0]]) / np.hypot(*along)
            ray = shapely.LineString([(middle.x, middle.y) + side * 3.0 * across for side in (-1.0, 1.0)])
            ends = [
                shapely.distance(ray.intersection(shapely.boundary(one)), middle) for one in (roof, ground)
            ]
            errors.append(abs(abs(ends[1]) - eave.overhang) if np.isfinite(ends).all() else np.inf)
    off = np.array(errors)
    soffits = [flag for *_, flags in plans for flag in flags]
    return (
        len(models),
        len(plans),
        round(len(places) * STEP),
        f"{len(known) / max(len(away), 1):.3f}",
        f"{np.mean(known <= NEAR_WALL):.3f}",
        f"{100 * np.median(known):.1f}",
        len(off),
        f"{np.mean(off <= NEAR_OVERHANG):.3f}",
        f"{100 * np.median(off):.1f}",
        f"{sum(soffits)} of {len(soffits)}",
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
