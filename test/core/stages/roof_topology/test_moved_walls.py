"""Walls of traced outlines are adjusted together with the planes: where they go, and where they must not."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy.optimize import minimize

from bench.scenes.models import model_scene
from lidar_buildings.core.model.outline import (
    BuildingOutline,
    Outline,
    OutlineQuality,
    across_walls,
    corner_moves,
    ring_walls,
    walls_before,
)
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model import model as model_module
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.roof_topology.topology import find_topology
from lidar_buildings.core.surfaces.plane_adjustment import CORNER, Condition, adjust
from lidar_buildings.pipeline.tile_models import build_models

DENSITY, OFF = 8.0, 0.1


def drawn(outline, inwards):
    """Return the corners of a ring whose walls have moved, each where two lines meet."""
    walls = ring_walls(outline.rings)
    across = across_walls(walls)
    level = (walls[:, 0] * across).sum(axis=1) + inwards
    both = zip(walls_before(walls), range(len(walls)), strict=True)
    return np.array([np.linalg.solve(across[[i, j]], level[[i, j]]) for i, j in both])


def hip(rotation_deg=20.0, off=OFF):
    """A hip roof, and its outline with the first wall too far outside."""
    scene = model_scene("hip", density=DENSITY, rotation_deg=rotation_deg)
    return scene, Outline(drawn(scene.outline, np.array([-off, 0.0, 0.0, 0.0])))


@pytest.mark.parametrize(
    "ring",
    [
        pytest.param([(0, 0), (8, 0), (8, 5), (0, 5)], id="rectangle"),
        pytest.param([(0, 0), (8, 0), (9, 4), (5, 3), (0, 7)], id="oblique"),
    ],
)
def test_corners_go_where_walls_that_have_moved_meet_in_courtyards_too(ring):
    outer = np.array(ring, dtype=float)
    outline = Outline(outer, (0.2 * outer[::-1] + 1.5,))
    walls = ring_walls(outline.rings)
    before, inwards = walls_before(walls), np.random.default_rng(0).normal(0.0, 0.1, len(walls))
    assert np.array_equal(walls[before, 1], walls[:, 0])
    own = np.stack([inwards[before], inwards], axis=1)
    moved = walls[:, 0] + np.einsum("nwx,nw->nx", corner_moves(walls), own)
    assert moved == pytest.approx(drawn(outline, inwards), abs=1e-9)
    grown = shapely.Polygon(*np.split(moved, [len(outer)])[:1], np.split(moved, [len(outer)])[1:])
    assert grown.is_valid


def test_a_corner_that_hardly_turns_goes_half_the_way_of_each_wall():
    walls = ring_walls([np.array([(0.0, 0.0), (5.0, 0.0), (10.0, 0.05), (10.0, 8.0), (0.0, 8.0)])])
    assert corner_moves(walls)[1] == pytest.approx(0.5 * across_walls(walls)[:2])


@pytest.mark.parametrize("sigmas", [(0.05, 0.05, 0.05, 0.05), (0.06, 0.03, 0.02, 0.04)])
def test_a_wall_moves_to_where_the_hips_say_by_the_ratio_of_variances(sigmas):
    """
    Hips of 45° leave walls the same distance from a rectangle of which its planes know the rest.

    So all move to the weighted mean of where they are, as far as planes are surer than walls.
    """
    scene, outline = hip()
    variances = np.square(sigmas)
    topology = find_topology(scene.points, scene.plane_id, outline, wall_variances=variances)
    assert topology.told_conditions.startswith("corners 4")
    mean = -OFF / variances[0] / (1.0 / variances).sum()
    expected = drawn(scene.outline, np.full(4, mean))
    assert np.hypot(*(topology.outline.exterior - expected).T).max() < 0.012
    assert (topology.wall_shares < 1.0).all()
    for corner in topology.outline.exterior:  # met, but for the grid
        heights = sorted(plane.elevation(corner[None])[0] for plane in topology.planes)
        assert heights[1] - heights[0] < 0.002


def test_planes_and_walls_are_the_least_squares_solution():
    scene, outline = hip()
    free = adjust(scene.points, scene.plane_id)
    about = Outline(outline.exterior - free.centre[:2])
    walls, variances = ring_walls(about.rings), np.square([0.05, 0.04, 0.03, 0.06])
    start = replace(free, walls=np.column_stack([np.zeros(4), variances]))
    before, moves, conditions = walls_before(walls), corner_moves(walls), []
    for at, place in enumerate(walls[:, 0]):
        away = [np.hypot(*(f.rings[0] - scene.outline.exterior[at]).T).min() for f in scene.building.faces]
        factors = np.array([[[*place, 1.0], [*-place, -1.0]]])
        planes, own = tuple((np.argsort(away, kind="stable")[:2] + 1).tolist()), (int(before[at]), at)
        conditions.append(
            Condition(CORNER, planes, 0.01, factors, walls=own, moves=np.stack([moves[at]] * 2))
        )
    found = start.under(conditions)
    assert len(found.held) == 4

    # The same by a general solver, in units of standard deviations: planes meet where walls cross.
    roots = [np.linalg.cholesky(one) for one in free.covariances]

    def unknowns(v):
        planes = [
            x + root @ u for x, root, u in zip(free.coefficients, roots, v[:12].reshape(4, 3), strict=True)
        ]
        return np.array(planes), np.sqrt(variances) * v[12:]

    def misses(v):
        planes, inwards = unknowns(v)
        heights = np.column_stack([drawn(about, inwards), np.ones(4)]) @ planes.T
        return [
            heights[at, one.planes[0] - 1] - heights[at, one.planes[1] - 1]
            for at, one in enumerate(conditions)
        ]

    best = minimize(
        lambda v: v @ v, np.zeros(16), jac=lambda v: 2.0 * v, method="SLSQP", tol=1e-12,
        constraints={"type": "eq", "fun": lambda v: 100.0 * np.array(misses(v))},
    )  # fmt: skip
    planes, inwards = unknowns(best.x)
    assert found.walls[:, 0] == pytest.approx(inwards, abs=3e-4)
    corners = np.column_stack([drawn(about, inwards), np.ones(4)])
    assert corners @ found.coefficients.T == pytest.approx(corners @ planes.T, abs=5e-4)
    assert (found.walls[:, 1] < variances).all()


def modelled(outline, **options):
    scene, _ = hip()
    options = {"is_traced": True, "point_spacing": DENSITY**-0.5} | options
    return build_model(scene.points, outline, plane_id=scene.plane_id, ground_elevation=10.0, **options)


def footprints(model):
    """Return the plans of all solids, and how far the farthest corner is from those of another."""
    plans = [
        shapely.MultiPoint(s.vertices[s.vertices[:, 2] == 10.0, :2]).convex_hull
        for s in model.solids.values()
    ]
    return plans, max(shapely.hausdorff_distance(plans[0], plan) for plan in plans)


def test_all_levels_of_detail_stand_on_the_walls_that_have_moved():
    scene, outline = hip()
    plans, apart = footprints(modelled(outline))
    assert len(plans) == 3
    assert apart == 0.0
    off = [shapely.hausdorff_distance(plan, scene.outline.polygon) for plan in (outline.polygon, plans[0])]
    assert off[1] < 0.6 * off[0]


def test_given_walls_stay():
    _, outline = hip(off=0.02)
    (plan, *_), apart = footprints(modelled(outline, is_traced=False))
    assert apart == 0.0
    assert shapely.hausdorff_distance(plan, outline.polygon) < 0.001


def test_walls_beside_those_of_another_building_stay():
    _, outline = hip()
    walls = ring_walls(outline.rings)
    (plan, *_), _ = footprints(modelled(outline, beside=walls[:1, ::-1]))
    off = (np.array(plan.exterior.coords[:-1]) - walls[0, 0]) @ across_walls(walls)[0]
    assert np.count_nonzero(np.abs(off) < 0.002) == 2
    assert shapely.hausdorff_distance(plan.boundary, outline.polygon.boundary) > 0.005


def test_neighbours_still_share_their_wall():
    """Two hip roofs beside one another: where they touch neither a gap nor an overlap opens."""
    scene, outline = hip(rotation_deg=0.0)
    walls = ring_walls(outline.rings)
    shift = (walls[2, 0] - walls[0, 1]) * (1.0, 1.0)  # by a whole length of the second wall
    rows = len(scene.points)
    points = np.concatenate([scene.points, scene.points + np.append(shift, 0.0)])
    tile = PointTile(
        points,
        height_above_ground=points[:, 2] - 10.0,
        building_id=np.repeat([1, 2], rows).astype(np.uint32),
        plane_id=np.tile(scene.plane_id, 2),
    )
    quality = OutlineQuality(0.0, 0.0, BuildingStatus.OK, "")
    outlines = [Outline(outline.exterior + move) for move in (np.zeros(2), shift)]
    made = build_models(
        tile,
        tuple(BuildingOutline(k + 1, one, quality=quality) for k, one in enumerate(outlines)),
        BuildingModelConfig(),
    )
    before, after = [one.polygon for one in outlines], [footprints(one.model)[0][0] for one in made]
    assert before[0].intersection(before[1]).length > 5.0
    assert after[0].intersection(after[1]).area == pytest.approx(
        before[0].intersection(before[1]).area, abs=1e-6
    )
    assert after[0].distance(after[1]) == before[0].distance(before[1])


def test_nothing_moves_if_the_outline_would_not_be_valid_and_that_is_said(monkeypatch):
    _, outline = hip()
    find = model_module.find_topology

    def crossed(*arguments, **named):
        topology = find(*arguments, **named)
        if named.get("wall_variances") is not None:
            topology = replace(topology, outline=Outline(outline.exterior[[0, 2, 1, 3]]))
        return topology

    monkeypatch.setattr(model_module, "find_topology", crossed)
    model = modelled(outline)
    (plan, *_), apart = footprints(model)
    assert apart == 0.0
    assert shapely.hausdorff_distance(plan, outline.polygon) < 0.001
    assert "walls stay where they were traced" in model.reason
