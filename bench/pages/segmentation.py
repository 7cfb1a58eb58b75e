"""Draw the picture of the page on segmentation, from synthetic roofs."""

import sys
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import connected_components

from bench.pages.drawing import plt, save
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.core.stages.segmentation.segmentation import segment_buildings

COLOURS = ("#2f5f9f", "#c8472f", "#4f8a47", "#b58a2c", "#7a4f9a", "#3a9a9a", "#9a3a6a", "#6b6f7a")
NONE = "#9a9ea8"
#: Every cluster is a building.
KEEP_ALL = SegmentationConfig(min_points=1, min_area=0.0)


def main(picture: Path) -> None:
    """Draw the window along the lines, a square one, steps, necks and two known failures."""
    figure, axes = plt.subplots(2, 3, figsize=(13.5, 8.6), dpi=80, layout="constrained")
    draw_lines(axes[0, 0], axes[0, 1])
    draw_steps(axes[0, 2], axes[1, 0])
    draw_necks(axes[1, 1])
    draw_slanting_step(axes[1, 2])
    save(figure, picture, 64)


def lattice(west: float, south: float, east: float, north: float, step: float = 0.5, seed: int = 0):
    """Return a jittered lattice of points in plan."""
    x, y = np.meshgrid(np.arange(west, east, step), np.arange(south, north, step))
    xy = np.column_stack((x.ravel(), y.ravel()))
    return xy + np.random.default_rng(seed).uniform(0, 0.4 * step, xy.shape)


def raised(xy: np.ndarray, elevation: float, slope: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Put points in plan on a plane."""
    return np.column_stack((xy, elevation + xy @ np.array(slope)))


def draw(axes: plt.Axes, points: np.ndarray, building_id: np.ndarray, title: str) -> None:
    """Draw points in the colours of their buildings, grey where they are of none."""
    numbers = [number for number in np.unique(building_id) if number]
    axes.scatter(*points[building_id == 0, :2].T, s=7, color=NONE, linewidths=0)
    for k, number in enumerate(numbers):
        rows = building_id == number
        axes.scatter(*points[rows, :2].T, s=7, color=COLOURS[k % len(COLOURS)], linewidths=0)
    axes.set(aspect="equal", title=f"{title}: {len(numbers)}")


def draw_window(axes: plt.Axes, centre: np.ndarray, pattern: ScanPattern, window: float) -> None:
    """Draw the window about a point."""
    cos, sin = np.cos(pattern.direction), np.sin(pattern.direction)
    u, v = window * pattern.along / 2, window * pattern.across / 2
    corners = np.array([[-u, -v], [u, -v], [u, v], [-u, v]]) @ np.array([[cos, sin], [-sin, cos]])
    axes.add_patch(plt.Polygon(centre[:2] + corners, fill=False, edgecolor="black", linewidth=1.6, zorder=4))


def draw_lines(turned: plt.Axes, square: plt.Axes) -> None:
    """Draw two houses scanned in lines far apart: with the window along the lines, and with a square one."""
    u, v = np.meshgrid(np.arange(-12, 12, 0.08), np.arange(-12, 12, 1.0))
    cos, sin = np.cos(0.5), np.sin(0.5)
    xy = np.column_stack((u.ravel(), v.ravel())) @ np.array([[cos, sin], [-sin, cos]])
    xy += np.random.default_rng(0).normal(0, 0.01, xy.shape)
    inside = (np.abs(xy[:, 1]) < 4.5) & (
        ((xy[:, 0] > -7) & (xy[:, 0] < 0)) | ((xy[:, 0] > 1.4) & (xy[:, 0] < 7))
    )
    points = raised(xy[inside], 5.0)
    spacing = float(np.sqrt(0.08))
    found = segment_buildings(points, KEEP_ALL, point_spacing=spacing)
    draw(turned, points, found.building_id, "window along the scan lines; buildings")
    pattern = next(iter(found.patterns.values()))
    middle = points[np.argmin(np.hypot(*(points[:, :2] - np.array([-3.5, 0.0])).T))]
    draw_window(turned, middle, pattern, KEEP_ALL.window)
    # The same points and a window of the same area, but square: scan lines are chained one by one.
    half = KEEP_ALL.window * spacing / 2
    near = (np.abs(points[:, None, :2] - points[None, :, :2]) <= half).all(axis=2)
    draw(square, points, connected_components(near)[1] + 1, "square window of the same area; pieces")
    draw_window(square, middle, ScanPattern.isotropic(spacing), KEEP_ALL.window)


def draw_steps(split: plt.Axes, steep: plt.Axes) -> None:
    """Draw a row of houses split at their steps, and roofs with dormer and chimney that are not."""
    heights = (5.0, 8.0, 6.5, 10.0)
    row = [raised(lattice(6 * k, 0, 6 * k + 6, 10, seed=k), z) for k, z in enumerate(heights)]
    points = np.vstack(row)
    config = SegmentationConfig(split_at_steps=True)
    draw(split, points, segment_buildings(points, config).building_id, "split_at_steps; buildings")
    for k, z in enumerate(heights):
        box = {"color": "white", "alpha": 0.8}
        split.text(6 * k + 3, 5, f"{z:g} m", ha="center", va="center", fontsize=11, bbox=box)
    xy = lattice(0, 0, 16, 12)
    z = 8.0 - 1.2 * np.abs(xy[:, 1] - 6.0)
    dormer = (np.abs(xy[:, 0] - 4) < 1.5) & (xy[:, 1] > 1) & (xy[:, 1] < 4)
    chimney = (np.abs(xy - (11.0, 7.0)) < 0.7).all(axis=1)
    z = np.where(dormer, 6.5, np.where(chimney, 10.0, z))
    points = np.column_stack((xy, z))
    draw(
        steep, points, segment_buildings(points, config).building_id, "steep roof, dormer, chimney; buildings"
    )
    for place, name in (((4, 2.5), "dormer"), ((11, 7), "chimney")):
        steep.text(*place, name, ha="center", va="center", fontsize=9, bbox={"color": "white", "alpha": 0.7})


def draw_necks(axes: plt.Axes) -> None:
    """Draw two roofs joined by a row of single points, cut."""
    neck = np.column_stack((np.arange(8.0, 13.0, 0.5), np.full(10, 4.0)))
    points = raised(np.vstack((lattice(0, 0, 8, 8), lattice(13, 0, 21, 8), neck)), 5.0)
    found = segment_buildings(points).building_id
    draw(axes, points, found, "a neck (min_neck 0: one building); buildings")


def draw_slanting_step(axes: plt.Axes) -> None:
    """Draw a step that runs out to nothing: it parts nothing."""
    low, high = lattice(0, 0, 8, 10), lattice(8, 0, 16, 10, seed=1)
    points = np.vstack((raised(low, 5.0), raised(high, 5.0, (0.0, 0.4))))
    found = segment_buildings(points, SegmentationConfig(split_at_steps=True)).building_id
    draw(axes, points, found, "fails: a step of 0 to 4 m; buildings")
    axes.text(8, 0.8, "0 m", ha="center", fontsize=11, bbox={"color": "white", "alpha": 0.8})
    axes.text(8, 8.8, "4 m", ha="center", fontsize=11, bbox={"color": "white", "alpha": 0.8})


if __name__ == "__main__":
    main(Path(sys.argv[1]))
