"""
Draw building models without a display: a small rasteriser with a depth buffer, for the gallery's pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mapbox_earcut
import numpy as np
from numba import njit

from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, Solid

#: Drawn this much larger in each direction and then reduced, which smooths edges.
OVERSAMPLING = 2
#: Roofs by the direction in which they fall (level, north, east, south, west), walls, ground, edges, paper.
ROOFS = np.array([(205, 120, 92), (176, 84, 70), (198, 96, 66), (214, 122, 86), (168, 74, 62)]) / 255
WALL, GROUND = np.array((236, 230, 218)) / 255, np.array((120, 130, 110)) / 255
EDGE, PAPER = np.array((38, 36, 52)) / 255, np.array((255, 255, 255)) / 255
#: Where the light comes from, and how bright the darkest face is.
LIGHT, SHADE = np.array([-0.45, -0.55, 0.70]), 0.62
#: Edges are drawn this much nearer than they are, so that their own faces do not hide them [m].
EDGE_LIFT = 0.08
#: A roof is level if it falls by less than this share of its length.
LEVEL = 0.05


@dataclass(frozen=True)
class View:
    """
    From where models are looked at.

    Attributes
    ----------
    azimuth_deg : float
        Direction of the eye, clockwise from north.
    tilt_deg : float
        Elevation of the eye: 90 is from above.
    width : int
        Of the picture [pixels]; its height follows.
    margin : float
        Around the models [m].
    """

    azimuth_deg: float = 205.0
    tilt_deg: float = 38.0
    width: int = 900
    margin: float = 2.0

    def axes(self) -> np.ndarray:
        """Return the directions to the right, up the picture and to the eye as rows."""
        azimuth, tilt = np.deg2rad([self.azimuth_deg, self.tilt_deg])
        eye = np.array([np.sin(azimuth) * np.cos(tilt), np.cos(azimuth) * np.cos(tilt), np.sin(tilt)])
        right = np.array([-np.cos(azimuth), np.sin(azimuth), 0.0])
        return np.stack([right, np.cross(eye, right), eye])


def draw_solids(
    solids: Sequence[Solid],
    view: View,
    points: np.ndarray | None = None,
    point_colours: np.ndarray | None = None,
) -> np.ndarray:
    """Return a picture of solids, and of points before them, as an array of bytes (height, width, 3)."""
    triangles, colours, edges = _faces_of(solids)
    axes = view.axes()
    shown = [triangles.reshape(-1, 3), np.zeros((0, 3)) if points is None else points]
    corners = np.concatenate(shown) @ axes.T
    low, high = corners.min(axis=0)[:2] - view.margin, corners.max(axis=0)[:2] + view.margin
    scale = OVERSAMPLING * view.width / (high[0] - low[0])
    size = OVERSAMPLING * np.ceil((high - low) * scale / OVERSAMPLING).astype(int)

    def on_screen(places: np.ndarray) -> np.ndarray:
        """Columns, rows and nearness of places."""
        turned = places @ axes.T
        return np.stack(
            [(turned[..., 0] - low[0]) * scale, (high[1] - turned[..., 1]) * scale, turned[..., 2]], axis=-1
        )

    depth = np.full((size[1], size[0]), -np.inf)
    number = np.full(depth.shape, -1)
    _fill(depth, number, on_screen(triangles))
    picture = np.vstack([colours, PAPER])[number]
    _draw_lines(depth, picture, on_screen(edges), EDGE, EDGE_LIFT)
    if points is not None and point_colours is not None:
        _draw_dots(depth, picture, on_screen(points), point_colours, EDGE_LIFT)
    small = picture.reshape(size[1] // OVERSAMPLING, OVERSAMPLING, size[0] // OVERSAMPLING, OVERSAMPLING, 3)
    return np.rint(255 * small.mean(axis=(1, 3))).astype(np.uint8)


def _faces_of(solids: Sequence[Solid]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return triangles (n, 3, 3), the colour of each, and all edges (n, 2, 3)."""
    triangles, colours, edges = [], [], []
    for solid in solids:
        for face, kind in zip(solid.faces, solid.semantics, strict=True):
            rings = solid.face_rings(face)
            normal = _normal(rings[0])
            pieces = _triangles(rings, normal)
            brightness = SHADE + (1 - SHADE) * max(0.0, float(normal @ LIGHT))
            triangles.append(pieces)
            colours.append(np.tile(brightness * _colour(kind, normal), (len(pieces), 1)))
            edges += [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
    return np.concatenate(triangles), np.concatenate(colours), np.concatenate(edges)


def _colour(kind: str, normal: np.ndarray) -> np.ndarray:
    """Return a face's colour in full light."""
    if kind != ROOF_SURFACE:
        return GROUND if kind == GROUND_SURFACE else WALL
    if np.hypot(*normal[:2]) < LEVEL:
        return ROOFS[0]
    quarter = int(np.round(np.degrees(np.arctan2(normal[0], normal[1])) / 90)) % 4
    return ROOFS[1 + quarter]


def _normal(ring: np.ndarray) -> np.ndarray:
    """Return a ring's unit normal."""
    arms = ring - ring[0]
    normal = np.cross(arms[1:-1], arms[2:]).sum(axis=0)
    return normal / max(np.linalg.norm(normal), 1e-12)


def _triangles(rings: Sequence[np.ndarray], normal: np.ndarray) -> np.ndarray:
    """Cut a face into triangles, shape (n, 3, 3)."""
    kept = np.delete(np.arange(3), np.argmax(np.abs(normal)))
    corners = np.concatenate(rings)
    flat = np.ascontiguousarray((corners - corners[0])[:, kept])
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    return corners[mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3)]


@njit(cache=True)
def _fill(depth, number, triangles):
    """Enter the nearest triangle's depth and number into each cell of the picture."""
    height, width = depth.shape
    for k in range(len(triangles)):
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangles[k]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-9:
            continue
        for row in range(max(0, int(min(ay, by, cy))), min(height, int(max(ay, by, cy)) + 1)):
            for column in range(max(0, int(min(ax, bx, cx))), min(width, int(max(ax, bx, cx)) + 1)):
                x, y = column + 0.5, row + 0.5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u >= 0 and v >= 0 and w >= 0:
                    z = u * az + v * bz + w * cz
                    if z > depth[row, column]:
                        depth[row, column] = z
                        number[row, column] = k


@njit(cache=True)
def _draw_lines(depth, picture, edges, colour, lift):
    """Draw the parts of edges that nothing hides, three cells wide."""
    height, width = depth.shape
    for k in range(len(edges)):
        start, end = edges[k]
        n = int(2 * max(abs(end[0] - start[0]), abs(end[1] - start[1]))) + 1
        for i in range(n + 1):
            x, y, z = start + (end - start) * (i / n)
            for row in range(int(y) - 1, int(y) + 2):
                for column in range(int(x) - 1, int(x) + 2):
                    inside = 0 <= row < height and 0 <= column < width
                    if inside and z + lift >= depth[row, column]:
                        picture[row, column] = colour


@njit(cache=True)
def _draw_dots(depth, picture, places, colours, lift):
    """Draw the points that nothing hides, three cells wide."""
    height, width = depth.shape
    for k in range(len(places)):
        x, y, z = places[k]
        for row in range(int(y) - 1, int(y) + 2):
            for column in range(int(x) - 1, int(x) + 2):
                inside = 0 <= row < height and 0 <= column < width
                if inside and z + lift >= depth[row, column]:
                    picture[row, column] = colours[k]
