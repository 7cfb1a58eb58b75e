"""Walls with openings, eaves and what a survey has seen of them."""

from dataclasses import replace

import numpy as np
import pyogrio
import pytest
import shapely

from lidar_buildings.simulation import make_scene
from lidar_buildings.simulation.building import Opening
from lidar_buildings.simulation.facades import SurfaceKind, parts_of, set_back
from lidar_buildings.simulation.live import Scan, VehicleConfig, drive
from lidar_buildings.simulation.roof_shapes import flat, gable, l_shape
from lidar_buildings.simulation.scanner import joined
from lidar_buildings.simulation.scene import Road, Site, Terrain
from lidar_buildings.simulation.truth_layers import SeenParts, seen_wall_pieces, write_truth_layers

EXACT = VehicleConfig(beams=32, pulse_rate=60_000.0, range_noise=0.0)


def house():
    """A gable house whose eaves hang over by 0.5 m and verges by 0.2 m, with a window and a door."""
    shape = gable(12.0, 8.0, 4.0, 40.0)
    over = [0.5 if abs(a[1] - b[1]) < 1e-6 else 0.2 for a, b in edges(shape.exterior)]
    front = next(k for k, (a, b) in enumerate(edges(shape.exterior)) if a[1] < 0 and b[1] < 0)
    openings = Opening("window", front, 2.0, 1.2, 0.9, 2.3, 0.15), Opening("door", front, 6, 1, 0, 2.1, 0.12)
    return replace(shape, overhangs=tuple(over), roof_thickness=0.2, openings=openings)


def edges(ring):
    return list(zip(ring, np.roll(ring, -1, axis=0), strict=True))


@pytest.fixture(scope="module")
def seen():
    """The house from a street 8 m before its front."""
    site = Site((40.0, 40.0), Terrain(10.0), 0)
    site.add_building(house(), 20.0, 24.0)
    site.roads.append(Road((0.0, 12.0), (40.0, 12.0)))
    scene = site.scene("one_house")
    return scene, joined([one.truth for one in drive(scene, 0, EXACT).events() if isinstance(one, Scan)])


@pytest.mark.parametrize("shape", [flat(), l_shape()])
def test_a_ring_set_back_lies_inside_by_the_distances(shape):
    distances = tuple(0.3 + 0.1 * k for k in range(len(shape.exterior)))
    inner = set_back(shape.exterior, distances)
    for (a, b), (c, d), distance in zip(edges(shape.exterior), edges(inner), distances, strict=True):
        along = (b - a) / np.hypot(*(b - a))
        assert [along[0] * (one - a)[1] - along[1] * (one - a)[0] for one in (c, d)] == pytest.approx(
            [distance, distance]
        )
    assert shapely.Polygon(inner).within(shape.polygon)


def test_points_lie_on_what_they_are_said_to_lie_on(seen):
    _, points = seen
    x, y, z = points.points.T

    def of(kind):
        return points.true_kind == kind

    front = 24.0 - 4.0 + 0.5
    wall = of(SurfaceKind.WALL) & (x > 15.0) & (x < 25.0)
    assert np.abs(y[wall] - front).max() < 1e-6
    assert z[wall].max() < 10.0 + 4.0 + 0.5 * np.tan(np.deg2rad(40)) - 0.2
    assert wall.sum() > 500
    assert np.abs(y[of(SurfaceKind.WINDOW)] - (front + 0.15)).max() < 1e-6
    assert np.abs(y[of(SurfaceKind.DOOR)] - (front + 0.12)).max() < 1e-6
    assert (np.abs(y[of(SurfaceKind.INTERIOR)] - (front + 1.15)) < 1e-6).sum() > 20  # through the pane
    fascia = of(SurfaceKind.EAVE) & (np.abs(y - 20.0) < 1e-6)
    assert fascia.sum() > 10
    assert z[fascia].min() >= 13.8 - 1e-6
    assert not (wall & (x > 16.2) & (x < 17.0) & (z > 11.0) & (z < 12.2)).any()  # through the window


def test_what_hangs_over_has_an_underside_beside_the_walls():
    shape = house()
    soffits = [slab for slab in parts_of(shape).slabs if slab.side < 0 and slab.surface == SurfaceKind.EAVE]
    assert sum(slab.face.polygon.area for slab in soffits) == pytest.approx(12.0 * 8.0 - 11.6 * 7.0)
    for slab in soffits:
        (ring,) = slab.face.rings
        inside = ring.mean(axis=0)[None]
        assert shape.roof_at(inside)[1] - slab.face.elevation(inside) == pytest.approx(0.2)


def test_what_has_five_points_in_a_quarter_of_a_metre_is_seen(seen, tmp_path):
    scene, points = seen
    counts = SeenParts(scene)
    counts.add(points)
    write_truth_layers(tmp_path / "truth.gpkg", scene, counts)
    pieces = seen_wall_pieces(counts)
    length = {flag: sum(row["length"] for _, row in pieces if row["seen"] == flag) for flag in (0, 1)}
    assert sum(length.values()) == pytest.approx(2 * (11.6 + 7.0))
    for line, row in pieces:  # the front is, the rear is not
        middle = line.centroid
        if abs(middle.y - 20.5) < 0.1:
            assert row["seen"] == 1
        if middle.y > 26:
            assert row["seen"] == 0
            assert row["n_points"] == 0  # what is hit from within is no wall
    assert 11.6 < length[1] < 26.0
    meta, _, wkb, columns = pyogrio.raw.read(tmp_path / "truth.gpkg", layer="eaves")
    table = dict(zip(meta["fields"], columns, strict=True))
    assert sorted(set(np.round(table["overhang"], 6))) == [0.2, 0.5]
    assert set(table["kind"]) == {"eave", "verge"}
    assert max(table["seen_share"]) > 0.5
    assert (shapely.get_coordinate_dimension(shapely.from_wkb(wkb)) == 3).all()
    (*_, openings) = pyogrio.raw.read(tmp_path / "truth.gpkg", layer="openings")
    assert sorted(np.round(openings[5], 6)) == [0.12, 0.15]


def test_details_move_no_roof_and_nothing_else():
    plain, detailed = make_scene("village", 4), make_scene("village", 4, details=True)
    assert detailed.is_detailed
    assert not plain.is_detailed
    for one, other in zip(plain.buildings, detailed.buildings, strict=True):
        assert np.array_equal(one.exterior, other.exterior)
        assert np.array_equal(one.planes, other.planes)
        assert other.openings or other.roof_type == "round_tower"
    over = [max(b.overhangs) for b in detailed.buildings if b.overhangs]
    assert 0.3 <= min(over) < max(over) <= 0.8
    assert len(over) > 10


@pytest.mark.parametrize("seed", [0, 11])
def test_openings_lie_within_their_walls(seed):
    for building in make_scene("street_canyon", seed).buildings:
        made = parts_of(building)
        walls = [part for part in made.parts if part.layer == "walls"]
        for part in made.parts:
            if part.layer == "openings":
                wall = made.parts[part.wall]
                line = shapely.LineString([wall.start, wall.end])
                ends = shapely.points([part.start, part.end])
                assert shapely.distance(line, ends) == pytest.approx(part.depth)
                assert wall.low <= part.low < part.high < wall.high
                assert 0.1 <= part.depth <= 0.2
        assert len(walls) >= 4


def test_a_canyon_has_all_that_stands_in_a_street():
    scene = make_scene("street_canyon", 12)
    kinds = {one.roof_type for one in scene.obstacles}
    assert kinds >= {"car", "lorry", "pole", "person", "pavement"}
    assert kinds & {"hedge", "fence", "wall"}
    assert {"curved_front"} < {one.roof_type for one in scene.buildings}
    axis = scene.streets()
    fronts = [axis.distance(shapely.Polygon(_wall_ring(one))) for one in scene.buildings]
    assert min(fronts) >= 6.0
    assert max(fronts) < 13.0


def _wall_ring(building):
    return set_back(building.exterior, building.overhangs or (0.0,) * len(building.exterior))
