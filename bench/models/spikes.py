"""
Spikes: vertices of models that rise above, or sink below, all points around; and planes that models lose.

    python -m bench.models.spikes [--sets NAME ...] [--clouds [NAME ...]] [--buildings N] [--list]

The buildings of City3D's data set (Huang and others 2022), each alone on flat ground 4 m below its lowest
points, or clouds of the data folder go through the chain. A vertex of a roof is a spike if it lies more than
0.5 m + slope × spacing above or below the roof's points within three spacings of it (all, if none is so
near); the slope is that of the least steep of its faces. Bases do not count. A plane that was found in 3 m²
and more is lost if less than half of its points lie within 0.2 m of the model.
"""

from __future__ import annotations

import argparse
import logging
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bench.common.arguments import data_parser
from bench.common.clouds import data_folder, read_files
from bench.common.tables import table
from bench.models.clouds import clouds_in
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import measure_spacing, steady_spacing
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid
from lidar_buildings.core.stages.building_model.quality import distance_to_surface
from lidar_buildings.core.stages.building_model.spikes import spikes_of
from lidar_buildings.evaluation.scores.models import faces_of
from lidar_buildings.pipeline.reconstruct import reconstruct_tile

SETS = ("Vaihingen", "AHN3", "Dales3d")
#: Ground lies so far below the points, and reaches so far beyond them [m].
_BELOW, _BEYOND = 4.0, 15.0
_HEADER = b"end_header\n"
_TYPES = {"float": "<f4", "double": "<f8", "int": "<i4", "uint": "<u4", "short": "<i2", "uchar": "u1"}
_COUNTED = ("models", "lods", "corners", "spikes", "buildings", "planes", "lost")
_HEADINGS = (
    "cloud", "models", "LoD2.2", "roof vertices", "spikes", "buildings with spikes", "planes", "lost",
    "worst [m]", "median rmse [m]", "mean rmse [m]",
)  # fmt: skip
#: Clouds with buildings.
CLOUDS = (
    "amsterdam", "ctview", "delft", "fusa", "lowdensity", "montpellier", "sparse", "stbarth", "toronto",
)  # fmt: skip
#: A plane from this area on is lost if less than half of its points lie so near to the model [m², m].
PLANE, NEAR = 3.0, 0.2


def read_ply(path: Path, names: Iterable[str] = "xyz") -> NDArray[np.float64]:
    """Read members of the vertices of a binary, little-endian PLY."""
    content = path.read_bytes()
    head, _, body = content.partition(_HEADER)
    lines = head.decode().splitlines()
    n = int(next(line.split()[-1] for line in lines if line.startswith("element vertex")))
    after = lines.index(next(line for line in lines if line.startswith("element vertex"))) + 1
    members = [
        line.split()[1:] for line in lines[after:] if line.startswith("property") and "list" not in line
    ]
    rows = np.frombuffer(body, np.dtype([(name, _TYPES[kind]) for kind, name in members]), n)
    return np.column_stack([rows[name] for name in names]).astype(np.float64)


def tile_of(points: NDArray[np.float64]) -> PointTile:
    """Put a building on ground, near the origin."""
    points = points - [*points[:, :2].mean(axis=0), points[:, 2].min() - _BELOW]
    spacing = measure_spacing(points)
    low, high = points[:, :2].min(axis=0) - _BEYOND, points[:, :2].max(axis=0) + _BEYOND
    x, y = (np.arange(a, b, spacing) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    away, _ = cKDTree(points[:, :2]).query(grid)
    jitter = np.random.default_rng(0).normal(0.0, 0.02, len(grid))
    ground = np.column_stack([grid, jitter])[away > spacing]
    every = np.concatenate([points, ground])
    return PointTile(every, point_spacing=steady_spacing(every, None))


def main(arguments: list[str] | None = None) -> None:
    """Print how many vertices of how many buildings are spikes, and how many planes are lost."""
    parser = data_parser(__doc__)
    parser.add_argument("--sets", nargs="*", choices=SETS, default=SETS, help="of City3D's (all)")
    parser.add_argument("--clouds", nargs="*", metavar="NAME", help="clouds of the data folder, too")
    parser.add_argument("--buildings", type=int, default=1000, help="at most so many of a set")
    parser.add_argument("--list", action="store_true", help="name every building with spikes")
    options: argparse.Namespace = parser.parse_args(arguments)
    logging.disable(logging.WARNING)
    data = data_folder(options.data)
    rows = []
    for name in options.sets:
        files = sorted((data / "city3d" / name).glob("*.ply"))[: options.buildings]
        rows.append(_row(name, ((path.name, tile_of(read_ply(path))) for path in files), options.list))
    for name, files in clouds_in(data) if options.clouds is not None else ():
        if name.split("/")[0] in (options.clouds or CLOUDS):
            rows.append(_row(name, iter([(name, read_files(files)[0])]), options.list))
    print(table(_HEADINGS, rows))


def _row(name: str, tiles: Iterator[tuple[str, PointTile]], is_listed: bool) -> list[str]:
    """Take tiles through the chain, and count."""
    counts, worst, rmse = Counter[str](), 0.0, []
    for source, tile in tiles:
        result = reconstruct_tile(tile)
        for one in result.models:
            solids, rows = one.model.solids, result.roofs.building_id == one.building_id
            counts["models"] += bool(solids)
            if "2.2" not in solids:
                continue
            rmse.append(one.attributes["rmse"] or 0.0)
            points, solid = result.roofs.points[rows], solids["2.2"]
            points = points[order := np.argsort(points[:, 1])]
            spacing = one.attributes["point_spacing"]
            found = list(spikes_of(solid, points, spacing))
            sizes, lost = lost_planes(points, result.roofs.plane_id[rows][order], solid, spacing)
            corners = {row for face in faces_of(solid, ROOF_SURFACE) for row in face[0]}
            counts.update(lods=1, corners=len(corners), spikes=len(found), buildings=bool(found))
            counts.update(planes=sizes, lost=lost)
            top = max((spike.excess for spike in found), key=abs, default=0.0)
            worst = max(worst, abs(top))
            if is_listed and found:
                x, y = one.anchor
                print(f"{name}/{source} ({x:.0f}, {y:.0f}): {len(found)}, {top:+.2f} m")
    return [
        name, *(str(counts[one]) for one in _COUNTED), f"{worst:.2f}",
        f"{np.median(rmse) if rmse else np.nan:.3f}", f"{np.mean(rmse) if rmse else np.nan:.3f}",
    ]  # fmt: skip


def lost_planes(
    points: NDArray[np.float64], plane_id: NDArray[np.uint16], solid: Solid, spacing: float
) -> tuple[int, int]:
    """Return how many planes of some size there are, and of how many less than half is near the model."""
    away = distance_to_surface(points, solid, np.full(len(points), np.inf))
    sizes = np.bincount(plane_id)
    large = [k for k in range(1, len(sizes)) if sizes[k] * spacing**2 >= PLANE]
    return len(large), sum(np.mean(away[plane_id == k] <= NEAR) < 0.5 for k in large)


if __name__ == "__main__":
    main()
