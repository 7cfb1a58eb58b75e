"""Which node has which parameters; and those that no stage has, of sources and results. It needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, advanced, fixed, parameter
from lidar_buildings.core.model.replicas import ReplicaConfig
from lidar_buildings.core.model.stage_table import STAGE_TABLE
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.footprints.config import FootprintConfig
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.clouds.find_inputs import InputConfig
from lidar_buildings.io.results.output_config import SurveyConfig
from lidar_buildings.io.tiling.tiling_config import FeedConfig, TilingConfig
from lidar_buildings.nodes.table import RECORDED
from lidar_buildings.pipeline.config import STAGE_CONFIGS
from lidar_buildings.ros.depths import FEW_POINTS, MOST_TILES


@dataclass(frozen=True)
class SendingConfig(StageConfig):
    """How many tiles may be in the graph, and how long they are waited for."""

    max_tiles_in_flight: int = fixed(
        2,
        f"How many tiles may be in the graph, and unless it is 1 more, up to {MOST_TILES}, while they have "
        f"fewer than {FEW_POINTS:,} points together; 0 sends without waiting for `tile_done`.",
        within=(0, MOST_TILES),
        advanced=True,
    )
    tile_timeout: float = fixed(
        1.0,
        "Time, beside 1 s for each 50 MB of it, after which a tile that no node has is sent again; a longer "
        "one leaves more time to nodes of others that publish no `node_state`.",
        unit="s",
        within=(0.1, 86_400.0),
        advanced=True,
    )
    max_attempts: int = fixed(
        4,
        "A tile is given up when so many nodes have died while they worked on it.",
        within=(1, 100),
        advanced=True,
    )
    wait_for: tuple[str, ...] = fixed(
        ("points",),
        "Topics that must have a subscriber before a tile is sent, so that no node misses the first one; one "
        "that is named twice must have two.",
        advanced=True,
    )
    start_paused: bool = fixed(
        False, "Whether to wait for ~/resume or ~/step before the first tile.", advanced=True
    )


@dataclass(frozen=True)
class TilePlayerConfig(SendingConfig, BagConfig, TilingConfig, InputConfig):
    """What to play, and how fast."""

    stage: ClassVar[str] = "tile_player"

    input: tuple[str, ...] = fixed((), "Files, folders and globs of LAS, LAZ and COPC clouds; bags of scans.")
    placed: str = fixed(
        "",
        "Folder for the points of bags, the same for `model_writer`; empty: a temporary one.",
        advanced=True,
    )
    rate: float = parameter(
        0.0,
        "Speed as a multiple of the recorded time; 0 plays as fast as the graph takes the tiles.",
        within=(0.0, 1_000_000.0),
    )
    publish_clock: bool = fixed(
        False, "Whether to publish the stamps as time on `/clock`, for use_sim_time.", advanced=True
    )


@dataclass(frozen=True)
class ScanAssemblerConfig(SendingConfig, FeedConfig):
    """How scans become tiles, and how these are sent."""

    stage: ClassVar[str] = FeedConfig.stage
    is_of_node: ClassVar[bool] = False


@dataclass(frozen=True)
class GroundFilterNodeConfig(GroundFilterConfig):
    """What the node can do beyond its stage."""

    stage: ClassVar[str] = GroundFilterConfig.stage

    publish_dtm: bool = fixed(
        False, "Whether to publish each tile's terrain on `dtm`, to look at or to plan with.", advanced=True
    )
    dtm_resolution: float = advanced(
        0.5,
        "Side of a cell of `dtm`; a larger one gives smaller messages and less detail.",
        unit="m",
        within=(0.05, 100.0),
    )


@dataclass(frozen=True)
class FootprintNodeConfig(FootprintConfig):
    """Where footprints come from, and which points belong to them."""

    stage: ClassVar[str] = FootprintConfig.stage

    file: str = fixed(
        "",
        "File of polygons to use as outlines instead of tracing; the same for `model_writer`, and with it "
        "`regularisation.keep_outlines`. Empty: outlines are traced.",
    )
    layer: str = fixed("", "Layer of the file; empty: its only one.", advanced=True)


@dataclass(frozen=True)
class FlowControlConfig(StageConfig):
    """Who tells the player that a tile is done."""

    stage: ClassVar[str] = "flow_control"

    publish_tile_done: bool = fixed(
        False,
        "Whether to report a tile as done once its models are published, in a graph that writes no files.",
        advanced=True,
    )


@dataclass(frozen=True)
class MapFrameConfig(StageConfig):
    """How long tiles wait until it is known where they lie."""

    stage: ClassVar[str] = "map_frame"

    frame_patience: float = fixed(
        10.0,
        "Time that a tile waits for `map_origin` while nobody publishes it; then the map frame is taken as "
        "it is, with origin 0 and no reference system. A longer one suits sources that start late.",
        unit="s",
        within=(0.1, 86_400.0),
        advanced=True,
    )


@dataclass(frozen=True)
class ModelWriterConfig(MapFrameConfig, SurveyConfig):
    """What to write, and where."""

    stage: ClassVar[str] = SurveyConfig.stage


@dataclass(frozen=True)
class RecorderConfig(StageConfig):
    """What is recorded, and where."""

    stage: ClassVar[str] = "recorder"

    topics: tuple[str, ...] = fixed(
        RECORDED,
        "Topics to record; as they are called here, or any other topic by its own name.",
        advanced=True,
    )
    output: str = fixed("", "Folder for the bag, which must not be there.", advanced=True)


#: What a node's configs have beside those of its stage: parameters that only nodes know.
_OF_NODES: dict[str, type[StageConfig]] = {
    "ground_filter": GroundFilterNodeConfig,
    "footprints": FootprintNodeConfig,
}
#: Node → configs beside those of its stage: what stands in footprints is labelled by the tracer.
_BESIDE: dict[str, tuple[type[StageConfig], ...]] = {
    "building_tracer": (EdgeLabellingConfig, MapFrameConfig),
    "model_builder": (FlowControlConfig, MapFrameConfig),
}
#: Node → stage → config class. A node's parameters carry the stage's name as a prefix where it has several.
NODE_CONFIGS: dict[str, dict[str, type[StageConfig]]] = {
    "tile_player": {TilePlayerConfig.stage: TilePlayerConfig, ScanConfig.stage: ScanConfig},
    "scan_assembler": {ScanAssemblerConfig.stage: ScanAssemblerConfig},
    **{
        stage.node: {name: _OF_NODES.get(name, STAGE_CONFIGS[name]) for name in stage.configs}
        | {config.stage: config for config in (*_BESIDE.get(stage.node, ()), ReplicaConfig)}
        for stage in STAGE_TABLE
    },
    "model_writer": {ModelWriterConfig.stage: ModelWriterConfig},
    "recorder": {RecorderConfig.stage: RecorderConfig},
}
