"""Outlines of virtual buildings against their exact truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.common.tables import table
from bench.outlines.chain import chain_of, vertex_count
from bench.outlines.peers import run_peer
from bench.scenes.outlines import OutlineScene
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.evaluation.scores.cells import Figures
from lidar_buildings.evaluation.scores.outlines import boundary_distances, score_directions
from lidar_buildings.pipeline.config import PipelineConfig

#: A building counts as found, and a courtyard, from this intersection over union on.
MIN_IOU = 0.5
#: Headings of what `summary_cells` gives.
HEADINGS = (
    "scenes",
    "found",
    "IoU mean",
    "min",
    "corners right",
    "yards",
    "distance/spacing",
    "largest",
    "angle 95 % [°]",
    "worst",
)


class Verdict(NamedTuple):
    """One scene's result against its truth."""

    scene: OutlineScene
    polygon: shapely.Polygon  #: the largest outline; empty if there is none
    n_buildings: int  #: outlines in all
    iou: float  #: with the truth
    n_vertices: int  #: of the outline
    n_courtyards_found: int  #: true courtyards with a hole of IoU ≥ 0.5
    distances: Figures  #: of the two boundaries [m]
    #: Between walls and those of the truth: 95 % of the walls' length differ by less [deg].
    angle_95_deg: float

    @property
    def is_found(self) -> bool:
        """Whether there is one building, with enough of the true area."""
        return self.n_buildings == 1 and self.iou >= MIN_IOU

    @property
    def corners_right(self) -> bool | None:
        """Whether the outline has as many corners as the truth; None where walls are curved."""
        return None if self.scene.n_corners is None else self.n_vertices == self.scene.n_corners


def judged(
    scenes: Iterable[OutlineScene], method: str, configs: PipelineConfig | None = None
) -> list[Verdict]:
    """Run this package's chain (``"ours"``) or a peer on every scene."""
    return [verdict(scene, _polygons(scene, method, configs or PipelineConfig())) for scene in scenes]


def verdict(scene: OutlineScene, polygons: Sequence[shapely.Polygon]) -> Verdict:
    """Compare the largest outline with the truth."""
    polygon = max(polygons, key=lambda each: each.area, default=shapely.Polygon())
    sides = [np.array([side], dtype=object) for side in (polygon, scene.truth)]
    if polygon.is_empty:
        sides = [side[:0] for side in sides]
    return Verdict(
        scene=scene,
        polygon=polygon,
        n_buildings=len(polygons),
        iou=_iou(polygon, scene.truth),
        n_vertices=vertex_count(polygon),
        n_courtyards_found=_courtyards_found(polygon, scene.truth),
        distances=boundary_distances(*sides),
        angle_95_deg=score_directions(*sides)["percentile_95_deg"],
    )


def summary_cells(verdicts: Sequence[Verdict]) -> list[str]:
    """Return the figures of some scenes in the order of `HEADINGS`."""
    corners = [one.corners_right for one in verdicts if one.corners_right is not None]
    yards = sum(len(one.scene.truth.interiors) for one in verdicts)
    found_yards = sum(one.n_courtyards_found for one in verdicts)
    spacing = np.array([one.scene.spacing for one in verdicts])
    distances = (
        np.array([(one.distances["mean"], one.distances["hausdorff"]) for one in verdicts]) / spacing[:, None]
    )
    angles = [one.angle_95_deg for one in verdicts if one.scene.kind != "curved"]
    return [
        str(len(verdicts)),
        str(sum(one.is_found for one in verdicts)),
        f"{np.mean([one.iou for one in verdicts]):.3f}",
        f"{min(one.iou for one in verdicts):.3f}",
        f"{100 * np.mean(corners):.1f} %" if corners else "–",
        f"{found_yards}/{yards}" if yards else "–",
        f"{np.nanmean(distances[:, 0]):.2f}",
        f"{np.nanmax(distances[:, 1], initial=0.0):.2f}",
        f"{np.nanmean(angles):.2f}" if angles else "–",
        f"{np.nanmax(angles):.2f}" if angles else "–",
    ]


def scenes_table(verdicts: Sequence[Verdict]) -> str:
    """Return a line per plan, per kind, and one of all."""
    groups: dict[str, list[Verdict]] = {}
    for one in verdicts:
        groups.setdefault(one.scene.name, []).append(one)
    for kind in dict.fromkeys(one.scene.kind for one in verdicts):
        groups[f"all {kind}"] = [one for one in verdicts if one.scene.kind == kind]
    groups["all"] = list(verdicts)
    return table(("plan", *HEADINGS), ([name, *summary_cells(group)] for name, group in groups.items()))


def worst(verdicts: Sequence[Verdict]) -> dict[str, Verdict]:
    """Return each plan's scene of least IoU; where the corners are wrong these come first."""
    found: dict[str, Verdict] = {}
    for one in sorted(verdicts, key=lambda each: (each.corners_right is not False, each.iou)):
        found.setdefault(one.scene.name, one)
    return found


def tile_of(scene: OutlineScene) -> PointTile:
    """Return a scene's points as a tile whose pulses have the scene's spacing."""
    tile = PointTile(points=scene.points)
    return tile.with_columns(point_spacing=scene.spacing)


def _polygons(scene: OutlineScene, method: str, configs: PipelineConfig) -> Sequence[shapely.Polygon]:
    """Return a method's outlines."""
    if method != "ours":
        return list(run_peer(method, [scene.points]).polygons)
    return list(chain_of(tile_of(scene), configs).polygons)


def _iou(one: Any, other: Any) -> float:
    """Return the intersection over union."""
    return float(one.intersection(other).area / one.union(other).area)


def _courtyards_found(polygon: shapely.Polygon, truth: shapely.Polygon) -> int:
    """Count the true courtyards that a hole of the outline stands for."""
    holes: NDArray[Any] = np.array([shapely.Polygon(hole) for hole in polygon.interiors], dtype=object)
    return sum(
        any(_iou(hole, shapely.Polygon(true)) >= MIN_IOU for hole in holes) for true in truth.interiors
    )
