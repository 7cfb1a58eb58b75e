"""Models of real clouds: who has which level of detail and why not more, validity, distance to the points."""

from __future__ import annotations

import contextlib
import io
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.common.clouds import read_files
from bench.common.tables import percent, table
from lidar_buildings.cli import main as command
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.evaluation.readers.city_model import read_city_model
from lidar_buildings.evaluation.readers.labelled_points import read_roof_points
from lidar_buildings.evaluation.scores.cells import Figures
from lidar_buildings.evaluation.scores.models import WITHIN, score_model_points
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.tile_models import build_models
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_stages import fit_planes, label_roof_edges
from lidar_buildings.pipeline.tile_tracing import trace_buildings

LODS = ("2.2", "1.3", "1.2")
#: Folders whose files adjoin and are read as one cloud; in others every file is one.
ADJOINING = ("delft", "montpellier", "lowdensity")
#: Folders whose points are roofs already.
ROOFS_ONLY = ("trondheim",)
#: Folders with files that cannot be read.
UNREADABLE = ("bad",)
#: A length, a share or a count in a reason.
_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?")
#: Reasons that are shown.
N_REASONS = 12
HEADINGS = (
    "buildings",
    "LoD2.2",
    "1.3 at most",
    "1.2 at most",
    "none",
    "solids",
    "valid",
    "RMSE median",
    "95 %",
    "class 6 median",
    "< 0.1 m",
    "< 0.2 m",
    "< 0.5 m",
    "no roof",
)


class BuiltModel(NamedTuple):
    """One building."""

    name: str
    solids: dict[str, tuple[Solid, ...]]  #: by level of detail, near the origin of coordinates [m]
    attributes: dict[str, Any]

    @property
    def finest(self) -> str:
        """The finest level, an empty text if there is none."""
        return max(self.solids, default="")


class CloudModels(NamedTuple):
    """All buildings of a cloud."""

    name: str
    buildings: list[BuiltModel]
    #: Distances of the provider's class 6 to the finest roofs, None where there is no such class.
    points: Figures | None

    def n_at(self, level: str) -> int:
        """Number of buildings whose finest level this is, beside LoD2.3."""
        return sum(min(one.finest, LODS[0]) == level for one in self.buildings)

    def invalid(self) -> list[tuple[str, str, tuple[int, ...]]]:
        """Return name, level and codes of every solid that fails the checks."""
        return [
            (one.name, level, codes)
            for one in self.buildings
            for level, parts in one.solids.items()
            for part in parts
            if (codes := check_solid(part))
        ]


def clouds_in(data: Path) -> Iterator[tuple[str, list[Path]]]:
    """Yield every cloud of the data folder: its name and its files."""
    for folder in sorted(path for path in data.iterdir() if path.is_dir() and path.name not in UNREADABLE):
        files = sorted(folder.glob("*.laz"))
        if files and folder.name in ADJOINING:
            yield folder.name, files
            continue
        for file in files:
            yield folder.name if len(files) == 1 else f"{folder.name}/{file.stem}", [file]


def models_of_cloud(
    name: str, files: Sequence[Path], output: Path, *, footprints: Path | None = None
) -> CloudModels:
    """Take a cloud through the whole chain, as the command does; roofs alone from the tracing on."""
    if name.split("/")[0] in ROOFS_ONLY:
        return CloudModels(name, _models_of_roofs(files), None)
    arguments = ["run", *map(str, files), "--output", str(output), "--no-ros", "--overwrite"]
    arguments += [] if footprints is None else ["--footprints", str(footprints)]
    silence = io.StringIO()
    with contextlib.redirect_stdout(silence), contextlib.redirect_stderr(silence):
        status = command(arguments)
    if status:
        raise SystemExit(f"lidar-buildings {' '.join(arguments)}: status {status}:\n{silence.getvalue()}")
    title = name if footprints is None else f"{name}, footprints"
    return CloudModels(title, buildings_of(output), points_of(output, files))


def buildings_of(path: Path) -> list[BuiltModel]:
    """Read models, moved near the origin of coordinates as their checks need it."""
    model = read_city_model(path)
    parts = [part.vertices.min(axis=0) for one in model.buildings for p in one.solids.values() for part in p]
    origin = np.floor(np.min(parts, axis=0)) if parts else np.zeros(3)
    return [
        BuiltModel(
            one.name,
            {level: tuple(_moved(part, origin) for part in parts) for level, parts in one.solids.items()},
            one.attributes,
        )
        for one in model.buildings
    ]


def points_of(output: Path, files: Sequence[Path]) -> Figures | None:
    """Measure the provider's class 6 against the finest roofs."""
    points = np.concatenate([read_roof_points(file, (6,))[0] for file in files])
    if not len(points):
        return None
    buildings = read_city_model(output).buildings
    return score_model_points([one.finest(LODS[0])[1] for one in buildings], points)


def clouds_table(clouds: Sequence[CloudModels]) -> str:
    """Return a line per cloud, and one of all."""
    together = CloudModels("all", [one for cloud in clouds for one in cloud.buildings], None)
    return table(("cloud", *HEADINGS), ([one.name, *_cells(one)] for one in (*clouds, together)))


def reasons_table(clouds: Sequence[CloudModels]) -> str:
    """Return how often buildings have which status and reason, numbers in the reason left out."""
    counts: Counter[tuple[str, str, str]] = Counter()
    for cloud in clouds:
        for one in cloud.buildings:
            reason = _without_numbers(str(one.attributes.get("reason") or ""))
            counts[one.finest or "none", str(one.attributes.get("status")), reason or "–"] += 1
    rows = ([str(n), *what] for what, n in sorted(counts.items(), key=lambda item: (-item[1], item[0])))
    return table(("buildings", "finest", "status", "reason"), list(rows)[:N_REASONS])


def own_rmse(cloud: CloudModels) -> NDArray[np.float64]:
    """Return the attribute `rmse` of the buildings with a LoD2.2 [m]."""
    values = [one.attributes.get("rmse") for one in cloud.buildings if one.finest >= LODS[0]]
    return np.array([value for value in values if value is not None], dtype=np.float64)


def _cells(cloud: CloudModels) -> list[str]:
    """Return a cloud's figures in the order of `HEADINGS`."""
    n, rmse = len(cloud.buildings), own_rmse(cloud)
    n_solids = sum(len(parts) for one in cloud.buildings for parts in one.solids.values())
    shares = [percent(cloud.n_at(level) / n if n else math.nan) for level in LODS]
    points = cloud.points
    return [
        str(n),
        *shares,
        str(cloud.n_at("")),
        str(n_solids),
        str(n_solids - len(cloud.invalid())),
        *(f"{np.percentile(rmse, share):.3f}" if len(rmse) else "–" for share in (50, 95)),
        f"{points['median']:.3f}" if points else "–",
        *(map(percent, (points[f"within_{100 * d:.0f}_cm"] for d in WITHIN)) if points else ["–"] * 3),
        percent(points["uncovered"]) if points else "–",
    ]


def _moved(solid: Solid, origin: NDArray[np.float64]) -> Solid:
    """Return a solid less an origin, on the grid that it was written on."""
    return Solid(np.round(solid.vertices - origin, 6), solid.faces, solid.semantics)


def _models_of_roofs(files: Sequence[Path]) -> list[BuiltModel]:
    """Build the models of clouds that hold roofs alone: there is no ground."""
    tile = read_files(files)[0]
    config = PipelineConfig()
    roofs = label_roof_edges(PointTile(points=tile.points), config.edge_labelling).tile
    traced = trace_buildings(roofs, config.segmentation, config.boundary_tracing)
    outlines = regularise_outlines(traced.outlines, config.regularisation)
    roofs = fit_planes(traced.tile, config.plane_fitting)
    models = build_models(roofs, outlines, config.building_model)
    return [
        BuiltModel(
            str(one.building_id),
            {level: (solid,) for level, solid in one.model.solids.items()},
            one.attributes,
        )
        for one in models
    ]


def _without_numbers(text: str) -> str:
    """Replace numbers so that equal reasons are counted as one; levels and codes of checks stay."""
    return text if "checks" in text else _NUMBER.sub("…", text)
