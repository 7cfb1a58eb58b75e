"""What speaks against a model: the doubts that its points tell."""

from __future__ import annotations

from collections.abc import Iterator

from lidar_buildings.core.model.grade import Cause, Doubt, Grade
from lidar_buildings.core.stages.building_model.quality import ModelQuality

#: Finest level of detail.
_FINEST = "2.2"
#: Shares of the outline whose points do not agree with the model, and that have none.
_CHECK, _POOR = 0.05, 0.2


def level_doubts(lod: str, has_extent: bool = True) -> Iterator[Doubt]:
    """Yield what a coarse level of detail says."""
    if lod != _FINEST:
        yield Doubt(
            Cause.COARSE_LEVEL, f"LoD{lod} is the finest level", Grade.CHECK if has_extent else Grade.POOR
        )


def support_doubts(quality: ModelQuality) -> Iterator[Doubt]:
    """Yield what points that do not agree, and missing ones, say."""
    off = 1.0 - quality.coverage - quality.no_data_share
    if off > _CHECK:
        yield Doubt(Cause.OFF_POINTS, f"{off:.0%} of the roof are off the points", _graded(off))
    if quality.no_data_share > _CHECK:
        text = f"{quality.no_data_share:.0%} of the outline have no points"
        yield Doubt(Cause.NO_POINTS, text, _graded(quality.no_data_share))


def _graded(share: float) -> Grade:
    return Grade.POOR if share > _POOR else Grade.CHECK
