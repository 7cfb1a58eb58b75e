"""Draw the picture of the page on boundary tracing, from synthetic points."""

import sys
from pathlib import Path

import numpy as np

from bench.pages.drawing import plt, save
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.stages.boundary_tracing.tracing import trace_boundary

#: Spacing of the scattered points [m].
SPACING = 0.5


def main(picture: Path) -> None:
    """Draw the window, a courtyard, cures, and places that are no courtyards."""
    figure, axes = plt.subplots(2, 3, figsize=(13.0, 8.4), dpi=80, layout="constrained")
    draw_window(axes[0, 0])
    yard = without(scattered(20, 16), (7, 5, 14, 11))
    draw(axes[0, 1], yard, "a courtyard is a hole with a rim of its own")
    island = np.vstack([yard, scattered(1.5, 1.5, at=(8.2, 7.2), seed=4)])
    draw(axes[0, 2], island, "points in a courtyard are joined to its rim")
    blocks = np.vstack([scattered(8, 8), [[9.1, 4.0]], scattered(8, 8, at=(10.2, 0.0), seed=1)])
    draw(axes[1, 0], blocks, "two blocks joined by one point: wider windows there only")
    gappy = without(scattered(20, 16), (3, 7.6, 21, 8.7))
    draw(axes[1, 1], gappy, "a strip without returns")
    draw(axes[1, 2], rim_only(), "a wet roof with returns along its rim: filled")
    save(figure, picture, 48)


def draw(axes, xy, title, pattern=None) -> None:
    """Draw points and their outline."""
    points = np.column_stack([xy, np.zeros(len(xy))])
    traced = trace_boundary(points, pattern=pattern, point_spacing=None if pattern else SPACING)
    axes.plot(*xy.T, ".", color="#8d95a3", markersize=2.5)
    for ring in traced.outline.rings:
        axes.plot(*np.vstack([ring, ring[:1]]).T, "-", color="#c8472f", linewidth=1.2)
    axes.set_title(title, fontsize=9)
    axes.set_aspect("equal")
    axes.axis("off")


def draw_window(axes) -> None:
    """Draw a scan with lines, its ring, and the window at one of its points."""
    pattern = ScanPattern(np.deg2rad(25.0), 0.3, 0.9)
    u, v = np.meshgrid(np.arange(0, 20, pattern.along), np.arange(0, 14, pattern.across))
    uv = np.column_stack([u.ravel(), v.ravel()])
    uv += np.random.default_rng(0).uniform(-0.1, 0.1, uv.shape)
    uv = without(uv, (8, 7, 11, 15))
    cosine, sine = np.cos(pattern.direction), np.sin(pattern.direction)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    draw(axes, uv @ turn, "the window lies along the scan lines", pattern)
    sides = 0.5 * 5.0 * np.array([pattern.along, pattern.across])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * sides
    axes.plot(*((corners + uv[np.argmax(uv[:, 0] - uv[:, 1])]) @ turn).T, "-", color="#2f5f9f", linewidth=1.5)


def scattered(width, height, at=(0.0, 0.0), seed=0):
    """Return jittered points over a rectangle."""
    x, y = np.meshgrid(np.arange(0, width, SPACING), np.arange(0, height, SPACING))
    xy = np.column_stack([x.ravel(), y.ravel()])
    return xy + np.random.default_rng(seed).uniform(-0.2, 0.2, xy.shape) + at


def without(xy, box):
    """Leave out the points in a box (west, south, east, north)."""
    return xy[~((xy >= box[:2]) & (xy <= box[2:])).all(axis=1)]


def rim_only():
    """Return two rows of points along the edge of a roof."""
    return without(scattered(20, 16), (0.75, 0.75, 18.75, 14.75))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
