"""Drawings, read back with ezdxf: layers, faces, arcs, data, units."""

from collections import Counter

import ezdxf
import numpy as np
import pytest
from ezdxf.math import bulge_radius
from support import model_survey

from lidar_buildings.io.models.dxf import APPLICATION, COURTYARD, OUTLINE, dxf_file, ring_arcs
from lidar_buildings.io.models.survey_building import ModelHeading


def written(folder, frame=model_survey.DUTCH, buildings=None):
    """Write a survey as DXF, and return its buildings and the path."""
    path = folder / "model.dxf"
    tile = model_survey.shapes(frame, buildings)
    with model_survey.survey(folder, tile, frame=frame) as survey:
        with dxf_file(path, ModelHeading(frame=frame)) as add:
            for building in survey:
                add(building)
        return list(survey), path


@pytest.fixture(scope="module")
def dutch(tmp_path_factory):
    buildings, path = written(tmp_path_factory.mktemp("dxf"))
    return buildings, ezdxf.readfile(path)


def data_of(entity):
    return [tag.value for tag in entity.get_xdata(APPLICATION) if tag.code == 1000]


def outlines_of(drawing, number=None, layer=OUTLINE):
    found = drawing.modelspace().query(f'LWPOLYLINE[layer=="{layer}"]')
    return [one for one in found if number is None or f"building_id={number}" in data_of(one)]


def test_the_audit_finds_nothing_to_mend_and_no_handle_is_given_twice(dutch):
    audit = dutch[1].audit()
    assert not audit.errors
    assert not audit.fixes
    handles = [int(e.dxf.handle, 16) for e in dutch[1].modelspace()]
    assert len(set(handles)) == len(handles)
    assert int(dutch[1].header["$HANDSEED"], 16) > max(handles)


def test_an_empty_drawing_is_sound_and_has_all_layers(tmp_path):
    _, path = written(tmp_path, buildings={})
    drawing = ezdxf.readfile(path)
    assert not drawing.audit().has_errors
    assert not len(drawing.modelspace())
    surfaces = {f"LOD{lod}_{kind}" for lod in (12, 13, 22) for kind in ("ROOF", "WALL", "GROUND")}
    assert surfaces | {OUTLINE, COURTYARD} <= {layer.dxf.name for layer in drawing.layers}


def test_faces_lie_on_the_layer_of_their_level_and_surface_and_lines_on_that_of_their_kind(dutch):
    buildings, drawing = dutch
    faces = drawing.modelspace().query("3DFACE")
    layers = Counter(one.dxf.layer for one in faces if "building-84900.0-447400.0" in data_of(one))
    assert layers == {"LOD22_ROOF": 2, "LOD22_WALL": 6, "LOD22_GROUND": 4}
    assert {data_of(one)[0] for one in faces} == {b.readable_id for b in buildings if b.solid}
    lines = dutch[1].modelspace().query("LINE")
    layers = Counter(one.dxf.layer for one in lines if "building-84900.0-447400.0" in data_of(one))
    assert layers == {"LINE_RIDGE": 1, "LINE_EAVE": 2, "LINE_VERGE": 4}
    (ridge,) = dutch[1].modelspace().query('LINE[layer=="LINE_RIDGE"]')
    assert ridge.dxf.start.isclose((84910.0, 447404.0, model_survey.RIDGE))


def test_faces_cover_the_solids_surface_in_source_coordinates(dutch):
    buildings, drawing = dutch
    for building in (b for b in buildings if b.solid):
        corners = [
            [face.dxf.vtx0, face.dxf.vtx1, face.dxf.vtx2, face.dxf.vtx3]
            for face in drawing.modelspace().query("3DFACE")
            if data_of(face) == [building.readable_id]
        ]
        corners = np.array([[tuple(c) for c in face] for face in corners])
        origin = model_survey.DUTCH.origin
        fans = [(corners[:, [0, k, k + 1]] - origin) for k in (1, 2)]
        volume = sum(np.einsum("ij,ij->", f[:, 0], np.cross(f[:, 1], f[:, 2])) for f in fans) / 6.0
        assert volume == pytest.approx(building.solid.volume, rel=1e-6)


def test_edges_within_a_face_are_hidden(dutch):
    buildings, drawing = dutch
    (court,) = [b for b in buildings if b.building_id == 9]
    roof = [
        face
        for face in drawing.modelspace().query('3DFACE[layer=="LOD22_ROOF"]')
        if data_of(face) == [court.readable_id]
    ]
    drawn = sum(
        visible and tuple(corners[k]) != tuple(corners[(k + 1) % 4])
        for face in roof
        for corners in [[*face.wcs_vertices(close=False), face.dxf.vtx3]]
        for k, visible in enumerate(face.get_edges_visibility())
        if k < 4
    )
    # the outer ring and the court
    assert drawn == 8


def test_a_round_tower_is_drawn_with_arcs(dutch):
    (tower,) = outlines_of(dutch[1], 2)
    points = tower.get_points("xyb")
    assert tower.closed
    assert len(points) == 2
    for k, (x, y, bulge) in enumerate(points):
        end = points[(k + 1) % 2]
        assert bulge == pytest.approx(1.0, abs=1e-4)
        assert bulge_radius((x, y), end[:2], bulge) == pytest.approx(model_survey.RADIUS, abs=1e-3)


def test_straight_outlines_keep_their_corners_and_all_outlines_carry_the_attributes(dutch):
    (outline,) = outlines_of(dutch[1], 5)
    expected = model_survey.rectangle(84900, 447400, 84910, 447408)
    assert np.array(outline.get_points("xy")) == pytest.approx(expected)
    assert not outline.has_arc
    assert outline.dxf.elevation == model_survey.GROUND
    (gable,) = outlines_of(dutch[1], 5)
    assert {"status=ok", "height=6.0", "volume=360.0"} <= set(data_of(gable))
    (ruin,) = outlines_of(dutch[1], 7)
    assert {"status=degenerate", "reason=no roof points"} <= set(data_of(ruin))


def test_courtyards_have_a_layer_of_their_own(dutch):
    (hole,) = outlines_of(dutch[1], layer=COURTYARD)
    assert "building_id=9" in data_of(hole)
    assert np.ptp(np.array(hole.get_points("xy")), axis=0).tolist() == [8.0, 8.0]


def test_feet_are_written_in_feet(tmp_path):
    _, path = written(tmp_path, model_survey.FEET, {5: model_survey.gable})
    drawing = ezdxf.readfile(path)
    assert drawing.header["$INSUNITS"] == 2
    (outline,) = outlines_of(drawing)
    west = 300000.0 / model_survey.FOOT
    points = np.array(outline.get_points("xy"))
    assert points[:, 0].min() == pytest.approx(west, abs=1e-3)
    assert np.ptp(points[:, 0]) == pytest.approx(10.0 / model_survey.FOOT, abs=1e-3)
    tops = max(v[2] for face in drawing.modelspace().query("3DFACE") for v in face.wcs_vertices())
    assert tops == pytest.approx((model_survey.RIDGE + 30.0) / model_survey.FOOT, abs=1e-3)


def test_metres_are_named_and_texts_beyond_ascii_survive(tmp_path):
    def named():
        outline, model = model_survey.gable()
        return outline, type(model)(model.solids, {"footprint_id": "Wohnhaus Süd — Ł"})

    _, path = written(tmp_path, buildings={5: named})
    drawing = ezdxf.readfile(path)
    assert drawing.header["$INSUNITS"] == 6
    texts = data_of(outlines_of(drawing)[0])
    assert "footprint_id=Wohnhaus Süd — Ł" in [ezdxf.lldxf.encoding.decode_dxf_unicode(t) for t in texts]


def test_a_place_without_ring_is_a_point(tmp_path):
    def speck():
        outline, model = model_survey.ruin()
        return type(outline)(outline.exterior[:1]), model

    _, path = written(tmp_path, buildings={7: speck})
    (point,) = ezdxf.readfile(path).modelspace()
    assert point.dxftype() == "POINT"
    assert tuple(point.dxf.location) == (84980.0, 447400.0, model_survey.GROUND)
    assert "reason=no roof points" in data_of(point)


def test_the_same_buildings_give_the_same_bytes(tmp_path):
    paths = [tmp_path / name for name in ("one", "two")]
    for path in paths:
        path.mkdir()
    first, second = (written(path)[1].read_bytes() for path in paths)
    assert first == second


def carried(ring):
    """A ring as messages carry it."""
    return np.asarray(ring, dtype=np.float32).astype(np.float64)


def arc(centre, radius, start_deg, end_deg, n_chords):
    angle = np.radians(np.linspace(start_deg, end_deg, n_chords + 1))
    return np.add(centre, radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def apse(place=(0.0, 0.0)):
    """A nave with a half-circle at its east end: rows 1 to 9 are the arc."""
    ends = [[-10.0, -5.0]], arc((0.0, 0.0), 5.0, -90.0, 90.0, 8), [[-10.0, 5.0]]
    return carried(np.vstack(ends) + place)


@pytest.mark.parametrize("place", [(0.0, 0.0), (812.3, -340.1), (6543.21, 7654.32)])
def test_a_half_circle_between_walls_is_one_arc(place):
    found = ring_arcs(apse(place))
    assert found.rows.tolist() == [0, 1, 9, 10]
    assert found.bulges == pytest.approx([0.0, 1.0, 0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize("first", [1, 5, 10])
def test_it_does_not_matter_where_a_ring_begins(first):
    ring = apse()
    found = ring_arcs(np.roll(ring, -first, axis=0))
    corners = {tuple(v) for v in np.roll(ring, -first, axis=0)[found.rows]}
    assert corners == {tuple(v) for v in ring[[0, 1, 9, 10]]}
    assert sorted(found.bulges) == pytest.approx([0.0, 0.0, 0.0, 1.0], abs=1e-4)


def test_an_arc_that_bends_inwards_has_a_negative_bulge_and_none_is_more_than_half_a_circle():
    ring = np.vstack([[[-10.0, -10.0], [10.0, -10.0], [10.0, 5.0]], arc((0.0, 5.0), 5.0, 0.0, -180.0, 8)])
    found = ring_arcs(carried(np.vstack([ring, [[-10.0, 5.0]]])))
    assert found.bulges.min() == pytest.approx(-1.0, abs=1e-4)
    assert np.count_nonzero(found.bulges) == 1
    backwards = ring_arcs(carried(np.vstack([ring, [[-10.0, 5.0]]]))[::-1])
    assert backwards.bulges.max() == pytest.approx(1.0, abs=1e-4)
    found = ring_arcs(carried(arc((3.0, 4.0), 6.0, 10.0, 370.0, 20)[:-1]))
    assert found.rows.tolist() == [0, 10]
    assert found.bulges == pytest.approx([1.0, 1.0], abs=1e-4)
    ring = carried(np.vstack([arc((0.0, 0.0), 8.0, 45.0, 315.0, 12), [[20.0, -5.0], [20.0, 5.0]]]))
    found = ring_arcs(ring)
    swept = 4.0 * np.degrees(np.arctan(found.bulges))
    assert swept.sum() == pytest.approx(270.0, abs=0.01)
    assert swept.max() <= 180.0


@pytest.mark.parametrize(
    "ring",
    [
        np.zeros((0, 2)),
        np.zeros((2, 2)),
        [[0, 0], [4, 0], [4, 4], [0, 4]],
        [[0, 0], [1, 0], [2, 0], [3, 0], [3, 2], [0, 2]],
        arc((0.0, 0.0), 4.0, 0.0, 360.0, 8)[:-1],
        arc((0.0, 0.0), 4.0, 0.0, 360.0, 6)[:-1],
    ],
    ids=["empty", "two", "square", "wall in equal parts", "octagon", "hexagon"],
)
def test_what_has_corners_or_is_straight_stays_as_it_is(ring):
    ring = carried(ring)
    found = ring_arcs(ring)
    assert found.rows.tolist() == list(range(len(ring)))
    assert not found.bulges.any()


def test_chords_that_differ_by_centimetres_are_walls():
    ring = arc((0.0, 0.0), 10.0, 0.0, 360.0, 20)[:-1]
    moved = carried(ring + 0.02 * np.random.default_rng(1).standard_normal(ring.shape))
    assert not ring_arcs(moved).bulges.any()
