"""
The stages of the chain in their order: each is declared here, once, and every other list derives from it.

The order of a run and what it may end with (``--until``), the columns of tiles and messages, the nodes, their
topics and parameters, and the reference pages follow from `STAGE_TABLE`. A new stage is a folder of
`lidar_buildings.core.stages`, a row here, and a line in `lidar_buildings.pipeline.reconstruct`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class Stage:
    """One stage."""

    name: str  #: under which it is asked for, timed and recorded
    node: str  #: the ROS node that runs it
    verb: str  #: module of `lidar_buildings.pipeline` and function that apply it to a tile
    #: Names of the configs that it takes, each a folder of `lidar_buildings.core.stages`.
    configs: tuple[str, ...]
    #: Topics that the node reads from the stage before it, and writes for the next ones.
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    columns: tuple[tuple[str, str], ...] = ()  #: what it appends to the points, in message order
    #: Whether it works building by building, so that processes share a tile.
    is_by_building: bool = False

    @property
    def function(self) -> Callable[..., Any]:
        """The function that applies the stage to a tile; its module is imported when it is asked for."""
        module, name = self.verb.split(".")
        function: Callable[..., Any] = getattr(import_module(f"lidar_buildings.pipeline.{module}"), name)
        return function


STAGE_TABLE = (
    Stage(
        "ground_filter",
        node="ground_filter",
        verb="tile_stages.filter_ground",
        configs=("ground_filter",),
        reads=("points",),
        writes=("ground_points",),
        columns=(("height_above_ground", "<f4"),),
    ),
    Stage(
        "roof_selection",
        node="roof_selector",
        verb="tile_stages.select_roof_points",
        configs=("roof_selection",),
        reads=("ground_points",),
        writes=("classified_points", "roof_points", "street_points"),
        columns=(("facade", "u1"),),
    ),
    Stage(
        "edge_labelling",
        node="edge_labeller",
        verb="tile_stages.label_roof_edges",
        configs=("edge_labelling",),
        reads=("roof_points",),
        writes=("edge_points",),
        columns=(
            ("linearity", "<f4"),
            ("planarity", "<f4"),
            ("normal_x", "<f4"),
            ("normal_y", "<f4"),
            ("normal_z", "<f4"),
            ("neighbourhood_radius", "<f4"),
            ("edge", "u1"),
        ),
    ),
    Stage(
        "boundary_tracing",
        node="building_tracer",
        verb="tile_tracing.trace_or_close",
        configs=("segmentation", "boundary_tracing", "footprints"),
        reads=("edge_points",),
        writes=("building_points", "traced_outlines"),
        columns=(("building_id", "<u4"),),
        is_by_building=True,
    ),
    Stage(
        "regularisation",
        node="outline_regulariser",
        verb="tile_outlines.regularise_outlines",
        configs=("regularisation",),
        reads=("traced_outlines",),
        writes=("outlines", "outline_quality"),
        is_by_building=True,
    ),
    Stage(
        "facades",
        node="facade_finder",
        verb="tile_facades.find_tile_facades",
        configs=("facades",),
        reads=("street_points", "outlines"),
        writes=("facades", "facade_records", "facade_markers", "wall_map"),
    ),
    Stage(
        "plane_fitting",
        node="plane_fitter",
        verb="tile_stages.fit_planes",
        configs=("plane_fitting",),
        reads=("building_points",),
        writes=("plane_points",),
        columns=(("plane_id", "<u2"),),
        is_by_building=True,
    ),
    Stage(
        "building_model",
        node="model_builder",
        verb="tile_models.build_models",
        configs=("building_model",),
        reads=("plane_points", "outlines", "outline_quality", "facade_records"),
        writes=("roof_faces", "city_model", "building_markers"),
        is_by_building=True,
    ),
)

#: The names of the stages that a run may end with.
STAGES = tuple(stage.name for stage in STAGE_TABLE)
