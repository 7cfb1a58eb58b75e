"""
Solids of random roofs in pieces: how many are valid, how exact their volumes, how fast they come.

    python -m bench.models.solids --number 5000
    python -m bench.models.solids --number 5000 --val3dity PATH      val3dity's verdicts beside ours

The roofs are far worse than real ones: lines a millimetre beside corners, pieces a millimetre wide, planes
that cross, almost coincide, meet in one vertex, or are as steep as walls.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import shapely
from shapely import affinity

from lidar_buildings.core.solids.plan_graph import RoofPiece, with_minimum_height
from lidar_buildings.core.solids.raising import roof_solid
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.validity import check_solid


def random_roof(seed: int) -> list[RoofPiece]:
    """Return the pieces of a random roof."""
    random = np.random.default_rng(seed)
    outline = _outline(random)
    lines = [outline.boundary, *_cuts(random, outline)]
    net = shapely.union_all(lines, grid_size=0.001)
    faces = [
        f for f in shapely.get_parts(shapely.polygonize([net])) if outline.contains(f.point_on_surface())
    ]
    planes = _planes(random, faces)
    pieces = [RoofPiece(_rings(face), plane) for face, plane in zip(faces, planes, strict=True)]
    if random.random() < 0.25:
        # Gaps and overlaps of a millimetre.
        return [
            RoofPiece(tuple(r + random.choice([-0.001, 0.0, 0.001], r.shape) for r in p.rings), p.plane)
            for p in pieces
        ]
    return pieces


def volume_below(pieces: list[RoofPiece], ground: float) -> float:
    """Return the sum over pieces of area times height at the centre of mass [m³]."""
    polygons = [shapely.Polygon(piece.rings[0], piece.rings[1:]) for piece in pieces]
    return sum(
        polygon.area * (piece.elevation(polygon.centroid.x, polygon.centroid.y) - ground)
        for piece, polygon in zip(pieces, polygons, strict=True)
    )


def block(n: int) -> list[RoofPiece]:
    """Return n by n flat parts of all heights, a block with some thousand faces."""
    random = np.random.default_rng(0)
    corners = np.array([[0, 0], [5, 0], [5, 5], [0, 5]], dtype=float)
    return [
        RoofPiece((np.add(corners, [5.0 * i, 5.0 * j]),), (0.0, 0.0, float(random.uniform(5, 15))))
        for i in range(n)
        for j in range(n)
    ]


def print_speed(name: str, pieces: list[RoofPiece]) -> None:
    """Print the processor time that one solid takes, the least of ten."""
    solid = roof_solid(pieces, 0.0)
    seconds = []
    for work in (lambda: roof_solid(pieces, 0.0), lambda: check_solid(solid)):
        times = []
        for _ in range(10):
            start = time.process_time()
            work()
            times.append(time.process_time() - start)
        seconds.append(min(times))
    print(
        f"{name}: {len(pieces)} pieces, {len(solid.faces)} faces: {seconds[0] * 1e3:.2f} processor ms, "
        f"of which {seconds[1] * 1e3:.2f} ms are the checks"
    )


def _outline(random: np.random.Generator) -> shapely.Polygon:
    """
    Return a box with courtyards, a union of boxes, a star, or a box whose courtyard touches its outer ring.
    """
    kind = random.integers(4)
    if kind == 0:
        shape = shapely.box(0, 0, *random.uniform(6, 20, 2))
        for corner in random.uniform(1, 15, (random.integers(3), 2)):
            shape = shape.difference(shapely.box(*corner, *(corner + random.uniform(0.5, 4, 2))))
    elif kind == 1:
        corners = random.uniform(-8, 8, (random.integers(1, 5), 2))
        shape = shapely.union_all([shapely.box(*c, *(c + random.uniform(3, 15, 2))) for c in corners])
    elif kind == 2:
        turns = np.sort(random.uniform(0, 2 * np.pi, random.integers(5, 14)))
        reach = random.uniform(3, 12, (len(turns), 1))
        shape = shapely.make_valid(shapely.Polygon(reach * np.column_stack([np.cos(turns), np.sin(turns)])))
    else:
        shape = shapely.Polygon([(0, 0), (10, 0), (10, 10), (0, 10), (0, 5)], [[(0, 5), (3, 3), (3, 7)]])
    turned = affinity.rotate(shape, random.choice([0.0, random.uniform(0, 360)]), origin=(0, 0))
    moved = shapely.set_precision(affinity.translate(turned, *random.uniform(-2000, 2000, 2)), 0.001)
    return max(shapely.get_parts(moved), key=lambda part: part.area)


def _cuts(random: np.random.Generator, outline: shapely.Polygon) -> list[shapely.Geometry]:
    """Return lines and small boxes that divide an outline, some a millimetre beside its corners and edges."""
    low, high = np.reshape(outline.bounds, (2, 2))
    corners = shapely.get_coordinates(outline)
    cuts: list[shapely.Geometry] = []
    for _ in range(random.integers(5)):
        turn, start = random.uniform(0, np.pi), random.uniform(low, high)
        if random.random() < 0.5:
            k = random.integers(len(corners) - 1)
            beside = random.choice([0.0, 0.001, 0.003, 0.02, 0.2]) * random.normal(size=2)
            along = np.arctan2(*(corners[k + 1] - corners[k])[::-1])
            turn, start = along + random.choice([0.0, 0.5 * np.pi, 0.001]), corners[k] + beside
        ahead = 100.0 * np.array([np.cos(turn), np.sin(turn)])
        cuts.append(shapely.LineString([start - ahead, start + ahead]))
    for _ in range(random.integers(3)):
        size = random.choice([0.001, 0.005, 0.05, 0.5, 2.0], 2) * random.uniform(1, 2, 2)
        corner = random.uniform(low, high)
        cuts.append(affinity.rotate(shapely.box(*corner, *(corner + size)), random.uniform(0, 90)).boundary)
    return cuts


def _planes(random: np.random.Generator, faces: list[shapely.Polygon]) -> list[tuple[float, float, float]]:
    """
    Return a plane per face: flat, sloping, through one vertex, of few slopes, steep, or all but the same.
    """
    kind = random.integers(6)
    corners = shapely.get_coordinates(faces)
    pivot = corners[random.integers(len(corners))]
    levels = random.uniform(3, 12, 3)
    planes = []
    for _ in faces:
        slopes, z = {
            0: (np.zeros(2), random.choice(levels) + random.choice([0.0, 0.001, 0.004, 0.01, 0.05])),
            1: (random.normal(0, 0.6, 2), random.uniform(15, 25)),
            2: (random.normal(0, 0.6, 2), 20.0),
            3: (random.choice([0.0, 0.5, -0.5], 2), 20 + random.choice([0.0, 0.003, 1.0])),
            4: (random.normal(0, 4, 2), 150.0 + 30 * random.random()),
            5: ([0.3, 0.4] + random.choice([0.0, 1e-4, 1e-3]) * random.normal(size=2), 20.0),
        }[int(kind)]
        planes.append((float(slopes[0]), float(slopes[1]), float(z - slopes @ pivot)))
    return planes


def _rings(polygon: shapely.Polygon) -> tuple[np.ndarray, ...]:
    """Return a polygon's rings, open, the exterior counter-clockwise and the holes clockwise."""
    oriented = shapely.orient_polygons(polygon)
    return tuple(shapely.get_coordinates(ring)[:-1] for ring in (oriented.exterior, *oriented.interiors))


def verdicts(program: str, solids: list[Solid]) -> Counter[tuple[int, ...]]:
    """Count the sets of codes that val3dity gives to solids."""
    lines = [
        {"type": "CityJSON", "version": "2.0", "transform": {"scale": [0.001] * 3, "translate": [0.0] * 3}}
    ]
    lines[0] |= {"CityObjects": {}, "vertices": []}
    for number, solid in enumerate(solids):
        geometry = {"type": "Solid", "lod": "2.2", "boundaries": [solid.faces]}
        lines.append(
            {
                "type": "CityJSONFeature",
                "id": str(number),
                "CityObjects": {str(number): {"type": "Building", "geometry": [geometry]}},
                "vertices": np.rint(solid.vertices * 1000).astype(int).tolist(),
            }
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "solids.city.jsonl"
        path.write_text("\n".join(map(json.dumps, lines)))
        with path.open() as stream:
            told = subprocess.run(
                [program, "stdin"], stdin=stream, capture_output=True, text=True, check=True
            )
    return Counter(tuple(json.loads(line.split(" ", 1)[1])) for line in told.stdout.splitlines()[1:])


def main() -> None:
    """Build solids, check them, and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--number", type=int, default=1000, help="how many roofs (default: 1000)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first (default: 0)")
    parser.add_argument("--val3dity", metavar="PATH", help="val3dity, to check the solids as well")
    options = parser.parse_args()
    roof_solid(random_roof(0), 0.0)
    roofs = [random_roof(seed) for seed in range(options.first, options.first + options.number)]
    start = time.process_time()
    solids = [roof_solid(roof, 0.0) for roof in roofs]
    built = time.process_time()
    codes = Counter(check_solid(solid) for solid in solids)
    checked = time.process_time()
    volumes = np.array([volume_below(with_minimum_height(roof, 0.0), 0.0) for roof in roofs])
    off = np.abs([solid.volume for solid in solids] / volumes - 1.0)
    n_pieces, n_faces = (np.mean(list(map(len, lists))) for lists in (roofs, (s.faces for s in solids)))
    print(f"{options.number} roofs, {n_pieces:.1f} pieces, {n_faces:.1f} faces on average")
    print(f"valid by our checks: {codes[()]}; codes of the others: {dict(codes - Counter({(): codes[()]}))}")
    print(
        f"volume off by: median {np.median(off):.1e}, 99 % {np.quantile(off, 0.99):.1e}, most {off.max():.1e}"
    )
    print(
        f"processor ms each: built and checked {(built - start) / options.number * 1e3:.2f}, "
        f"checked again {(checked - built) / options.number * 1e3:.2f}"
    )
    print_speed("a building", next(roof for roof in roofs if len(roof) >= 8))
    print_speed("a block", block(24))
    if options.val3dity:
        print(f"by val3dity: {dict(verdicts(options.val3dity, solids))}")


if __name__ == "__main__":
    main()
