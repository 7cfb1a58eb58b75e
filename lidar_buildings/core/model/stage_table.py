"""
The stages of the chain in their order, and what belongs to each: the one table that other lists derive from.

`lidar_buildings.reconstruct_tile` calls them in this order; what a run may end with (``--until``),
the columns of a tile, the nodes of the graph and their parameters follow from here.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Stage:
    """One stage."""

    name: str  #: under which it is asked for, timed and recorded
    node: str  #: the ROS node that runs it
    #: Names of the configs that it takes, each a folder of `lidar_buildings.core.stages`.
    configs: tuple[str, ...]
    columns: tuple[tuple[str, str], ...] = ()  #: what it appends to the points, in message order


STAGE_TABLE = (
    Stage("ground_filter", "ground_filter", ("ground_filter",), (("height_above_ground", "<f4"),)),
    Stage("roof_selection", "roof_selector", ("roof_selection",), (("facade", "u1"),)),
    Stage(
        "edge_labelling",
        "edge_labeller",
        ("edge_labelling",),
        (
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
        "building_tracer",
        ("segmentation", "boundary_tracing", "footprints"),
        (("building_id", "<u4"),),
    ),
    Stage("regularisation", "outline_regulariser", ("regularisation",)),
    Stage("plane_fitting", "plane_fitter", ("plane_fitting",), (("plane_id", "<u2"),)),
    Stage("building_model", "model_builder", ("building_model",)),
)

#: The names of the stages that a run may end with.
STAGES = tuple(stage.name for stage in STAGE_TABLE)
