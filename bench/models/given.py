"""
Models on given footprints against the points over them, beside those of another program.

    python -m bench.models.given [--peer NAME=FILE ...] [--set STAGE.NAME=VALUE ...] [--data DIR]

Delft with the footprints of its map through `run`; a peer's models, such as roofer's (3DBAG), come as a city
model that it made of the same files. Points are the provider's class 6 under the roofs of all: every one,
those of pulses with one return, and those that their neighbours call roof. The provider's class has façades,
plants and what stands on roofs as well. Distances are vertical to the roof, and those to the nearest face.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bench.common.arguments import data_parser
from bench.common.clouds import data_folder, read_files
from bench.common.tables import percent, table
from bench.models.run import FOOTPRINTS
from lidar_buildings.cli import main as command
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model.quality import distance_to_surface
from lidar_buildings.evaluation.readers.city_model import read_city_model
from lidar_buildings.evaluation.scores.models import roof_elevations

#: Neighbours that tell whether a point lies on a roof: they do if their plane rises by less than 60°, and is
#: so rough at most [m].
_NEIGHBOURS, _UPRIGHT, _ROUGH = 12, 0.5, 0.05
HEADINGS = (
    "points",
    "models",
    "number",
    "median",
    "< 0.1 m",
    "< 0.5 m",
    "nearest face",
    "< 0.1 m",
    "< 0.5 m",
)


def is_roof(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points (n, 3) lie on a surface like a roof, by their neighbours alone."""
    around = points[cKDTree(points[:, :3]).query(points, k=_NEIGHBOURS)[1]]
    around -= around.mean(axis=1, keepdims=True)
    values, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around) / _NEIGHBOURS)
    rough = np.sqrt(np.maximum(values[:, 0], 0.0))
    return np.asarray((np.abs(axes[:, 2, 0]) > _UPRIGHT) & (rough < _ROUGH))


def solids_in(path: Path, origin: NDArray[np.float64]) -> list[Solid]:
    """Read the finest solids of a city model, less an origin."""
    found = [solid for one in read_city_model(path).buildings for solid in one.finest("2.2")[1]]
    return [Solid(np.round(one.vertices - origin, 6), one.faces, one.semantics) for one in found]


def models_table(
    models: dict[str, list[Solid]], points: NDArray[np.float64], groups: dict[str, NDArray]
) -> str:
    """Return a line for each group of points and each program's models."""
    off = {name: np.abs(points[:, 2] - roof_elevations(solids, points)) for name, solids in models.items()}
    is_under = np.all([np.isfinite(one) for one in off.values()], axis=0)
    away = {}
    for name, solids in models.items():
        nearest = off[name].copy()
        for solid in solids:
            nearest[is_under] = distance_to_surface(points[is_under], solid, nearest[is_under])
        away[name] = nearest
    rows = []
    for group, chosen in groups.items():
        for name in models:
            row = [group, name, str(np.count_nonzero(chosen & is_under))]
            for distance in (off[name][chosen & is_under], away[name][chosen & is_under]):
                row.append(f"{100.0 * np.median(distance):.1f} cm")
                row += [percent(float(np.mean(distance <= limit))) for limit in (0.1, 0.5)]
            rows.append(row)
    return table(HEADINGS, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print how many solids there are and which are valid, and how near to the points they are."""
    parser = data_parser(__doc__)
    parser.add_argument("--peer", nargs="+", default=[], metavar="NAME=FILE", help="another program's models")
    parser.add_argument("--set", nargs="+", default=[], metavar="STAGE.NAME=VALUE")
    options = parser.parse_args(arguments)
    folder = data_folder(options.data) / "delft"
    files = sorted(folder.glob("*.laz"))
    tile, frame = read_files(files)
    is_class = tile.classification == PointClass.BUILDING
    points, returns = tile.points[is_class], tile.number_of_returns
    groups = {"class 6": np.ones(len(points), dtype=bool), "roof by its neighbours": is_roof(points)}
    if returns is not None:
        groups["single returns"] = returns[is_class] == 1
    origin = np.array([*frame.origin[:2], 0.0])
    with tempfile.TemporaryDirectory() as output, contextlib.redirect_stdout(io.StringIO()):
        given = ["--footprints", str(folder / FOOTPRINTS), *(["--set", *options.set] if options.set else [])]
        if command(["run", *map(str, files), "--output", f"{output}/result", "--no-ros", *given]):
            raise SystemExit("run failed")
        models = {"ours": solids_in(Path(output) / "result", origin)}
    for name, _, file in (one.partition("=") for one in options.peer):
        models[name] = solids_in(Path(file), origin)
    for name, solids in models.items():
        faces = sum(solid.semantics.count(ROOF_SURFACE) for solid in solids)
        n_valid = sum(not check_solid(solid) for solid in solids)
        print(f"{name}: {len(solids)} solids, {n_valid} of them valid, {faces} roof faces")
    print(models_table(models, points, groups))


if __name__ == "__main__":
    main()
