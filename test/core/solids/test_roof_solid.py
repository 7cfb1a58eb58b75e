"""Solids of roofs in pieces: typical ones vertex by vertex, hard ones valid."""

import numpy as np
import pytest
import shapely

from bench.scenes.models import SHAPES, solid_of
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids import raising
from lidar_buildings.core.solids.output_grid import elevation_on_grid, on_grid
from lidar_buildings.core.solids.plan_graph import RoofPiece
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Solid
from lidar_buildings.core.solids.validity import check_solid

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])


def rectangle(left, low, right, high):
    return np.array([[left, low], [right, low], [right, high], [left, high]], dtype=float)


def piece(ring, plane, *holes):
    return RoofPiece((np.asarray(ring, dtype=float), *(np.asarray(h, dtype=float) for h in holes)), plane)


def flat(ring, elevation, *holes):
    return piece(ring, (0.0, 0.0, elevation), *holes)


def count(solid, kind):
    return solid.semantics.count(kind)


def face_set(solid):
    """The faces by their coordinates, whatever the order of vertices and faces."""
    return {
        (kind, tuple(sorted(map(tuple, np.round(np.concatenate(solid.face_rings(face)), 6).tolist()))))
        for face, kind in zip(solid.faces, solid.semantics, strict=True)
    }


def volume_below(pieces, ground=0.0):
    """The sum over the pieces of area times height at the centre of mass."""
    total = 0.0
    for each in pieces:
        polygon = shapely.Polygon(each.rings[0], each.rings[1:])
        total += polygon.area * (each.elevation(polygon.centroid.x, polygon.centroid.y) - ground)
    return total


def test_one_flat_piece_gives_the_extruded_outline():
    courtyard = np.array([[4.0, 4.0], [4.0, 7.0], [6.0, 7.0], [6.0, 4.0]])
    solid = raising.roof_solid([flat(SQUARE, 8.25, courtyard)], 1.5)
    assert face_set(solid) == face_set(raising.extrude(Outline(SQUARE, (courtyard,)), 1.5, 8.25))
    assert check_solid(solid) == ()


def test_a_gable_has_a_ridge_and_gable_walls_in_two_halves():
    lower, upper = rectangle(0, 0, 12, 4), rectangle(0, 4, 12, 8)
    solid = raising.roof_solid([piece(lower, (0.0, 0.5, 3.0)), piece(upper, (0.0, -0.5, 7.0))], 0.0)
    assert check_solid(solid) == ()
    assert len(solid.vertices) == 12
    assert [count(solid, k) for k in (GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE)] == [1, 2, 6]
    assert solid.vertices[:, 2].max() == 5.0
    assert solid.volume == pytest.approx(12 * 8 * 4.0)


@pytest.mark.parametrize("turned", [0.0, 17.3])
@pytest.mark.parametrize("name", SHAPES)
def test_the_faces_of_a_virtual_building_give_its_solid(name, turned):
    building = SHAPES[name]().placed(0, 0, turned)
    truth = solid_of(building)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    pieces = []
    for face in building.faces:
        z, along_x, along_y = face.elevation(corners)
        pieces.append(RoofPiece(tuple(face.rings), (along_x - z, along_y - z, z)))
    solid, codes = raising.checked_roof_solid(pieces, building.ground_elevation)
    assert codes == ()
    assert (len(solid.vertices), len(solid.faces)) == (len(truth.vertices), len(truth.faces))
    assert solid.volume == pytest.approx(truth.volume, rel=1e-3)


def test_a_step_has_an_inner_wall():
    solid = raising.roof_solid([flat(rectangle(0, 0, 10, 5), 3.0), flat(rectangle(0, 5, 10, 10), 7.0)], 0.0)
    inner = [
        solid.vertices[list(face[0])]
        for face, kind in zip(solid.faces, solid.semantics, strict=True)
        if kind == WALL_SURFACE and (solid.vertices[list(face[0]), 1] == 5.0).all()
    ]
    assert [sorted(set(ring[:, 2])) for ring in inner] == [[3.0, 7.0]]
    assert check_solid(solid) == ()
    assert solid.volume == pytest.approx(50 * 3 + 50 * 7)


def test_a_step_that_vanishes_at_one_end_has_a_triangular_wall_and_a_tiny_one_none():
    pieces = [flat(rectangle(0, 0, 10, 5), 3.0), piece(rectangle(0, 5, 10, 10), (0.2, 0.0, 3.0))]
    solid = raising.roof_solid(pieces, 0.0)
    walls = [len(f[0]) for f, k in zip(solid.faces, solid.semantics, strict=True) if k == WALL_SURFACE]
    assert walls.count(3) == 1
    assert check_solid(solid) == ()
    pieces = [flat(rectangle(0, 0, 10, 5), 3.0), piece(rectangle(0, 5, 10, 10), (0.0, 0.4, 1.006))]
    solid = raising.roof_solid(pieces, 0.0)
    assert check_solid(solid) == ()
    assert set(solid.vertices[solid.vertices[:, 1] == 5.0, 2]) == {0.0, 3.003}
    assert count(solid, WALL_SURFACE) == 6


def test_where_profiles_cross_the_edge_is_divided():
    pieces = [
        piece(rectangle(0, 0, 10, 5), (0.3, 0.0, 3.0)),
        piece(rectangle(0, 5, 10, 10), (-0.3, 0.0, 6.0)),
    ]
    solid = raising.roof_solid(pieces, 0.0)
    assert check_solid(solid) == ()
    assert [5.0, 5.0, 4.5] in solid.vertices.tolist()
    assert solid.volume == pytest.approx(volume_below(pieces))


def test_a_tower_in_a_roof_and_a_courtyard_beside_it():
    tower, court = rectangle(2, 2, 4, 4), rectangle(6, 6, 8, 8)
    solid = raising.roof_solid([flat(SQUARE, 5.0, tower[::-1], court[::-1]), flat(tower, 12.0)], 0.0)
    assert check_solid(solid) == ()
    assert solid.volume == pytest.approx((100 - 8) * 5 + 4 * 12)
    assert count(solid, GROUND_SURFACE) == 1
    assert count(solid, WALL_SURFACE) == 4 + 4 + 4


def test_pieces_of_one_height_apart_from_each_other_keep_their_own_holes(monkeypatch):
    tower = rectangle(2, 2, 4, 4)
    pieces = [
        flat(rectangle(0, 0, 6, 6), 5.0, tower[::-1]),
        flat(tower, 12.0),
        flat(rectangle(6, 0, 8, 6), 9.0),
        flat(rectangle(8, 0, 14, 6), 5.0),
    ]
    assert raising.checked_roof_solid(pieces, 0.0, join_equal=True)[1] == ()
    # whatever memory holds that is given out again
    monkeypatch.setattr(np, "empty", lambda shape, dtype=float: np.full(shape, 1_000_000, dtype=dtype))
    solid, codes = raising.checked_roof_solid(pieces, 0.0, join_equal=True)
    assert codes == ()
    assert solid.volume == pytest.approx(volume_below(pieces))
    assert sorted(len(face) for face in solid.faces) == sorted([2] + [1] * (len(solid.faces) - 1))


def test_vertices_in_the_middle_of_a_neighbours_edge_are_found():
    pieces = [
        flat(rectangle(0, 0, 10, 5), 3.0),
        flat(rectangle(0, 5, 6, 10), 8.0),
        flat(rectangle(6, 5, 10, 10), 5.0),
    ]
    solid = raising.roof_solid(pieces, 0.0)
    assert check_solid(solid) == ()
    assert solid.volume == pytest.approx(volume_below(pieces))


def test_gaps_and_overlaps_of_millimetres_are_closed_and_nothing_else_is_coarser():
    pieces = [
        flat(rectangle(0.002, 0.003, 10, 5), 3.0),
        flat(rectangle(0.002, 5.002, 6.001, 10.001), 8.0),
        flat(rectangle(6, 4.999, 10, 10.001), 5.0),
    ]
    solid = raising.roof_solid(pieces, 0.0)
    assert check_solid(solid) == ()
    assert count(solid, GROUND_SURFACE) == 1
    assert len(solid.faces[0]) == 1
    assert solid.volume == pytest.approx(volume_below(pieces), rel=1e-3)
    # A simpler plan is on a grid of five millimetres.
    assert solid.vertices[:, :2].min(axis=0) == pytest.approx([0.002, 0.003], abs=1e-9)
    assert solid.vertices[:, :2].max(axis=0) == pytest.approx([10.0, 10.001], abs=1e-9)


@pytest.mark.parametrize("low", [3.0, 0.0])
def test_high_and_low_pieces_in_turns_around_a_vertex_do_not_touch_in_a_line(low):
    heights = {(0, 0): low, (5, 0): 8.0, (5, 5): low, (0, 5): 9.0}
    pieces = [flat(rectangle(x, y, x + 5, y + 5), z) for (x, y), z in heights.items() if z > 0.0]
    solid = raising.roof_solid(pieces, 0.0)
    assert check_solid(solid) == ()
    assert solid.volume == pytest.approx(volume_below(pieces), rel=2e-3)


def test_a_courtyard_may_touch_the_outer_ring():
    touching = np.array([[0.0, 5.0], [3.0, 7.0], [3.0, 3.0]])
    exterior = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [0, 5]])
    for ring in (SQUARE, exterior):
        solid = raising.roof_solid([flat(ring, 3.0, touching)], 0.0)
        assert check_solid(solid) == ()
        assert solid.volume == pytest.approx(3 * 94.0, rel=1e-3)


def test_a_roof_that_runs_into_the_ground_is_cut_off_above_it():
    solid = raising.roof_solid([piece(SQUARE, (1.0, 0.0, -4.9))], 0.0)
    assert check_solid(solid) == ()
    assert solid.vertices[:, 2].max() == pytest.approx(5.1)
    assert count(solid, ROOF_SURFACE) == 2
    assert solid.volume == pytest.approx(0.1 * 100 + 0.5 * 5 * 5 * 10)
    assert check_solid(raising.roof_solid([flat(SQUARE, -3.0)], 0.0)) == ()


@pytest.mark.parametrize("slope", [0.2, 3.0, 40.0])
def test_roof_faces_lie_in_their_planes_however_steep(slope):
    turned = SQUARE @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    plane = (slope, 0.31 * slope, 500.0)
    solid = raising.roof_solid([piece(turned, plane)], 0.0)
    assert check_solid(solid) == ()
    x, y, z = solid.vertices[solid.vertices[:, 2] > 0.0].T
    assert np.abs(plane[0] * x + plane[1] * y + plane[2] - z).max() < 0.0006


def test_coordinates_are_on_the_output_grid():
    pieces = [piece(SQUARE / 3, (0.123, -0.456, 20.0))]
    steps = raising.roof_solid(pieces, 0.12345).vertices * 1000
    assert np.abs(steps - np.rint(steps)).max() < 1e-6


def test_nothing_gives_nothing_and_what_cannot_be_one_solid_comes_with_its_codes():
    empty = raising.roof_solid([], 0.0)
    assert check_solid(empty) == (902,)
    assert raising.roof_solid([flat([[0, 0], [5, 0], [9, 0]], 3.0)], 0.0).faces == ()
    assert raising.roof_solid([flat(np.empty((0, 2)), 3.0)], 0.0).faces == ()
    apart = [flat(rectangle(0, 0, 5, 5), 3.0), flat(rectangle(7, 0, 12, 5), 4.0)]
    solid, codes = raising.checked_roof_solid(apart, 0.0)
    assert codes == check_solid(solid) == (305,)
    assert solid.volume == pytest.approx(25 * 7)
    assert raising.checked_roof_solid(apart[:1], 0.0)[1] == ()


def test_a_roof_face_that_is_not_planar_is_cut_into_triangles():
    house = raising.extrude(Outline(SQUARE), 0.0, 3.0)
    raised = house.vertices.copy()
    raised[6, 2] += 0.1
    bent = Solid(raised, house.faces, house.semantics)
    assert check_solid(bent) == (203,)
    cut = raising.triangulate_non_planar(bent)
    assert check_solid(cut) == ()
    assert count(cut, ROOF_SURFACE) == 2
    assert raising.triangulate_non_planar(house).faces == house.faces


def test_pieces_a_millimetre_wide_are_left_out():
    strip = rectangle(5, 0, 5.001, 10)
    pieces = [flat(rectangle(0, 0, 5, 10), 4.0), flat(strip, 9.0), flat(rectangle(5.001, 0, 10, 10), 6.0)]
    solid = raising.roof_solid(pieces, 0.0)
    assert check_solid(solid) == ()
    assert solid.vertices[:, 2].max() == 6.0
    assert solid.volume == pytest.approx(500.0, rel=1e-3)


def random_roof(seed):
    """A polygon, perhaps with a courtyard, cut by lines into pieces with planes of all kinds."""
    random = np.random.default_rng(seed)
    angles = np.sort(random.uniform(0, 2 * np.pi, random.integers(4, 10)))
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) * random.uniform(5, 12, len(angles))[:, None]
    outline = shapely.make_valid(shapely.Polygon(ring)).difference(
        shapely.box(-1, -1, random.uniform(-1, 3), 1)
    )
    outline = max(shapely.get_parts(shapely.set_precision(outline, 0.001)), key=lambda part: part.area)
    lines = [outline.boundary]
    for _ in range(random.integers(1, 4)):
        start = random.normal(0, 3, 2)
        # Some begin a millimetre beside a corner.
        if random.random() < 0.4:
            start = outline.exterior.coords[0] + random.choice([0.0, 0.001, 0.004], 2)
        ahead = 40 * np.array([np.cos(turn := random.uniform(0, 7)), np.sin(turn)])
        lines.append(shapely.LineString([start - ahead, start + ahead]))
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all(lines, grid_size=0.001)]))
    slope = random.choice([0.0, 0.001, 0.5, 5.0])
    return [
        piece(
            shapely.get_coordinates(face.exterior)[-2::-1],
            (*random.normal(0, 1, 2) * slope, random.choice([200.0, 200.003, 204.0])),
            *(shapely.get_coordinates(hole)[:-1] for hole in face.interiors),
        )
        for face in faces
        if outline.contains(face.point_on_surface())
    ]


@pytest.mark.parametrize("first", range(0, 80, 20))
def test_random_roofs_give_valid_solids_of_the_right_volume(first):
    for seed in range(first, first + 20):
        pieces = random_roof(seed)
        solid = raising.roof_solid(pieces, 0.0)
        assert (seed, check_solid(solid)) == (seed, ())
        assert solid.volume == pytest.approx(volume_below(pieces), rel=2e-3)


def test_the_order_of_the_pieces_changes_nothing_but_their_order():
    pieces = random_roof(4)
    assert len(pieces) > 2
    assert face_set(raising.roof_solid(pieces, 0.0)) == face_set(raising.roof_solid(pieces[::-1], 0.0))


@pytest.mark.parametrize(
    "pieces",
    [
        # one upon another, side by side, next to one another, a hole beside its piece
        [flat(SQUARE, 3.0), flat(rectangle(2, 2, 4, 4), 5.0)],
        [flat(rectangle(0, 0, 5, 5), 3.0), flat(rectangle(7, 0, 12, 5), 4.0)],
        [flat(rectangle(0, 0, 5, 5), 3.0), flat(rectangle(5.001, 0, 12, 5), 4.0)],
        [flat(SQUARE, 3.0, rectangle(12, 2, 14, 4)[::-1])],
        [flat(SQUARE, 3.0, rectangle(0, 2, 4, 4)[::-1])],
    ],
)
def test_a_plan_that_is_none_comes_with_the_codes_of_its_solid(pieces):
    solid, codes = raising.checked_roof_solid(pieces, 0.0)
    assert codes == check_solid(solid)


def test_one_elevation_is_rounded_as_many_are():
    random = np.random.default_rng(0)
    elevations = np.concatenate([random.uniform(-500.0, 9000.0, 2000), np.arange(-2000, 2000) * 0.0005])
    assert [elevation_on_grid(z) for z in elevations.tolist()] == on_grid(elevations).tolist()
