"""Outlines from the street: virtual scenes as a vehicle's scanner sees them, against their exact truth."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import shapely

from bench.common.plotting import plt
from bench.common.tables import table
from bench.outlines.pictures import draw_rings
from lidar_buildings.core.model.classes import FacadeClass, PointClass
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.reconstruct import TileResult, reconstruct_tile
from lidar_buildings.simulation import make_scene
from lidar_buildings.simulation.live import Scan, VehicleConfig, drive

SCENES = ("village", "dense_block")
#: Pulses a second.
RATE = 100_000.0
#: A building is whole if so much of it is covered, and no more beyond it, as shares of its area.
COVERED, BEYOND = 0.9, 0.1
HEADINGS = ("scene", "seed", "points", "buildings", "outlines", "whole", "IoU of all")
#: What is drawn of the points: colour → which.
_COLOURS = {
    "0.75": lambda tile: tile.classification == PointClass.GROUND,
    "tab:green": lambda tile: np.isin(tile.classification, (3, 4, 5)),
    "tab:blue": lambda tile: tile.is_roof,
    "tab:orange": lambda tile: tile.facade == FacadeClass.BELOW_ROOF,
    "tab:red": lambda tile: tile.facade == FacadeClass.BARE,
}


class Street(NamedTuple):
    """A drive through a scene and what came of it."""

    name: str
    seed: int
    truth: list[shapely.Polygon]
    result: TileResult

    @property
    def outlines(self) -> list[shapely.Polygon]:
        """All outlines [m]."""
        return [one.outline.polygon for one in self.result.outlines]

    def cells(self) -> list[str]:
        """Return the figures in the order of `HEADINGS`."""
        found, truth = shapely.union_all(self.outlines), shapely.union_all(self.truth)
        whole = 0
        for building in self.truth:
            own = shapely.union_all([one for one in self.outlines if one.intersects(building)])
            covered, beyond = own.intersection(building).area, own.difference(truth).area
            whole += covered >= COVERED * building.area and beyond <= BEYOND * building.area
        iou = found.intersection(truth).area / found.union(truth).area
        counts = (len(self.result.classified), len(self.truth), len(self.outlines), whole)
        return [self.name, str(self.seed), *(f"{n:,}" for n in counts), f"{iou:.3f}"]


def drive_through(name: str, seed: int, configs: PipelineConfig, rate: float = RATE) -> Street:
    """Drive through a scene, and take its points, placed exactly, through the chain as one tile."""
    scene = make_scene(name, seed)
    survey = drive(scene, seed, VehicleConfig(pulse_rate=rate))
    scans = [event.truth for event in survey.events() if isinstance(event, Scan)]
    points = np.concatenate([scan.points for scan in scans])
    tile = PointTile(points=points, intensity=np.concatenate([scan.intensity for scan in scans]))
    tile = tile.with_columns(point_spacing=measure_spacing(tile.points))
    return Street(name, seed, [one.polygon for one in scene.buildings], reconstruct_tile(tile, configs))


def streets_table(streets: Iterable[Street]) -> str:
    """Return a line per drive."""
    return table(HEADINGS, (street.cells() for street in streets))


def draw_street(street: Street, size: float = 12.0) -> plt.Figure:
    """Draw points by class and façade, the truth (black) and the outlines (magenta)."""
    tile, rows = street.result.classified, np.arange(0, len(street.result.classified), 7)
    figure, axes = plt.subplots(figsize=(size, size), dpi=80, layout="constrained")
    for colour, of in _COLOURS.items():
        xy = tile.points[rows[of(tile)[rows]], :2]
        axes.plot(*xy.T, ",", color=colour)
    draw_rings(axes, street.truth, color="black", linewidth=0.8)
    draw_rings(axes, street.outlines, color="magenta", linewidth=1.4)
    axes.set_aspect("equal")
    axes.axis("off")
    return figure
