"""
Models of City3D's buildings from raw points, beside City3D's own of the same points.

    python -m bench.models.city3d [--sets NAME ...] [--buildings N] [--list] [--place M]
                                  [--set STAGE.NAME=VALUE ...] [--data DIR]

Each building of the data set of Huang and others (2022) stands on a place of its own, with flat ground 5 m
below its lowest points (`bench.generalise.raw`), all of a set go through `run` with defaults as one file.
Their models are a peer's, and no truth: what is compared is how near to the same points both lie.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.arguments import data_parser
from bench.common.clouds import data_folder
from bench.common.tables import percent, table
from bench.generalise.raw import PLACE, models_on_places
from bench.models.spikes import NEAR, PLANE, SETS, read_ply
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid
from lidar_buildings.core.stages.building_model.quality import distance_to_surface
from lidar_buildings.core.stages.plane_fitting.fitting import number_planes
from lidar_buildings.evaluation.scores.models import faces_of

#: A point so near to a model is on it [m], and one of two models is better by so many more of them.
ON_MODEL, CLEARLY = 0.1, 0.05
#: Points whose normal rises less, or that lie less above the lowest ones, are of walls and ground [–, m].
_UPRIGHT, _LOW = 0.3, 1.0
#: The lowest points: this percentile of their elevations.
_LOWEST = 1.0
#: Convex hulls of smaller buildings are small [m²].
_SMALL = 20.0
#: A vertex so far above or below all points is beyond them [m].
_BEYOND = 0.5
_HEADINGS = (
    "set", "places", "within 0.1 m", "of those modelled", "City3D", "better", "worse", "no model", "small",
    "no model", "several", "above", "below", "planes", "lost", "by City3D",
)  # fmt: skip


class Place(NamedTuple):
    """One building, and how near both models are to its points."""

    name: str
    n_models: int
    hull: float  #: area of the convex hull in plan [m²]
    ours: float  #: share of roof points on the model
    theirs: float
    n_roof: int
    beyond: tuple[float, float]  #: of the highest vertex above, of the lowest of roofs below all points [m]
    planes: tuple[int, int, int]  #: how many, lost by us, by City3D


def read_obj(path: Path) -> Solid:
    """Read the faces of an OBJ; their kind is not known."""
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([row[1:4] for row in rows if row[:1] == ["v"]], dtype=np.float64)
    faces = [tuple(int(one.split("/")[0]) - 1 for one in row[1:]) for row in rows if row[:1] == ["f"]]
    return Solid(vertices, tuple((face,) for face in faces), ("",) * len(faces))


def roof_rows(cloud: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points (n, 6), with normals, are of no wall and no ground."""
    above = cloud[:, 2] - np.percentile(cloud[:, 2], _LOWEST)
    is_roof = np.abs(cloud[:, 5]) >= _UPRIGHT
    return (
        is_roof & (above >= _LOW) if 2 * np.count_nonzero(is_roof & (above >= _LOW)) > len(cloud) else is_roof
    )


def place_of(name: str, cloud: NDArray[np.float64], solids: Sequence[Solid], theirs: Solid) -> Place:
    """Compare the models of a place, and City3D's, with the roof's points."""
    roof = np.ascontiguousarray(cloud[roof_rows(cloud), :3])
    own, other = _away(roof, solids), _away(roof, [theirs])
    tops = np.concatenate([solid.vertices[:, 2] for solid in solids]) if solids else roof[:1, 2]
    eaves = [solid.vertices[list(face[0]), 2] for solid in solids for face in faces_of(solid, ROOF_SURFACE)]
    low = float(np.concatenate(eaves).min()) if eaves else float(roof[:, 2].min())
    spacing = measure_spacing(roof)
    of_plane = number_planes(roof, point_spacing=spacing)
    sizes = np.bincount(of_plane)
    large = [k for k in range(1, len(sizes)) if sizes[k] * spacing**2 >= PLANE] if solids else []
    lost = [sum(np.mean(away[of_plane == k] <= NEAR) < 0.5 for k in large) for away in (own, other)]
    return Place(
        name,
        len(solids),
        float(shapely.MultiPoint(roof[:, :2]).convex_hull.area),
        float(np.mean(own <= ON_MODEL)),
        float(np.mean(other <= ON_MODEL)),
        len(roof),
        (float(tops.max() - cloud[:, 2].max()), float(cloud[:, 2].min() - low)),
        (len(large), lost[0], lost[1]),
    )


def _away(points: NDArray[np.float64], solids: Sequence[Solid]) -> NDArray[np.float64]:
    away = np.full(len(points), np.inf)
    for solid in solids:
        away = np.minimum(away, distance_to_surface(points, solid, np.full(len(away), np.inf)))
    return away


def _row(name: str, places: Sequence[Place]) -> list[str]:
    modelled = [one for one in places if one.n_models]
    better = sum(one.ours - one.theirs >= CLEARLY for one in modelled)
    worse = sum(one.theirs - one.ours >= CLEARLY for one in modelled)
    small = [one for one in places if one.hull < _SMALL]
    n_planes, lost, their_lost = np.sum([one.planes for one in places], axis=0)
    return [
        name, str(len(places)), _share(places, "ours"), _share(modelled, "ours"), _share(modelled, "theirs"),
        str(better), str(worse), str(len(places) - len(modelled)), str(len(small)),
        str(sum(not one.n_models for one in small)), str(sum(one.n_models > 1 for one in places)),
        *(str(sum(one.beyond[k] > _BEYOND for one in modelled)) for k in (0, 1)),
        str(n_planes), str(lost), str(their_lost),
    ]  # fmt: skip


def _share(places: Sequence[Place], whose: str) -> str:
    n = [one.n_roof for one in places]
    return percent(float(np.average([getattr(one, whose) for one in places], weights=n)) if n else np.nan)


def main(arguments: list[str] | None = None) -> None:
    """Print a line per set, and one per building if asked."""
    parser = data_parser(__doc__)
    parser.add_argument("--sets", nargs="+", choices=SETS, default=SETS)
    parser.add_argument("--buildings", type=int, default=1000, help="at most so many of a set")
    parser.add_argument("--list", action="store_true", help="a line per building")
    parser.add_argument(
        "--place", type=float, default=PLACE, help="side of the places; smaller is faster [m]"
    )
    parser.add_argument("--set", nargs="+", default=[], metavar="STAGE.NAME=VALUE")
    options: argparse.Namespace = parser.parse_args(arguments)
    rows = []
    for name in options.sets:
        files = sorted((data_folder(options.data) / "city3d" / name).glob("*.ply"))[: options.buildings]
        clouds = [read_ply(path, ("x", "y", "z", "nx", "ny", "nz")) for path in files]
        models = models_on_places([one[:, :3] for one in clouds], options.set, place=options.place)
        places = [
            place_of(path.stem, cloud, solids, read_obj(path.with_suffix(".obj")))
            for path, cloud, solids in zip(files, clouds, models, strict=True)
        ]
        rows.append(_row(name, places))
        if options.list:
            print(table(("place", *Place._fields[1:]), [[*map(_text, one)] for one in places]))
    print(table(_HEADINGS, rows))


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_text, value))
    return f"{value:.3f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
