"""Feet draped on the terrain: volumes and elevations by formula, valid solids, feet below roofs."""

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.foot import draped_solid
from lidar_buildings.core.solids.overhangs import overhung_solid
from lidar_buildings.core.solids.plan_graph import RoofPiece
from lidar_buildings.core.solids.raising import extrude, roof_solid
from lidar_buildings.core.solids.shell import ring_edges
from lidar_buildings.core.solids.validity import check_solid

PLAN = shapely.Polygon(
    [(0, 0), (20, 0), (20, 9), (9, 9), (9, 18), (0, 18)], [[(3, 3), (3, 6), (6, 6), (6, 3)]]
)
GABLE = [
    RoofPiece((np.array([[0.0, 0], [10, 0], [10, 4], [0, 4]]),), (0.0, 0.5, 5.0)),
    RoofPiece((np.array([[0.0, 4], [10, 4], [10, 8], [0, 8]]),), (0.0, -0.5, 9.0)),
]


def hillside(plan):
    return 100.0 + 0.3 * plan[:, 0] - 0.2 * plan[:, 1]


def waves(plan):
    return 1.5 * np.sin(plan[:, 0] / 2.0) + 0.3 * np.cos(plan[:, 1])


def foot_of(solid):
    """Return both ends of the edges in which the ground ends, shape (n, 2, 3)."""
    faces = zip(solid.faces, solid.semantics, strict=True)
    grounds = [face for face, kind in faces if kind == "GroundSurface"]
    edges = {edge for face in grounds for ring in face for edge in ring_edges(ring)}
    return solid.vertices[[edge for edge in edges if edge[::-1] not in edges]]


def test_on_a_plane_all_vertices_lie_on_it_and_the_volume_is_area_times_mean_height():
    draped, is_cut = draped_solid(extrude(Outline.of(PLAN), 90.0, 112.0), hillside)
    assert check_solid(draped) == ()
    assert not is_cut
    foot = foot_of(draped)[:, 0]
    assert len(foot) == 10  # a plane asks for no more than there were
    assert foot[:, 2] == pytest.approx(hillside(foot), abs=0.001)
    mean = hillside(np.array([[PLAN.centroid.x, PLAN.centroid.y]]))[0]
    assert draped.volume == pytest.approx(PLAN.area * (112.0 - mean), rel=1e-4)


def test_along_walls_the_foot_follows_a_terrain_that_bends():
    draped, _ = draped_solid(extrude(Outline.of(PLAN), -5.0, 8.0), waves)
    assert check_solid(draped) == ()
    edges = foot_of(draped)
    places = edges[:, None, 0] + np.linspace(0, 1, 9)[None, :, None] * (edges[:, 1] - edges[:, 0])[:, None]
    places = places.reshape(-1, 3)
    assert np.abs(places[:, 2] - waves(places)).max() < 0.08  # 0.03, and what lies between two looks
    assert shapely.area(shapely.Polygon(foot_ring(edges))) == pytest.approx(PLAN.area + 9.0, abs=0.01)


def foot_ring(edges):
    """Return the places of the longest ring of edges in their order."""
    after = {tuple(start[:2]): tuple(end[:2]) for start, end in edges}
    ring = [max(after)]
    while (place := after[ring[-1]]) != ring[0]:
        ring.append(place)
    return ring


@pytest.mark.parametrize("rise", [0.0, 0.4, 1.2])
def test_the_foot_ends_below_eaves_that_the_terrain_rises_above(rise):
    def slope(plan):
        return rise * plan[:, 1]

    level = roof_solid(GABLE, 0.0)
    draped, is_cut = draped_solid(level, slope)
    assert check_solid(draped) == ()
    assert is_cut == (rise * 8.0 > 5.0)
    foot = foot_of(draped)[:, 0]
    assert foot[:, 2] == pytest.approx(np.minimum(slope(foot), eaves(foot) - 0.1), abs=0.002)
    assert draped.semantics.count("RoofSurface") == level.semantics.count("RoofSurface")


def eaves(plan):
    return np.minimum(5.0 + 0.5 * plan[:, 1], 9.0 - 0.5 * plan[:, 1])


def test_under_eaves_the_walls_stand_on_the_terrain_and_soffits_stay():
    level, _ = overhung_solid(GABLE, shapely.box(0.5, 0.5, 9.5, 7.5), 0.0, 0.2)
    draped, _ = draped_solid(level, lambda plan: 0.1 * plan[:, 0] - 3.0)
    assert check_solid(draped) == ()
    # the walls' plan reaches 3 m − 0.1 × its middle farther down
    assert draped.volume == pytest.approx(level.volume + 63.0 * (3.0 - 0.5), abs=0.01)
    kinds = [kind for kind in level.semantics if kind != "GroundSurface"]
    assert [kind for kind in draped.semantics if kind != "GroundSurface"] == kinds


def test_neighbours_divide_a_common_wall_alike():
    west, east = (Outline.of(shapely.box(x, 0, x + 8, 11.3)) for x in (0.0, 8.0))
    feet = [foot_of(draped_solid(extrude(one, -5.0, 8.0), waves)[0])[:, 0] for one in (west, east)]
    on_wall = [{tuple(place) for place in foot[foot[:, 0] == 8.0]} for foot in feet]
    assert len(on_wall[0]) > 3
    assert on_wall[0] == on_wall[1]
