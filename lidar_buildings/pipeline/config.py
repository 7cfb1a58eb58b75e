"""The configs of all stages, by name."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from typing import Any

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.parameters import StageConfig
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.footprints.config import FootprintConfig
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig


@dataclass(frozen=True)
class PipelineConfig:
    """The configs of all stages, by stage name."""

    ground_filter: GroundFilterConfig = field(default_factory=GroundFilterConfig)
    roof_selection: RoofSelectionConfig = field(default_factory=RoofSelectionConfig)
    edge_labelling: EdgeLabellingConfig = field(default_factory=EdgeLabellingConfig)
    segmentation: SegmentationConfig = field(default_factory=SegmentationConfig)
    boundary_tracing: BoundaryTracingConfig = field(default_factory=BoundaryTracingConfig)
    footprints: FootprintConfig = field(default_factory=FootprintConfig)
    regularisation: RegularisationConfig = field(default_factory=RegularisationConfig)
    plane_fitting: PlaneFittingConfig = field(default_factory=PlaneFittingConfig)
    building_model: BuildingModelConfig = field(default_factory=BuildingModelConfig)

    @classmethod
    def from_settings(cls, settings: Mapping[str, Mapping[str, Any]]) -> PipelineConfig:
        """
        Make a config from ``{stage: {name: value}}``; what is not named keeps its default.

        ParameterError if a stage or name is unknown, or a value out of range.
        """
        return cls(**{stage: stage_config(stage, values) for stage, values in settings.items()})


#: Stage name → its config class, in the order of the chain.
STAGE_CONFIGS: dict[str, type[StageConfig]] = {
    member.name: member.default_factory  # type: ignore[misc]
    for member in fields(PipelineConfig)
}


def stage_config(stage: str, values: Mapping[str, Any]) -> StageConfig:
    """
    Make one stage's config, or say which name is unknown and which one was probably meant (ParameterError).
    """
    if stage not in STAGE_CONFIGS:
        raise ParameterError(f"there is no stage {stage!r}{nearest(stage, STAGE_CONFIGS)}")
    known = [member.name for member in fields(STAGE_CONFIGS[stage])]
    for name in values:
        if name not in known:
            raise ParameterError(f"there is no parameter {stage}.{name}{nearest(name, known)}")
    return STAGE_CONFIGS[stage](**values)


def nearest(word: str, known: Collection[str]) -> str:
    """Suggest the nearest known name, or list them all."""
    near = get_close_matches(word, known, n=1)
    return f" (did you mean {near[0]}?)" if near else f" (there are {', '.join(known)})"
