"""Models of virtual roofs against their exact truth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.common.tables import table
from bench.scenes.models import ModelScene, roof_words
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.core.stages.plane_fitting.fitting import RoofPlanes, fit_roof_planes
from lidar_buildings.evaluation.scores.cells import Figures
from lidar_buildings.evaluation.scores.models import n_corners, score_models
from lidar_buildings.pipeline.config import PipelineConfig

#: The finest level; the others come in its place.
FINEST = "2.2"
#: A plane counts as found if its points and those of a true face have at least this intersection over union.
MIN_IOU = 0.5
#: How far a ridge may lie beside the true one in plan to be its counterpart [m].
RIDGE_TOLERANCE = 1.0
#: Roofs that facets stand for: how many of them is a matter of tolerance.
CURVED = ("barrel", "pointed_tower")
HEADINGS = (
    "scenes",
    "LoD2.2",
    "valid",
    "type right",
    "planes found",
    "too many",
    "angle [°]",
    "ridge [m]",
    "roof RMSE [m]",
    "volume [%]",
    "vertices equal",
    "corners equal",
)


class Verdict(NamedTuple):
    """One scene's model against its truth."""

    scene: ModelScene
    model: BuildingModel
    #: True faces that have points, those that a plane was found for, and planes found for none.
    n_faces: int
    n_found: int
    n_extra: int
    angle_deg: float  #: largest angle between a true face and the plane found for it [deg]
    score: Figures  #: of the finest solid
    #: Largest difference of a ridge's elevation [m]; infinite if one has no counterpart, NaN without any.
    ridge_error: float
    is_valid: bool  #: whether every solid passes the checks

    @property
    def has_finest(self) -> bool:
        """Whether there is a LoD2.2."""
        return FINEST in self.model.solids

    @property
    def type_right(self) -> bool:
        """Whether the roof's type is one of the words that are right."""
        return str(self.model.attributes.get("roof_type")) in roof_words(self.scene.name)

    @property
    def volume_error(self) -> float:
        """Volume of the finest solid / true volume − 1, without sign; NaN without a solid."""
        return abs(float(self.score["volume_ratio_per_reference"][0]) - 1.0)

    @property
    def vertices_equal(self) -> bool:
        """Whether the LoD2.2 has as many vertices as the truth as it is written."""
        return self.has_finest and len(self.model.solids[FINEST].vertices) == len(self.scene.solid.vertices)

    @property
    def corners_equal(self) -> bool:
        """Whether the LoD2.2 has as many corners as the truth."""
        return self.has_finest and n_corners(self.model.solids[FINEST]) == n_corners(self.scene.solid)


def judged(scenes: Iterable[ModelScene], configs: PipelineConfig | None = None) -> list[Verdict]:
    """Fit planes and build the model of every scene."""
    return [verdict(scene, configs or PipelineConfig()) for scene in scenes]


def modelled(scene: ModelScene, configs: PipelineConfig) -> tuple[RoofPlanes, BuildingModel]:
    """Return a scene's planes and its model, from the true outline."""
    planes = fit_roof_planes(scene.points, configs.plane_fitting)
    model = build_model(
        scene.points,
        scene.outline,
        configs.building_model,
        plane_id=planes.plane_id if scene.given_planes is None else scene.given_planes,
        ground_elevation=scene.ground_elevation,
    )
    return planes, model


def verdict(scene: ModelScene, configs: PipelineConfig) -> Verdict:
    """Compare one scene's model with its truth."""
    planes, model = modelled(scene, configs)
    pairs = matched_planes(planes.plane_id, scene)
    found = [k for k in pairs.values() if k]
    angles = [_angle_deg(planes.planes[k - 1].normal, scene.normals[f - 1]) for f, k in pairs.items() if k]
    finest = model.solids.get(max(model.solids, default=""))
    score = score_models([[finest] if finest else []], [[scene.solid]], tolerance=RIDGE_TOLERANCE)
    return Verdict(
        scene=scene,
        model=model,
        n_faces=len(pairs),
        n_found=len(found),
        n_extra=len(planes.planes) - len(set(found)),
        angle_deg=max(angles, default=math.nan),
        score=score,
        ridge_error=_ridge_error(score),
        is_valid=all(not check_solid(solid) for solid in model.solids.values()),
    )


def matched_planes(plane_id: NDArray[np.uint16], scene: ModelScene) -> dict[int, int]:
    """
    Return the plane found for each true plane, 0 where there is none.

    Faces of one plane that lie apart, as those of a cross, may be found as one plane or each by itself.
    """
    faces = np.arange(1, len(scene.building.faces) + 1)
    by_plane, by_face = (_matched(plane_id, truth[scene.plane_id]) for truth in _truths(scene, faces))
    return by_plane if all(by_plane.values()) else by_face


def _matched(plane_id: NDArray[np.uint16], truth: NDArray[np.int64]) -> dict[int, int]:
    """Return the plane found for each number in the truth."""
    found = {}
    for face in np.unique(truth[truth > 0]).tolist():
        own = truth == face
        number = int(np.argmax(np.bincount(plane_id[own], minlength=1)))
        common = np.count_nonzero(own & (plane_id == number))
        union = np.count_nonzero(own | (plane_id == number))
        found[face] = number if number and common / union >= MIN_IOU else 0
    return found


def truth_table(verdicts: Sequence[Verdict]) -> str:
    """Return a line per shape with its worst figures, and one of all."""
    groups: dict[str, list[Verdict]] = {}
    for one in verdicts:
        groups.setdefault(one.scene.name, []).append(one)
    for kind, is_curved in (("all of planes", False), ("all curved", True)):
        groups[kind] = [one for one in verdicts if (one.scene.name in CURVED) == is_curved]
    return table(("roof", *HEADINGS), ([name, *_cells(group)] for name, group in groups.items() if group))


def bad_table(verdicts: Sequence[Verdict]) -> str:
    """Return a line per scene of bad input: what came out and why."""
    headings = ("input", "levels", "valid", "status", "type", "volume [%]", "roof RMSE [m]", "reason")
    return table(
        headings,
        (
            [
                one.scene.name,
                " ".join(sorted(one.model.solids)) or "none",
                "yes" if one.is_valid else "NO",
                one.model.status.value,
                str(one.model.attributes.get("roof_type")),
                f"{100 * one.volume_error:.2f}",
                f"{one.score['height_rmse']:.3f}",
                one.model.reason or "–",
            ]
            for one in verdicts
        ),
    )


def _cells(verdicts: Sequence[Verdict]) -> list[str]:
    """Return the figures of some scenes in the order of `HEADINGS`; errors are the largest."""
    n = len(verdicts)
    return [
        str(n),
        str(sum(one.has_finest for one in verdicts)),
        str(sum(one.is_valid for one in verdicts)),
        str(sum(one.type_right for one in verdicts)),
        f"{sum(one.n_found for one in verdicts)}/{sum(one.n_faces for one in verdicts)}",
        str(sum(one.n_extra for one in verdicts)),
        _largest((one.angle_deg for one in verdicts), 2),
        _largest((one.ridge_error for one in verdicts), 3),
        _largest((one.score["height_rmse"] for one in verdicts), 3),
        _largest((100 * one.volume_error for one in verdicts), 2),
        str(sum(one.vertices_equal for one in verdicts)),
        str(sum(one.corners_equal for one in verdicts)),
    ]


def _largest(values: Iterable[float], digits: int) -> str:
    """Write the largest of the errors that there are, a dash if there is none."""
    known = [value for value in values if not math.isnan(value)]
    return f"{max(known):.{digits}f}" if known else "–"


def _ridge_error(score: Figures) -> float:
    """Return the largest error, infinity if a ridge has no counterpart, NaN where there is no ridge."""
    if score["ridge_n_reference"] and score["ridge_recall"] < 1.0:
        return math.inf
    return float(score["ridge_largest"])


def _truths(scene: ModelScene, faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Return the number of each plane id, 0 for none, with the faces of one plane as one, and each by itself.
    """
    planes = scene.building.planes
    close = np.isclose(planes[:, None], planes[None], rtol=0.0, atol=1e-6).all(axis=2)
    return np.append(0, np.argmax(close, axis=1) + 1), np.append(0, faces)


def _angle_deg(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the angle between two planes [deg]."""
    return math.degrees(math.acos(min(1.0, abs(float(one @ other)))))
