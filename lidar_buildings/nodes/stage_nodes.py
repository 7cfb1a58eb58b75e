"""The nodes of the chain in its order, a stage each: message to arrays, one call, result to messages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PolygonInstanceStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import BuildingOutline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.model.withdrawals import Withdrawals
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.facades.config import FacadesConfig
from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.io.files.reference_systems import model_frame
from lidar_buildings.io.models.cityjson import feature_id, feature_line, header_line
from lidar_buildings.nodes.configs import (
    NODE_CONFIGS,
    FlowControlConfig,
    FootprintNodeConfig,
    GroundFilterNodeConfig,
    MapFrameConfig,
)
from lidar_buildings.nodes.map_frames import FrameListener
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.pipeline.live_models import LiveModels, LiveRoof, live_roofs
from lidar_buildings.pipeline.road_facades import RoadFacades
from lidar_buildings.pipeline.tile_facades import (
    MappedFacades,
    map_road_facades,
    map_tile_facades,
    street_points,
)
from lidar_buildings.pipeline.tile_models import TileModel, build_models
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_stages import (
    FilteredTile,
    LabelledTile,
    filter_ground,
    fit_planes,
    label_roof_edges,
    rasterise_tile,
    roof_points,
    select_roof_points,
)
from lidar_buildings.pipeline.tile_tracing import TracedTile, trace_footprints, trace_or_close
from lidar_buildings.ros.markers import facade_markers, model_markers
from lidar_buildings.ros.point_cloud import from_message, grid_message, to_message
from lidar_buildings.ros.polygons import outline_rings, outlines_of, ring_messages
from lidar_buildings.ros.qos import BUILDING, CLOUD, LATCHED, LATCHED_HISTORY, MAP, MAP_RINGS
from lidar_buildings.ros.stage_node import StageNode, publish_all, reason_of
from lidar_buildings.ros.stamps import header_of
from lidar_buildings.ros.text_messages import (
    Qualities,
    facades_message,
    facades_of,
    qualities_of,
    quality_message,
    tile_closing_message,
    withdrawal_message,
)
from lidar_buildings.ros.tile_table import agree_on_buildings
from lidar_buildings.ros.wall_maps import wall_map_message

Outlines = tuple[BuildingOutline, ...]
#: Places beside a vehicle's way that wait, or are worked on, at most: one takes a tenth of a second.
_MOST_PLACES = 16
#: A roof's model is published anew when so long no new point has come to it [s].
_LIVE = 0.5


class GroundFilter(StageNode):
    """Classifies the ground of each tile; holds one back that cuts off what may be a wide roof."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("ground_filter", NODE_CONFIGS["ground_filter"], **kwargs)
        self._ground_points = self.create_output(PointCloud2, "ground_points", CLOUD)
        self._dtm = None
        if self.parameters[GroundFilterNodeConfig].publish_dtm:
            self._dtm = self.create_publisher(PointCloud2, "dtm", CLOUD)
        self.take_tiles(("points",), self.work, self.publish, clipped=lambda filtered: filtered.clipped)
        self.subscribe_tiles("points")

    def work(self, tile: PointTile) -> Future[FilteredTile]:
        """Classify one tile."""
        return self.submit(filter_ground, tile, self.parameters[GroundFilterNodeConfig])

    def publish(self, stamp: int, filtered: FilteredTile) -> None:
        """Publish one tile's points, and its terrain on request."""
        self.summary.passed_on(len(filtered.tile))
        self._ground_points.publish(to_message(filtered.tile))
        if self._dtm is not None:
            resolution = self.parameters[GroundFilterNodeConfig].dtm_resolution
            rasters = rasterise_tile(filtered.tile, RasterConfig(raster_resolution=resolution), MapFrame())
            self._dtm.publish(grid_message(stamp, rasters.window, rasters.dtm))


class RoofSelector(StageNode):
    """Gives every point its final class."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("roof_selector", NODE_CONFIGS["roof_selector"], **kwargs)
        self._classified_points = self.create_output(PointCloud2, "classified_points", CLOUD)
        self._roof_points = self.create_output(PointCloud2, "roof_points", CLOUD)
        self._street_points = self.create_output(PointCloud2, "street_points", CLOUD)
        self.take_tiles(("ground_points",), self.work, self.publish)
        self.subscribe_tiles("ground_points")

    def work(self, tile: PointTile) -> Future[PointTile]:
        """Classify one tile."""
        return self.submit(select_roof_points, tile, self.parameters[RoofSelectionConfig])

    def publish(self, stamp: int, classified: PointTile) -> None:
        """Publish one tile's points, and its roofs apart."""
        self.summary.passed_on(len(classified))
        self._roof_points.publish(to_message(roof_points(classified)))
        self._street_points.publish(to_message(street_points(classified)))
        self._classified_points.publish(to_message(classified))


class EdgeLabeller(StageNode):
    """Labels the roof points on edges."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("edge_labeller", NODE_CONFIGS["edge_labeller"], **kwargs)
        self._edge_points = self.create_output(PointCloud2, "edge_points", CLOUD)
        self.take_tiles(("roof_points",), self.work, self.publish)
        self.subscribe_tiles("roof_points")

    def work(self, tile: PointTile) -> Future[LabelledTile]:
        """Label one tile."""
        return self.submit(label_roof_edges, tile, self.parameters[EdgeLabellingConfig])

    def publish(self, stamp: int, labelled: LabelledTile) -> dict[str, int]:
        """Publish one tile's points; report how many of its roofs came to which status."""
        self.summary.passed_on(len(labelled.tile))
        self._edge_points.publish(to_message(labelled.tile))
        return {f"roofs_{status}": number for status, number in labelled.n_roofs.items()}


class BuildingTracer(StageNode):
    """Traces the buildings of each tile, or takes given footprints; holds a tile back that cuts one off."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("building_tracer", NODE_CONFIGS["building_tracer"], **kwargs)
        self._building_points = self.create_output(PointCloud2, "building_points", CLOUD)
        self._traced = self.create_output(PolygonInstanceStamped, "traced_outlines", BUILDING)
        self._map: FrameListener | None = None
        topics, work = ("edge_points",), self.trace
        if self.parameters[FootprintNodeConfig].file:
            patience = self.parameters[MapFrameConfig].frame_patience
            self._map = FrameListener(self, lambda _: self.look_again(), patience)
            topics, work = ("edge_points", "classified_points"), self.take_footprints
        self.take_tiles(topics, work, self.publish, clipped=lambda traced: traced.clipped)
        for topic in topics:
            self.subscribe_tiles(topic)

    def is_ready(self) -> str:
        """Footprints are given in coordinates of the map."""
        return "" if self._map is None or self._map.expect() else "map_origin"

    def trace(self, roofs: PointTile) -> Future[TracedTile]:
        """Trace one tile's buildings."""
        segmentation = self.parameters[SegmentationConfig]
        return self.submit_shared(trace_or_close, roofs, segmentation, self.parameters[BoundaryTracingConfig])

    def take_footprints(self, roofs: PointTile, classified: PointTile) -> Future[TracedTile]:
        """Find the points of one tile's footprints."""
        frame = None if self._map is None else self._map.frame
        config, labelling = self.parameters[FootprintNodeConfig], self.parameters[EdgeLabellingConfig]
        return self.submit_here(_footprints, classified, roofs, config, labelling, frame)

    def publish(self, stamp: int, traced: TracedTile) -> None:
        """Publish one tile's buildings."""
        self.summary.passed_on(len(traced.tile))
        self._building_points.publish(to_message(traced.tile))
        publish_all(self._traced, ring_messages(stamp, outline_rings(traced.outlines)))
        self.summary.counts["buildings"] += len(traced.outlines)


def _footprints(
    classified: PointTile,
    roofs: PointTile,
    config: FootprintNodeConfig,
    labelling: EdgeLabellingConfig,
    frame: MapFrame,
) -> TracedTile:
    from lidar_buildings.io.vectors.footprints import FootprintSource, read_footprints  # loads slowly

    given = read_footprints(FootprintSource(Path(config.file), config.layer), frame)
    return trace_footprints(classified, roofs, given.footprints, config, labelling)


class OutlineRegulariser(StageNode):
    """Regularises the outlines of each tile, and withdraws those that a tile has no more."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("outline_regulariser", NODE_CONFIGS["outline_regulariser"], **kwargs)
        self._withdrawals = Withdrawals()
        self._outlines = self.create_output(PolygonInstanceStamped, "outlines", MAP_RINGS)
        self._quality = self.create_output(String, "outline_quality", CLOUD)
        self.take_tiles(("traced_outlines",), self.work, self.publish)
        self.subscribe_rings("traced_outlines", outlines_of)

    def work(self, traced: Outlines) -> Future[Outlines]:
        """Regularise one tile's outlines."""
        return self.submit_shared(regularise_outlines, traced, self.parameters[RegularisationConfig])

    def publish(self, stamp: int, outlines: Outlines) -> None:
        """Publish one tile's outlines and how well they fit."""
        gone = self._withdrawals.of(stamp, (one.building_id for one in outlines))
        self._quality.publish(quality_message(stamp, outlines))
        publish_all(
            self._outlines, ring_messages(stamp, {**dict.fromkeys(gone, ()), **outline_rings(outlines)})
        )
        self.summary.passed_on(0)
        self.summary.count_buildings(one.quality.status.value for one in outlines)


class FacadeFinder(StageNode):
    """Finds the façades that were seen from the street, and withdraws those that a tile has no more."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("facade_finder", NODE_CONFIGS["facade_finder"], **kwargs)
        self._withdrawals = Withdrawals()
        self._records = self.create_output(String, "facade_records", CLOUD)
        self._facades = self.create_publisher(PolygonInstanceStamped, "facades", MAP_RINGS)
        self._markers = self.create_publisher(MarkerArray, "facade_markers", MAP)
        self._maps = self.create_publisher(OccupancyGrid, "wall_map", MAP)
        self.take_tiles(("street_points", "outlines"), self.work, self.publish)
        self.subscribe_rings("outlines", outlines_of)
        self.subscribe_tiles("street_points")
        self._of_road = RoadFacades()
        self._n_places = 0  # that wait or are in hand
        self.create_subscription(PointCloud2, "road_points", self.on_road, CLOUD)

    def on_road(self, message: PointCloud2) -> None:
        """Find the façades of what a vehicle has just seen, unless too many places wait."""
        if self._n_places >= _MOST_PLACES:
            self.summary.counts["places_skipped"] += 1
            return
        place = from_message(message).tile
        self._n_places += 1
        # not in the pool: there it would wait for whole tiles
        work = self.submit_here(map_road_facades, place, self.parameters[FacadesConfig])
        self.when_done(work, partial(self._publish_road, place))

    def _publish_road(self, place: PointTile, work: Future[MappedFacades]) -> None:
        self._n_places -= 1
        if work.cancelled():
            return
        if (error := work.exception()) is not None:
            self.warn(f"place {place.stamp}: {reason_of(error)}: its façades come with its tile")
            return
        found = work.result()
        ids = {one.facade_id for one in found.facades if one.is_core}
        gone = self._of_road.replaced_at(place.points[place.is_core], ids)
        self._of_road.add(self._show(place.stamp, found, gone))

    def work(self, tile: PointTile, outlines: Outlines) -> Future[MappedFacades]:
        """Find one tile's façades."""
        return self.submit(map_tile_facades, tile, outlines, self.parameters[FacadesConfig])

    def publish(self, stamp: int, found: MappedFacades) -> None:
        """Publish one tile's façades, and their map."""
        self._records.publish(facades_message(stamp, found.facades))
        ids = {one.facade_id for one in found.facades if one.is_core}
        gone = {*self._withdrawals.of(stamp, ids), *self._of_road.replaced(found, ids)}
        self.summary.counts["facades"] += len(self._show(stamp, found, sorted(gone)))
        self.summary.passed_on(0)

    def _show(self, stamp: int, found: MappedFacades, gone: Sequence[int] = ()) -> tuple[Facade, ...]:
        """Publish façades of the core, and their map; withdraw what is gone."""
        facades = tuple(one for one in found.facades if one.is_core)
        rings = {one.facade_id: (one.ring,) for one in facades}
        publish_all(self._facades, ring_messages(stamp, {**dict.fromkeys(gone, ()), **rings}))
        shown = facade_markers(stamp, facades, gone)
        if shown.markers:  # late viewers get the last messages
            self._markers.publish(shown)
        if found.wall_map is not None:
            self._maps.publish(wall_map_message(stamp, found.wall_map))
        return facades


class PlaneFitter(StageNode):
    """Finds the planes of each building's roof."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("plane_fitter", NODE_CONFIGS["plane_fitter"], **kwargs)
        self._plane_points = self.create_output(PointCloud2, "plane_points", CLOUD)
        self.take_tiles(("building_points",), self.work, self.publish)
        self.subscribe_tiles("building_points")

    def work(self, tile: PointTile) -> Future[PointTile]:
        """Fit the planes of one tile's buildings."""
        return self.submit_shared(fit_planes, tile, self.parameters[PlaneFittingConfig])

    def publish(self, stamp: int, planes: PointTile) -> None:
        """Publish one tile's points with their planes."""
        self.summary.passed_on(len(planes))
        self._plane_points.publish(to_message(planes))


def _models(
    facades: tuple[Facade, ...],
    is_live: bool,
    points: PointTile,
    outlines: Outlines,
    config: BuildingModelConfig,
    pool: BuildingPool | None = None,
) -> tuple[tuple[TileModel, ...], list[LiveRoof]]:
    models = build_models(points, outlines, config, pool, facades=facades)
    return models, live_roofs(points, outlines, models) if is_live else []


def _markers_of(stamp: int, models: Sequence[TileModel], gone: Sequence[int] = ()) -> MarkerArray:
    solids = {one.building_id: one.model.solids.values() for one in models}
    return model_markers(
        stamp, solids, gone, {one.building_id: one.attributes.get("corner_sigma_xy") for one in models}
    )


class ModelBuilder(StageNode):
    """Builds the models of each tile's buildings, and withdraws those that a tile has no more."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("model_builder", NODE_CONFIGS["model_builder"], **kwargs)
        # one topic, two durabilities: each kind of subscription is meant to match its own publisher
        self._header = self.create_publisher(String, "city_model", LATCHED)
        self._features = self.create_output(String, "city_model", BUILDING)
        self._roof_faces = self.create_publisher(PolygonInstanceStamped, "roof_faces", MAP_RINGS)
        self._markers = self.create_publisher(MarkerArray, "building_markers", MAP)
        self._tile_done = None
        if self.parameters[FlowControlConfig].publish_tile_done:
            self._tile_done = self.create_publisher(Header, "tile_done", LATCHED_HISTORY)
        self._frame = MapFrame()
        self._names, self._numbers = Withdrawals(), Withdrawals()
        self._map = FrameListener(self, self.on_frame, self.parameters[MapFrameConfig].frame_patience)
        topics = ("plane_points", "outlines", "outline_quality", "facade_records")
        self.take_tiles(topics, self.work, self.publish, agree_on_buildings)
        self._live = LiveModels()
        self.create_subscription(PointCloud2, "newer_points", self.on_newer, CLOUD)
        self.create_timer(_LIVE, self._publish_live)
        self.create_subscription(String, "outline_quality", self.on_quality, CLOUD)
        self.create_subscription(String, "facade_records", self.on_facades, CLOUD)
        self.subscribe_rings("outlines", outlines_of)
        self.subscribe_tiles("plane_points")

    def is_ready(self) -> str:
        """Models are written in coordinates of the map."""
        return "" if self._map.expect() else "map_origin"

    def on_frame(self, frame: MapFrame) -> None:
        """Publish the header, and build the tiles that came before."""
        self._frame = model_frame(frame)
        self._header.publish(String(data=header_line(self._frame)))
        self.look_again()

    def on_quality(self, message: String) -> None:
        """Take how well a tile's outlines fit."""
        stamp, qualities = qualities_of(message)
        self.add_part(stamp, "outline_quality", qualities)

    def on_facades(self, message: String) -> None:
        """Take a tile's façades."""
        stamp, facades = facades_of(message)
        self.add_part(stamp, "facade_records", facades)

    def work(
        self, points: PointTile, outlines: Outlines, qualities: Qualities, facades: tuple[Facade, ...]
    ) -> Future[tuple[tuple[TileModel, ...], list[LiveRoof]]]:
        """Build one tile's models, and have sums of their points if more may come."""
        outlines = tuple(replace(one, quality=qualities.get(one.building_id)) for one in outlines)
        config, is_live = self.parameters[BuildingModelConfig], self.count_publishers("newer_points") > 0
        return self.submit_shared(partial(_models, facades, is_live), points, outlines, config)

    def on_newer(self, message: PointCloud2) -> None:
        """Add points to the sums of the roofs that they are on."""
        self._live.add(from_message(message).tile.points)

    def _publish_live(self) -> None:
        """Publish models anew that points have come to, once no more come."""
        for stamp, one in self._live.solved():
            line = feature_line(one.model, one.building_id, self._frame, one.attributes, anchor=one.anchor)
            self._features.publish(String(data=line))
            self._markers.publish(_markers_of(stamp, [one]))
            self.summary.counts["provisional_models"] += 1

    def publish(self, stamp: int, built: tuple[Sequence[TileModel], list[LiveRoof]]) -> None:
        """Publish one tile's models."""
        models, roofs = built
        self._live.replace(stamp, roofs)
        publish_all(self._features, self._feature_messages(stamp, models))
        faces = {one.building_id: tuple(chain.from_iterable(one.model.roof_faces)) for one in models}
        rings = {number: of_building for number, of_building in faces.items() if of_building}
        publish_all(self._roof_faces, ring_messages(stamp, rings))
        shown = _markers_of(stamp, models, self._numbers.of(stamp, [one.building_id for one in models]))
        if shown.markers:  # late viewers get the last messages
            self._markers.publish(shown)
        self.summary.passed_on(0)
        self.summary.count_buildings(one.attributes["status"] for one in models)
        if self._tile_done is not None:
            self._tile_done.publish(header_of(stamp))
            self.n_reported += 1

    def _feature_messages(self, stamp: int, models: Sequence[TileModel]) -> Iterator[String]:
        """Yield a tile's models, then the names of those that it has no more, then that this is all."""
        names, frame = [], self._frame
        for one in models:
            line = feature_line(one.model, one.building_id, frame, one.attributes, anchor=one.anchor)
            names.append(feature_id(one.anchor, frame))
            yield String(data=line)
        yield from map(withdrawal_message, self._names.of(stamp, names))
        yield tile_closing_message(stamp)
