"""A tile's façades: of points from the street alone, each of its building, the same as a message carries."""

import json

import numpy as np
import pyogrio
import pytest
import shapely

from lidar_buildings.core.model.classes import PointClass, View
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.facades.config import FacadesConfig
from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.io.models.survey_building import ModelHeading
from lidar_buildings.io.results.building_layers import building_layers_file, flatgeobuf_files
from lidar_buildings.pipeline.tile_facades import find_tile_facades, street_points

HOUSE = BuildingOutline(77, Outline(np.array([[0.5, 0.3], [9.5, 0.3], [9.5, 8.0], [0.5, 8.0]])))
FAR = BuildingOutline(78, Outline(np.array([[30.5, 0.3], [39.5, 0.3], [39.5, 8.0]])))
FRAME = MapFrame("EPSG:28992", (85_000.0, 447_000.0, 0.0))


def street(view=View.STREET):
    """A wall along the x axis, seen from 0.3 to 3 m, and the ground south of it."""
    x, z = (each.ravel() for each in np.meshgrid(np.arange(0.0, 10.0, 0.15), np.arange(0.3, 3.0, 0.15)))
    wall = np.column_stack([x, np.zeros(len(x)), z])
    x, y = (each.ravel() for each in np.meshgrid(np.arange(-1.0, 11.0, 0.4), np.arange(-5.0, 0.0, 0.4)))
    points = np.concatenate([wall, np.column_stack([x, y, np.zeros(len(x))])])
    classes = np.where(points[:, 2] > 0.0, PointClass.MEDIUM_VEGETATION, PointClass.GROUND)
    return PointTile(
        points,
        classification=classes,
        height_above_ground=points[:, 2],
        view=None if view is None else np.full(len(points), view),
    )


@pytest.fixture(scope="module")
def facade():
    (found,) = find_tile_facades(street_points(street()), (FAR, HOUSE), FacadesConfig())
    return found


def test_vegetation_that_stands_like_a_wall_is_the_wall_of_the_building_behind(facade):
    assert facade.building_id == 77
    assert facade.facade_id > 0
    assert facade.length == pytest.approx(9.9, abs=0.2)


@pytest.mark.parametrize("view", [None, View.ABOVE])
def test_what_was_seen_from_above_has_no_facades(view):
    tile = street_points(street(view))
    assert len(tile) == 0
    assert find_tile_facades(tile, (HOUSE,), FacadesConfig()) == ()


def test_facades_come_back_from_json_to_the_last_bit(facade):
    again = Facade.of_record(json.loads(json.dumps(facade.record)))
    assert again.record == facade.record


@pytest.mark.parametrize(
    "wrong", [{"foot": [[0.0, 0.0]]}, {"is_seen": []}, {"sigma": float("nan")}, {"top": None}, {"kind": ...}]
)
def test_records_of_another_form_are_refused(facade, wrong):
    record = facade.record | wrong
    if wrong == {"kind": ...}:
        del record["kind"]
    with pytest.raises((ValueError, LookupError, TypeError)):
        Facade.of_record(record)


def columns_of(path, layer):
    known, _, geometry, columns = pyogrio.raw.read(path, layer=layer)
    return dict(zip(known["fields"], columns, strict=True)) | {"geometry": geometry}


def test_layers_hold_upright_faces_and_lines_cut_where_seeing_ends(facade, tmp_path):
    seen = facade.is_seen.copy()
    seen[:4] = False
    known = {**facade.record, "is_seen": seen.tolist(), "building_id": -1}
    with building_layers_file(tmp_path / "a.gpkg", ModelHeading(frame=FRAME)) as add:
        add(Facade.of_record(known))
    faces, lines = (columns_of(tmp_path / "a.gpkg", name) for name in LAYERS)
    (face,) = shapely.from_wkb(faces["geometry"])
    corners = shapely.get_coordinates(face, include_z=True)
    assert corners[:, 2].min() == pytest.approx(facade.bottom)
    assert corners[:, 2].max() == pytest.approx(facade.top)
    assert np.isnan(faces["building_id"]).all()
    assert lines["seen"].tolist() == [0, 1]
    shapes = shapely.from_wkb(lines["geometry"])
    assert not shapely.has_z(shapes).any()
    assert shapely.length(shapes).sum() == pytest.approx(facade.length)
    assert shapely.get_coordinates(shapes)[0] == pytest.approx(facade.foot[0] + FRAME.origin[:2])


LAYERS = ("facades", "street_lines")


def test_without_facades_there_are_no_layers_of_them(tmp_path):
    with building_layers_file(tmp_path / "a.gpkg", ModelHeading(frame=FRAME)):
        pass
    assert not set(LAYERS) & {name for name, _ in pyogrio.list_layers(tmp_path / "a.gpkg")}
    with flatgeobuf_files(tmp_path / "x", ModelHeading(frame=FRAME)):
        pass
    assert not list(tmp_path.glob("facades*"))
