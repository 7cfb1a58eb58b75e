"""
Models from raw points against wireframes that people drew: each building alone on flat ground, one run.

Every cloud gets a place of its own, with ground below it but for what its points hide; the places go
through `lidar-buildings run` with defaults as one file. Corners and edges of roof faces are compared with
what was drawn.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import itertools
import tempfile
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bench.common.tables import table
from bench.generalise.ceiling import MOVES, adjusted
from bench.generalise.corners import (
    FOLDER,
    HEADINGS,
    ON_MODEL,
    TOLERANCES,
    Counts,
    DrawnRoof,
    cells_of,
    drawn_roofs,
)
from lidar_buildings.cli import main as command
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid
from lidar_buildings.core.stages.building_model.model import LOD22
from lidar_buildings.core.stages.building_model.quality import distance_to_surface
from lidar_buildings.evaluation.readers.city_model import read_city_model
from lidar_buildings.evaluation.scores.models import Wireframe, faces_of
from lidar_buildings.evaluation.scores.outlines import match_corners

#: Side of a place, how far the ground lies below the lowest points, and how far off them in plan [m].
PLACE, BELOW, AWAY = 120.0, 5.0, 0.5
#: Points of the ground a square metre, and their noise [m].
DENSITY, NOISE = 12.0, 0.02
#: The lowest points of a building: this percentile of their elevations.
_LOWEST = 1.0
#: Vertices nearer than this are one, and split an edge that they lie on so nearly [m].
_SAME, _ON_EDGE = 0.05, 0.02
#: A vertex at which a line turns by less is none [deg].
_STRAIGHT = 1.0


def places_of(
    clouds: Sequence[NDArray[np.float64]], seed: int = 0, *, place: float = PLACE
) -> tuple[NDArray[np.float64], NDArray]:
    """
    Put clouds (n_points, 3) on places of their own, `place` wide [m], with ground at one elevation.

    Returns all points (n, 3) and how far each cloud was moved (n_clouds, 3) [m].
    """
    rng = np.random.default_rng(seed)
    n_across = int(np.ceil(np.sqrt(len(clouds))))
    parts, shifts = [], np.empty((len(clouds), 3))
    for k, cloud in enumerate(clouds):
        corner = place * np.array(divmod(k, n_across), dtype=float)[::-1]
        middle = 0.5 * (cloud[:, :2].min(axis=0) + cloud[:, :2].max(axis=0))
        shifts[k, :2] = np.round(corner + 0.5 * place - middle, 3)
        shifts[k, 2] = np.round(BELOW - np.percentile(cloud[:, 2], _LOWEST), 3)
        own = cloud + shifts[k]
        ground = np.column_stack([
            corner + rng.uniform(0.0, place, (int(DENSITY * place**2), 2)),
            np.zeros(int(DENSITY * place**2)),
        ])  # fmt: skip
        ground[:, 2] = rng.normal(0.0, NOISE, len(ground))
        is_open = cKDTree(own[:, :2]).query(ground[:, :2], distance_upper_bound=AWAY)[0] > AWAY
        parts += [own, ground[is_open]]
    return np.concatenate(parts), shifts


def models_on_places(
    clouds: Sequence[NDArray[np.float64]],
    settings: Sequence[str] = (),
    level: str = LOD22,
    *,
    place: float = PLACE,
) -> list[list[Solid]]:
    """Run the chain over clouds on places of their own; return the finest solids of each, moved back."""
    points, shifts = places_of(clouds, place=place)
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.full(3, 0.001)
    las = laspy.LasData(header)
    las.xyz = points
    las.return_number = las.number_of_returns = np.ones(len(points), dtype=np.uint8)
    with tempfile.TemporaryDirectory() as folder:
        source, output = Path(folder) / "places.laz", Path(folder) / "result"
        las.write(source)
        arguments = ["run", str(source), "--output", str(output), "--no-ros"]
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            status = command([*arguments, *(["--set", *settings] if settings else [])])
        if status:
            raise SystemExit(f"lidar-buildings {' '.join(arguments)}: status {status}:\n{said.getvalue()}")
        buildings = read_city_model(output).buildings
    n_across = int(np.ceil(np.sqrt(len(clouds))))
    found: list[list[Solid]] = [[] for _ in clouds]
    for one in buildings:
        for solid in one.finest(level)[1]:
            column, row = (solid.vertices[:, :2].mean(axis=0) // place).astype(int)
            if (k := row * n_across + column) < len(found):
                vertices = solid.vertices - shifts[k]
                found[k].append(Solid(vertices, solid.faces, solid.semantics))
    return found


def face_wireframe(solids: Sequence[Solid]) -> Wireframe:
    """
    Return the edges of all roof faces, vertices within 5 cm as one.

    Edges are split where a vertex lies on them; vertices at which a line goes straight on are dropped.
    """
    ends = [
        np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
        for solid in solids
        for face in faces_of(solid, ROOF_SURFACE)
        for ring in solid.face_rings(face)
    ]
    if not ends:
        return Wireframe(np.empty((0, 3)), np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=bool))
    vertices = np.concatenate(ends).reshape(-1, 3)
    near = cKDTree(vertices).query_pairs(_SAME, output_type="ndarray")
    _, group = np.unique(sets_of_pairs(len(vertices), near[:, 0], near[:, 1]), return_inverse=True)
    count = np.bincount(group)
    corners = np.column_stack([np.bincount(group, vertices[:, k]) / count for k in range(3)])
    edges = _split(corners, {_sorted(i, j) for i, j in group.reshape(-1, 2).tolist() if i != j})
    edges = _without_straight(corners, edges)
    used, rows = np.unique(np.array(sorted(edges), dtype=np.int64).reshape(-1, 2), return_inverse=True)
    return Wireframe(corners[used], rows.reshape(-1, 2).astype(np.int64), np.zeros(len(edges), dtype=bool))


def _sorted(i: int, j: int) -> tuple[int, int]:
    return (i, j) if i < j else (j, i)


def _split(corners: NDArray[np.float64], edges: set[tuple[int, int]]) -> set[tuple[int, int]]:
    parts = set()
    for i, j in edges:
        along = corners[j] - corners[i]
        share = (corners - corners[i]) @ along / (along @ along)
        away = np.linalg.norm(corners - corners[i] - share[:, None] * along, axis=1)
        on = np.flatnonzero((away < _ON_EDGE) & (share > 0.0) & (share < 1.0))
        chain = [i, *on[np.argsort(share[on])].tolist(), j]
        parts |= {_sorted(a, b) for a, b in itertools.pairwise(chain) if a != b}
    return parts


def _without_straight(corners: NDArray[np.float64], edges: set[tuple[int, int]]) -> set[tuple[int, int]]:
    around: dict[int, set[int]] = {}
    for i, j in edges:
        around.setdefault(i, set()).add(j)
        around.setdefault(j, set()).add(i)
    for corner in sorted(around):
        if len(around[corner]) != 2:
            continue
        one, other = sorted(around[corner])
        before, after = corners[corner] - corners[one], corners[other] - corners[corner]
        lengths = float(np.linalg.norm(before) * np.linalg.norm(after))
        if other in around[one] or before @ after < np.cos(np.radians(_STRAIGHT)) * lengths:
            continue
        around[one] = around[one] - {corner} | {other}
        around[other] = around[other] - {corner} | {one}
        around[corner] = set()
    return {_sorted(i, j) for i, others in around.items() for j in others}


def counts_of(roof: DrawnRoof, solids: Sequence[Solid]) -> Counts:
    """Compare the models on a place with what was drawn, and with its points."""
    away = np.full(len(roof.points), np.inf)
    for solid in solids:
        away = np.minimum(away, distance_to_surface(roof.points, solid, np.full(len(away), np.inf)))
    n_on_model = int(np.count_nonzero(away <= ON_MODEL))
    return frame_counts(face_wireframe(solids), roof.drawn)._replace(
        n_on_model=n_on_model, n_points=len(away)
    )


def frame_counts(frame: Wireframe, drawn: Wireframe) -> Counts:
    """Compare a wireframe with what was drawn: edges at the narrower tolerance."""
    mine, theirs, _ = match_corners(frame.corners, drawn.corners, TOLERANCES[-1])
    near, near_theirs, _ = match_corners(frame.corners, drawn.corners, TOLERANCES[0])
    partner = np.full(len(frame.corners), -1, dtype=np.int64)
    partner[near] = near_theirs
    wanted = {_sorted(i, j) for i, j in drawn.edges.tolist()}
    paired = sum(_sorted(i, j) in wanted for i, j in partner[frame.edges].tolist())
    return Counts(
        near=len(near),
        far=len(mine),
        corners=len(frame.corners),
        corners_drawn=len(drawn.corners),
        edges_paired=paired,
        edges=len(frame.edges),
        edges_drawn=len(drawn.edges),
        z_offsets=frame.corners[mine, 2] - drawn.corners[theirs, 2],
        n_on_model=0,
        n_points=1,
    )


def report(data: Path, options: argparse.Namespace) -> str:
    """
    Run all drawn roofs from raw points: a line for each, the worst first, and one of all.

    The last lines are the ceiling: what was drawn, adjusted to the points.
    """
    roofs = drawn_roofs(data / FOLDER)
    models = models_on_places([roof.points for roof in roofs], options.set)
    counts = [counts_of(roof, solids) for roof, solids in zip(roofs, models, strict=True)]
    n_models = [len(solids) for solids in models]
    order = np.argsort([one.f1 for one in counts], kind="stable").tolist()
    rows = [[roofs[k].name, str(n_models[k]), *cells_of([counts[k]])] for k in order]
    rows.append(["all", str(sum(n_models)), *cells_of(counts)])
    for moves in MOVES:
        best = [frame_counts(adjusted(roof, moves), roof.drawn) for roof in roofs]
        rows.append([f"drawn, adjusted: {moves}", "", *cells_of(best)[:-1], ""])
    return table(("roof", "models", *HEADINGS), rows)
