"""
Spikes: vertices of models that rise above, or sink below, all points around them.

    python -m bench.models.spikes [--sets NAME ...] [--buildings N] [--list]

The buildings of City3D's data set (Huang and others 2022), each alone on flat ground 4 m below its lowest
points, go through the chain. A vertex of a roof is a spike if it lies more than 0.5 m + slope × spacing above
or below the points within three spacings of it; the slope is that of the least steep of its faces. Bases do
not count. Those with no point so near are compared with the nearest one.
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
from bench.common.clouds import data_folder
from bench.common.tables import table
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import measure_spacing, steady_spacing
from lidar_buildings.core.stages.building_model.spikes import Spike, spikes_of
from lidar_buildings.pipeline.reconstruct import reconstruct_tile

SETS = ("Vaihingen", "AHN3", "Dales3d")
#: Ground lies so far below the points, and reaches so far beyond them [m].
_BELOW, _BEYOND = 4.0, 15.0
_HEADER = b"end_header\n"
_TYPES = {"float": "<f4", "double": "<f8", "int": "<i4", "uint": "<u4", "short": "<i2", "uchar": "u1"}
_COUNTED = ("models", "LoD2.2", "vertices", "spikes", "buildings with spikes")


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
    """Print how many vertices of how many buildings are spikes."""
    parser = data_parser(__doc__)
    parser.add_argument("--sets", nargs="+", choices=SETS, default=SETS)
    parser.add_argument("--buildings", type=int, default=1000, help="at most so many of a set")
    parser.add_argument("--list", action="store_true", help="name every building with spikes")
    options: argparse.Namespace = parser.parse_args(arguments)
    logging.disable(logging.WARNING)
    rows = []
    for name in options.sets:
        files = sorted((data_folder(options.data) / "city3d" / name).glob("*.ply"))[: options.buildings]
        counts, worst, rmse = Counter[str](), 0.0, []
        for path in files:
            found = list(_spikes_of_file(path, counts, rmse))
            if found:
                top = max(found, key=lambda one: abs(one.excess))
                worst = max(worst, abs(top.excess))
                counts["buildings with spikes"] += 1
                counts["spikes"] += len(found)
                if options.list:
                    print(f"{name}/{path.name}: {len(found)}, {top.excess:+.2f} m, slope {top.slope:.2f}")
        told = [
            counts[one] for one in ("models", "LoD2.2", "roof vertices", "spikes", "buildings with spikes")
        ]
        middle = float(np.median(rmse)) if rmse else np.nan
        rows.append([name, *map(str, told), f"{worst:.2f}", f"{middle:.3f}", f"{np.mean(rmse):.3f}"])
    print(table(["set", *_COUNTED, "worst [m]", "median rmse [m]", "mean rmse [m]"], rows))


def _spikes_of_file(path: Path, counts: Counter[str], rmse: list[float]) -> Iterator[Spike]:
    tile = tile_of(read_ply(path))
    result = reconstruct_tile(tile)
    spacing = float(tile.point_spacing or 1.0)
    for one in result.models:
        solids = one.model.solids
        if not solids:
            continue
        counts["models"] += 1
        counts["LoD2.2"] += "2.2" in solids
        rmse.append(one.attributes["rmse"] or 0.0)
        solid = solids[max(solids)]
        points = result.roofs.points[result.roofs.building_id == one.building_id]
        counts["vertices"] += len(solid.vertices)
        yield from spikes_of(solid, points, spacing)


if __name__ == "__main__":
    main()
