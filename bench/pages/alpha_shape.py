"""Draw the picture of the page on alpha shapes, from synthetic roofs."""

import sys
from pathlib import Path

import numpy as np
import shapely
from matplotlib.collections import LineCollection

from bench.pages.drawing import plt, save
from lidar_buildings.core.surfaces.alpha_shape import AlphaShape, alpha_shape

#: Spacing of the points, and the paper's radius for it [m].
SPACING, ALPHA = 0.5, 0.67
AREA, EDGE, INNER, LONE = "#e3dccb", "#2f5f9f", "#9a9ea8", "#c8472f"


def main(picture: Path) -> None:
    """Draw what an alpha shape is, what the regularised one leaves out, and two known failures."""
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.4), dpi=80, layout="constrained")
    house, courtyard = shapely.box(0, 0, 14, 10), shapely.box(5, 3.5, 9, 7)
    points = scanned(house.difference(courtyard), 0)
    shape = alpha_shape(points, ALPHA)
    draw_shape(axes[0, 0], shape, "points and edges that an empty disc touches")
    draw_discs(axes[0, 0], shape, 9)
    draw_regularised(axes[0, 1])
    draw_sparse_strip(axes[1, 0])
    draw_step(axes[1, 1])
    handles = [
        plt.Line2D([], [], marker="o", linestyle="", color=colour, label=text)
        for text, colour in (
            ("on the shape", EDGE),
            ("not on it", INNER),
            ("on it, but not at the rim", LONE),
        )
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    save(figure, picture, 64)


def scanned(roof: shapely.Geometry, seed: int, spacing: float = SPACING) -> np.ndarray:
    """Return a jittered lattice of points in plan on a roof."""
    west, south, east, north = roof.bounds
    x, y = np.meshgrid(np.arange(west, east, spacing), np.arange(south, north, spacing))
    xy = np.column_stack((x.ravel(), y.ravel()))
    xy += np.random.default_rng(seed).uniform(0, 0.45 * spacing, xy.shape)
    return xy[shapely.contains_xy(roof, *xy.T)]


def draw_shape(axes: plt.Axes, shape: AlphaShape, title: str, wrong: np.ndarray | None = None) -> None:
    """Draw area, edges and points; those that are wrongly on the shape in red."""
    for polygon in shape.polygons:
        axes.add_patch(plt.Polygon(shapely.get_coordinates(polygon.exterior), color=AREA, zorder=0))
        for hole in polygon.interiors:
            axes.add_patch(plt.Polygon(shapely.get_coordinates(hole), color="white", zorder=1))
    axes.add_collection(LineCollection(shape.points[shape.edges], colors=EDGE, linewidths=1.0, zorder=2))
    wrong = np.zeros(len(shape.points), dtype=bool) if wrong is None else wrong
    for rows, colour in (
        (~shape.is_boundary, INNER),
        (shape.is_boundary & ~wrong, EDGE),
        (shape.is_boundary & wrong, LONE),
    ):
        axes.scatter(*shape.points[rows].T, s=9, color=colour, linewidths=0, zorder=3)
    axes.set(aspect="equal", title=title)


def draw_discs(axes: plt.Axes, shape: AlphaShape, every: int) -> None:
    """Draw discs of the radius alpha that touch the ends of some edges from outside."""
    for start, end in shape.points[shape.edges[::every]]:
        way = end - start
        length = np.hypot(*way)
        outside = np.array([way[1], -way[0]]) / length
        centre = (start + end) / 2 + outside * np.sqrt(ALPHA**2 - length**2 / 4)
        axes.add_patch(plt.Circle(centre, ALPHA, fill=False, color="#4f8a47", linewidth=1.0, zorder=4))
    axes.autoscale_view()


def draw_regularised(axes: plt.Axes) -> None:
    """Draw what is on the general shape and not on the regularised one."""
    roof = scanned(shapely.box(0, 0, 9, 8), 1)
    pipe = np.column_stack((np.arange(9.6, 14.0, 0.5), 2.0 + 0.1 * np.arange(9)))
    strays = np.array([[11.0, 6.0], [13.0, 6.6], [13.3, 7.2]])
    points = np.vstack((roof, pipe, strays))
    regular = alpha_shape(points, ALPHA, regularised=True)
    general = alpha_shape(points, ALPHA)
    title = "in red: on the general shape, not on the regularised one"
    draw_shape(axes, general, title, ~regular.is_boundary)


def draw_sparse_strip(axes: plt.Axes) -> None:
    """
    Draw a roof of which one strip is scanned at a third of the density: the disc falls between its points.
    """
    dense = scanned(shapely.box(0, 0, 9, 9), 2)
    sparse = scanned(shapely.box(9, 0, 15, 9), 3, SPACING * 1.75)
    points = np.vstack((dense, sparse))
    inside = shapely.distance(shapely.box(0, 0, 15, 9).exterior, shapely.points(points)) > 1.75 * SPACING
    draw_shape(axes, alpha_shape(points, ALPHA), "fails: a strip at a third of the density", inside)


def draw_step(axes: plt.Axes) -> None:
    """Draw two roofs at different heights that touch: in plan there is no edge between them."""
    low, high = scanned(shapely.box(0, 0, 7, 9), 4), scanned(shapely.box(7.1, 0, 15, 9), 5)
    shape = alpha_shape(np.vstack((low, high)), ALPHA)
    draw_shape(axes, shape, "fails: no edge where roofs of different height touch")
    axes.text(3.5, 4.5, "6 m", ha="center", va="center", fontsize=13, bbox={"color": "white", "alpha": 0.8})
    axes.text(11.0, 4.5, "9 m", ha="center", va="center", fontsize=13, bbox={"color": "white", "alpha": 0.8})
    axes.axvline(7.05, color=LONE, linestyle="--", linewidth=1.0)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
