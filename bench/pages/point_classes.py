"""Draw the picture of the page on point classes, from the simulated village."""

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb

from bench.pages.drawing import plt, save
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.surfaces.intensity import brightness_raster, normalised_intensity, strip_scales
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig
from lidar_buildings.pipeline.tile_stages import filter_ground, select_roof_points
from lidar_buildings.simulation import simulate_survey

#: ASPRS class → (what it is, colour).
CLASSES = {
    1: ("undecided", "#6f7f9a"),
    2: ("ground", "#d9cdb4"),
    3: ("low vegetation", "#dbe8a8"),
    4: ("medium vegetation", "#b5c95a"),
    5: ("high vegetation", "#4f8a47"),
    6: ("roof", "#d9705a"),
    11: ("road", "#2f5f9f"),
}
#: What every second strip records: gain and offset of a sensor with 16 bits.
GAIN, OFFSET = 40.0, 6000.0
#: A field that was ploughed: west, south, east, north [m], and how bright it is beside grass.
FIELD, FIELD_BRIGHTNESS = (6.0, 6.0, 60.0, 56.0), 0.4


def main(picture: Path) -> None:
    """Draw recorded and normalised intensities, their histogram, and the classes with one known failure."""
    tile = with_strips_and_field(village())
    result = select_roof_points(filter_ground(tile, GroundFilterConfig()).tile, RoofSelectionConfig())
    is_ground = np.isin(result.classification, (2, 11))
    is_only = result.number_of_returns <= 1
    scales = strip_scales(tile.intensity, tile.point_source_id, is_only)
    normalised = normalised_intensity(tile.intensity, tile.point_source_id, scales)
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 10.4), dpi=90, layout="constrained")
    draw_brightness(axes[0, 0], tile.points[is_ground], tile.intensity[is_ground], "intensity as recorded")
    draw_brightness(axes[0, 1], tile.points[is_ground], normalised[is_ground], "normalised intensity")
    draw_modes(axes[1, 0], result, normalised, is_ground, is_only)
    draw_classes(axes[1, 1], result)
    save(figure, picture)


def village() -> PointTile:
    """Return the village as one tile, without what was measured of the survey."""
    with tempfile.TemporaryDirectory() as folder:
        simulate_survey(folder, "village", density=4.0)
        with TileSource(folder, TilingConfig(buffer=0.0)) as source:
            tiles = [tile.read() for tile in source.ready()]
    names = ("intensity", "return_number", "number_of_returns", "point_source_id")
    columns = {name: np.concatenate([getattr(tile, name) for tile in tiles]) for name in names}
    points = np.concatenate([tile.points for tile in tiles])
    return PointTile(points, point_spacing=tiles[0].point_spacing, **columns)


def with_strips_and_field(tile: PointTile) -> PointTile:
    """Give every second strip another sensor, and darken a field."""
    x, y, _ = (tile.points - tile.points.min(axis=0)).T
    west, south, east, north = FIELD
    field = (x > west) & (x < east) & (y > south) & (y < north)
    intensity = np.where(field, FIELD_BRIGHTNESS * tile.intensity, tile.intensity)
    second = tile.point_source_id % 2 == 0
    return tile.with_columns(intensity=np.where(second, OFFSET + GAIN * intensity, intensity))


def draw_brightness(axes: plt.Axes, points: np.ndarray, values: np.ndarray, title: str) -> None:
    """Draw the ground in shades of grey."""
    low, high = np.percentile(values, [1, 98])
    axes.scatter(points[:, 0], points[:, 1], c=values, s=0.8, lw=0, cmap="gray", vmin=low, vmax=high)
    finish(axes, f"Ground: {title}")


def draw_modes(
    axes: plt.Axes, tile: PointTile, normalised: np.ndarray, is_ground: np.ndarray, is_only: np.ndarray
) -> None:
    """Draw the histogram of the ground's brightness and the limit found in it."""
    leaves = tile.points[tile.classification == 5]
    raster = brightness_raster(
        tile.points[is_ground], normalised[is_ground], is_only[is_ground], tile.point_spacing, leaves
    )
    limit = raster.dark_limit()
    axes.hist(raster.brightness[raster.is_known], np.arange(0, 256, 4), color="#9a8f7a")
    axes.axvline(limit, color="#2f5f9f", lw=2)
    axes.annotate(f"limit {limit:.0f}", (limit, 0.9), (4, 0), xycoords=("data", "axes fraction"),
                  textcoords="offset points", color="#2f5f9f")  # fmt: skip
    axes.set(xlabel="normalised intensity", ylabel="cells", title="The two modes of the ground")


def draw_classes(axes: plt.Axes, tile: PointTile) -> None:
    """Draw the final classes from above, high points last."""
    order = np.argsort(tile.height_above_ground, kind="stable")
    points, classes = tile.points[order], tile.classification[order]
    colours = np.full((256, 3), 1.0)
    for number, (name, colour) in CLASSES.items():
        colours[number] = to_rgb(colour)
        if (classes == number).any():
            axes.scatter([], [], color=colour, s=20, label=name)
    axes.scatter(points[:, 0], points[:, 1], c=colours[classes], s=0.8, lw=0)
    west, _, east, north = FIELD
    corner = tile.points.min(axis=0)
    axes.annotate("ploughed field,\nas dark as asphalt", (corner[0] + (west + east) / 2, corner[1] + north),
                  (0, 10), textcoords="offset points", ha="center")  # fmt: skip
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncol=6, fontsize=7, columnspacing=0.8)
    finish(axes, "Classes")


def finish(axes: plt.Axes, title: str) -> None:
    """Leave the map alone with its title."""
    axes.set(title=title, aspect="equal", xticks=[], yticks=[])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
