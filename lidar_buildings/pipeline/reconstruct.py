"""The order of the stages for one tile, without ROS."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from typing import Any

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.parameters import StageConfig
from lidar_buildings.core.model.stage_names import STAGES
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.boundary_tracing import BoundaryTracingConfig
from lidar_buildings.core.stages.building_model import BuildingModelConfig
from lidar_buildings.core.stages.edge_labelling import EdgeLabellingConfig
from lidar_buildings.core.stages.footprints import FootprintConfig, Footprints
from lidar_buildings.core.stages.ground_filter import GroundFilterConfig
from lidar_buildings.core.stages.plane_fitting import PlaneFittingConfig
from lidar_buildings.core.stages.regularisation import RegularisationConfig
from lidar_buildings.core.stages.roof_selection import RoofSelectionConfig
from lidar_buildings.core.stages.segmentation import SegmentationConfig
from lidar_buildings.pipeline.tile_models import TileModel, build_models
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_stages import (
    filter_ground,
    fit_planes,
    label_roof_edges,
    roof_points,
    select_roof_points,
    trace_buildings,
    trace_footprints,
)


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

        Raises
        ------
        ParameterError
            If a stage or name is unknown, or a value out of range.
        """
        return cls(**{stage: stage_config(stage, values) for stage, values in settings.items()})


#: Stage name → its config class, in the order of the chain.
STAGE_CONFIGS: dict[str, type[StageConfig]] = {
    member.name: member.default_factory  # type: ignore[misc]
    for member in fields(PipelineConfig)
}


def stage_config(stage: str, values: Mapping[str, Any]) -> StageConfig:
    """
    Make one stage's config, or say which name is unknown and which one was probably meant.

    Raises
    ------
    ParameterError
        If the stage or a name is unknown, or a value out of range.
    """
    if stage not in STAGE_CONFIGS:
        raise ParameterError(f"there is no stage {stage!r}{_nearest(stage, STAGE_CONFIGS)}")
    known = [member.name for member in fields(STAGE_CONFIGS[stage])]
    for name in values:
        if name not in known:
            raise ParameterError(f"there is no parameter {stage}.{name}{_nearest(name, known)}")
    return STAGE_CONFIGS[stage](**values)


@dataclass(frozen=True, eq=False)
class TileResult:
    """
    All that the chain made of one tile; members of stages that were not run are None or empty.

    Attributes
    ----------
    classified : PointTile
        Every point of the tile with its class and height above ground.
    roofs : PointTile or None
        The points of class 6 with edge labels, building and plane ids as far as the chain went.
    traced, outlines : tuple of BuildingOutline
        Before and after regularisation, by rising building id.
    models : tuple of TileModel
        One per outline.
    clipped : bool
        Whether a building of this tile reaches beyond the tile's buffer; the chain then ends after tracing.
    seconds : dict
        Stage name → seconds it took.
    """

    classified: PointTile
    roofs: PointTile | None = None
    traced: tuple[BuildingOutline, ...] = ()
    outlines: tuple[BuildingOutline, ...] = ()
    models: tuple[TileModel, ...] = ()
    clipped: bool = False
    seconds: dict[str, float] = field(default_factory=dict)


def reconstruct_tile(
    tile: PointTile,
    config: PipelineConfig | None = None,
    *,
    until: str = STAGES[-1],
    footprints: Footprints | None = None,
) -> TileResult:
    """
    Take one tile from raw points to models.

    Parameters
    ----------
    tile : PointTile
        Raw points.
    config : PipelineConfig, optional
        All defaults if not given.
    until : str
        The last stage to run, one of `STAGES`.
    footprints : Footprints, optional
        Outlines to use as they are instead of tracing and regularising.

    Returns
    -------
    TileResult
        The same numbers as the node graph gives for this tile.

    Raises
    ------
    ValueError
        If `until` is no stage.
    """
    config = config or PipelineConfig()
    if until not in STAGES:
        raise ValueError(f"until = {until!r}: must be one of {', '.join(STAGES)}")
    if footprints is not None:
        config = replace(config, regularisation=replace(config.regularisation, keep_outlines=True))
    chain = _Chain(tile, config, footprints)
    for stage in STAGES[: STAGES.index(until) + 1]:
        started = time.perf_counter()
        getattr(chain, stage)()
        chain.seconds[stage] = time.perf_counter() - started
        if chain.clipped:
            break
    return chain.result()


class _Chain:
    """What is known of a tile so far; one method per stage, named as the stage."""

    def __init__(self, tile: PointTile, config: PipelineConfig, footprints: Footprints | None) -> None:
        self.classified = tile
        self.config = config
        self.footprints = footprints
        self.roofs: PointTile | None = None
        self.traced: tuple[BuildingOutline, ...] = ()
        self.outlines: tuple[BuildingOutline, ...] = ()
        self.models: tuple[TileModel, ...] = ()
        self.clipped = False
        self.seconds: dict[str, float] = {}

    def ground_filter(self) -> None:
        self.classified = filter_ground(self.classified, self.config.ground_filter)

    def roof_selection(self) -> None:
        self.classified = select_roof_points(self.classified, self.config.roof_selection)
        self.roofs = roof_points(self.classified)

    def edge_labelling(self) -> None:
        self.roofs = label_roof_edges(self.roofs, self.config.edge_labelling).tile

    def boundary_tracing(self) -> None:
        if self.footprints is None:
            found = trace_buildings(self.roofs, self.config.segmentation, self.config.boundary_tracing)
        else:
            found = trace_footprints(
                self.classified,
                self.roofs,
                self.footprints,
                self.config.footprints,
                self.config.edge_labelling,
            )
        self.roofs, self.traced, self.clipped = found.tile, found.outlines, found.clipped

    def regularisation(self) -> None:
        self.outlines = regularise_outlines(self.traced, self.config.regularisation)

    def plane_fitting(self) -> None:
        self.roofs = fit_planes(self.roofs, self.config.plane_fitting)

    def building_model(self) -> None:
        self.models = build_models(
            self.roofs,
            self.traced,
            self.outlines,
            self.config.building_model,
            self.config.regularisation,
        )

    def result(self) -> TileResult:
        return TileResult(
            self.classified,
            self.roofs,
            self.traced,
            self.outlines,
            self.models,
            self.clipped,
            self.seconds,
        )


def _nearest(word: str, known: Any) -> str:
    """Suggest the nearest known name, or list them all."""
    near = get_close_matches(word, list(known), n=1)
    return f" (did you mean {near[0]}?)" if near else f" (there are {', '.join(known)})"
