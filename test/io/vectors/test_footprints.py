"""Footprints from files of every kind, good and bad."""

import logging

import laspy
import numpy as np
import pyproj
import pytest
import shapely
from support.vector_files import write_vectors

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.footprints.footprints import assign_footprints
from lidar_buildings.io.files.failures import SAID
from lidar_buildings.io.vectors.footprints import FootprintSource, check_overlap, read_footprints

RD = "EPSG:28992"
FRAME = MapFrame(RD, (85_000.0, 447_000.0, 0.0))
HOUSES = [
    shapely.box(85_010.5, 447_010.25, 85_020.125, 447_018.0),
    shapely.Polygon([(85_020.125, 447_010.25), (85_028, 447_011), (85_028, 447_018), (85_020.125, 447_018)]),
    shapely.Polygon(
        shapely.box(85_040, 447_040, 85_060, 447_060).exterior,
        [shapely.box(85_045, 447_045, 85_050, 447_050).exterior],
    ),
]


@pytest.fixture(autouse=True)
def every_warning_anew():
    SAID.clear()


def read(path, layer="", column="", frame=FRAME):
    return read_footprints(FootprintSource(path, layer, column), frame)


def in_degrees(shapes):
    turn = pyproj.Transformer.from_crs(RD, "EPSG:4326", always_xy=True).transform
    return [shapely.transform(s, lambda xy: np.column_stack(turn(xy[:, 0], xy[:, 1]))) for s in shapes]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("footprints")


@pytest.fixture(scope="module")
def expected(folder):
    return read(write_vectors(folder / "expected.gpkg", HOUSES))


@pytest.mark.parametrize("ending", ["gpkg", "shp", "fgb", "geojson", "gml", "kml"])
def test_every_format_and_reference_system_gives_the_same_footprints(folder, expected, ending):
    degrees = ending in ("geojson", "kml")
    options = {"geojson": {"COORDINATE_PRECISION": "12"}, "kml": {"driver": "LIBKML"}}.get(ending, {})
    shapes, crs = (in_degrees(HOUSES), "EPSG:4326") if degrees else (HOUSES, RD)
    found = read(write_vectors(folder / f"houses.{ending}", shapes, crs=crs, **options))
    # formats store features in their own order
    order, wanted = (np.argsort(each.footprints.building_id) for each in (found, expected))
    assert np.array_equal(found.footprints.building_id[order], expected.footprints.building_id[wanted])
    for one, other in zip(order, wanted, strict=True):
        mine, theirs = found.footprints.outlines[one].polygon, expected.footprints.outlines[other].polygon
        assert mine.normalize().equals_exact(theirs.normalize(), 0.0 if ending != "kml" else 0.002)


def test_clouds_in_feet_get_their_footprints_in_metres(folder):
    shapes = [shapely.box(1000, 2000, 1100, 2050)]
    frame = MapFrame("", (300.0, 600.0, 0.0), 0.3048, 0.3048)
    found = read(write_vectors(folder / "feet.gpkg", shapes, crs=None), frame=frame)
    assert found.footprints.bounds[0] == pytest.approx([4.8, 9.6, 35.28, 24.84], abs=0.001)


@pytest.mark.parametrize(("file_crs", "cloud_crs", "who"), [(None, RD, "footprints"), (RD, "", "clouds")])
def test_what_names_no_reference_system_is_taken_to_be_in_the_others_with_a_warning(
    folder, expected, caplog, file_crs, cloud_crs, who
):
    path = write_vectors(folder / f"{who}.gpkg", HOUSES, crs=file_crs)
    with caplog.at_level(logging.WARNING):
        found = read(path, frame=MapFrame(cloud_crs, FRAME.origin))
    assert np.array_equal(found.footprints.building_id, expected.footprints.building_id)
    (record,) = caplog.records
    assert f"the {who} name no coordinate reference system" in record.message


def test_the_record_tells_what_was_repaired_and_left_out(folder):
    bowtie = shapely.Polygon([(85_100, 447_000), (85_110, 447_010), (85_110, 447_000), (85_100, 447_010)])
    sliver = shapely.box(85_000, 447_000, 85_030, 447_000.01)
    path = write_vectors(folder / "mixed.gpkg", [*HOUSES, bowtie, HOUSES[0], sliver, None])
    found = read(path)
    assert found.record["n_read"] == 7
    assert found.record["n_used"] == len(found.footprints) == 5
    assert found.record["n_repaired"] == 1
    assert found.record["left_out"] == {"drawn twice": 1, "empty": 1, "too small or too narrow": 1}


def test_curves_are_drawn_with_straight_lines(folder):
    text = folder / "curved.csv"
    arc = "CURVEPOLYGON(CIRCULARSTRING(85000 447000,85020 447000,85000 447000))"
    text.write_text(f'WKT,id\n"{arc}",7\n')
    found = read(text)
    assert found.footprints.area[0] == pytest.approx(np.pi * 100, rel=0.01)
    assert list(found.footprint_id.values()) == ["7"]


@pytest.mark.parametrize(
    ("columns", "asked", "names"),
    [
        ({}, "", {"1", "2", "3"}),
        ({"height": [1.0, 2.0, 3.0], "ID": [7, 8, 9]}, "", {"7", "8", "9"}),
        ({"id": [7, 8, 9], "identificatie": ["a", "b", "c"]}, "", {"a", "b", "c"}),
        ({"id": [7.0, np.nan, 9.5]}, "", {"7", "", "9.5"}),
        ({"id": [7, 8, 9], "Straße": ["ä", "ö", "ü"]}, "Straße", {"ä", "ö", "ü"}),
    ],
)
def test_footprints_are_called_what_their_file_calls_them(tmp_path, columns, asked, names):
    found = read(write_vectors(tmp_path / "named.gpkg", HOUSES, columns=columns), column=asked)
    assert set(found.footprint_id.values()) == names
    assert set(found.footprint_id) == set(found.footprints.building_id.tolist())


def test_the_parts_of_one_feature_are_numbered(tmp_path):
    both = shapely.MultiPolygon(HOUSES[:2])
    path = write_vectors(
        tmp_path / "parts.gpkg", [both, HOUSES[2]], kind="MultiPolygon", columns={"id": ["a", "b"]}
    )
    assert sorted(read(path).footprint_id.values()) == ["a-1", "a-2", "b"]


def test_a_changed_file_is_read_anew_and_an_unchanged_one_is_not(tmp_path):
    path = write_vectors(tmp_path / "changing.gpkg", HOUSES)
    first = read(path)
    assert read(path) is first
    path.unlink()
    assert len(read(write_vectors(path, HOUSES[:1])).footprints) == 1


def test_of_several_layers_one_is_named_but_not_the_only_one_of_polygons_or_of_earlier_results(tmp_path):
    path = tmp_path / "town.gpkg"
    for name in ("houses", "sheds"):
        write_vectors(path, HOUSES, layer=name, append=path.exists())
    write_vectors(path, [shapely.Point(0, 0)], kind="Point", layer="trees", append=True)
    with pytest.raises(InputError, match=r"houses, sheds\): choose one with --footprints-layer"):
        read(path)
    with pytest.raises(InputError, match="has no layer 'cars': its layers are houses, sheds, trees"):
        read(path, "cars")
    assert read(path, "sheds").record["layer"] == "sheds"
    path = write_vectors(tmp_path / "one.gpkg", HOUSES, layer="houses")
    write_vectors(path, [shapely.Point(0, 0)], kind="Point", layer="trees", append=True)
    assert read(path).record["layer"] == "houses"
    write_vectors(path, HOUSES, layer="outlines", append=True)
    assert read(path).record["layer"] == "outlines"


def text_file(path):
    path.write_text("no polygons at all")
    return path


BAD = {
    "no vector file": (
        lambda folder: text_file(folder / "text.gpkg"),
        "cannot be read as a file of polygons",
    ),
    "empty file": (
        lambda folder: write_vectors(folder / "none.gpkg", []),
        "contains no polygon .*no feature",
    ),
    "only points": (
        lambda folder: write_vectors(folder / "trees.gpkg", [shapely.Point(1, 2)], kind="Point"),
        r"has no layer of polygons \(Point\)",
    ),
    "points in a layer of anything": (
        lambda folder: write_vectors(folder / "any.gpkg", [shapely.Point(1, 2)], kind="Unknown"),
        r"contains no polygon to use .*1 no polygon",
    ),
    "no geometry": (lambda folder: table(folder / "table.csv"), r"has no layer of polygons \(no geometry\)"),
    "missing": (lambda folder: folder / "nowhere.gpkg", "no such file"),
}


def table(path):
    path.write_text("name,height\na,1\n")
    return path


@pytest.mark.parametrize("case", BAD)
def test_a_file_without_footprints_is_refused_in_one_line(tmp_path, case):
    make, words = BAD[case]
    path = make(tmp_path)
    with pytest.raises(InputError, match=words) as refused:
        read(path)
    assert str(refused.value).startswith(f"{path}")
    assert "\n" not in str(refused.value)


def test_a_column_that_is_not_there_is_refused_by_name(tmp_path):
    path = write_vectors(tmp_path / "named.gpkg", HOUSES, columns={"id": [1, 2, 3]})
    with pytest.raises(InputError, match="has no column 'nummer': its columns are id"):
        read(path, column="nummer")


def test_footprints_somewhere_else_are_refused_with_both_extents(expected):
    check_overlap(expected, (85_000.0, 447_000.0, 85_015.0, 447_015.0), FRAME)
    with pytest.raises(InputError, match=r"x 85010 to 85060 and y 447010 to 447060.*x 0 to 9 and y 0 to 9"):
        check_overlap(expected, (0.0, 0.0, 9.0, 9.0), FRAME)


@pytest.mark.real_data
def test_every_building_of_a_real_map_has_its_points(data_folder):
    cloud = laspy.read(data_folder / "delft" / "ahn3_cropped_1.laz")
    found = read(data_folder / "delft" / "buildings_nw.gpkg", frame=MapFrame("", (84_800.0, 447_400.0, 0.0)))
    points = np.column_stack([cloud.x, cloud.y, cloud.z]) - (84_800.0, 447_400.0, 0.0)
    tile = PointTile(points, classification=np.asarray(cloud.classification))
    assigned = assign_footprints(tile, found.footprints)
    assert len(assigned.outlines) == len(found.footprints) == 87
    numbers, n_points = np.unique(assigned.building_id, return_counts=True)
    assert sorted(numbers.tolist()) == [0, *sorted(found.footprints.building_id.tolist())]
    assert n_points.min() > 30


def test_degrees_are_refused_where_the_clouds_name_no_reference_system(tmp_path):
    path = write_vectors(tmp_path / "degrees.gpkg", in_degrees(HOUSES), crs="EPSG:4326")
    with pytest.raises(
        InputError, match=r"is in degrees .* and the clouds name no coordinate reference system"
    ):
        read(path, frame=MapFrame("", FRAME.origin))


def test_coordinates_that_no_projection_knows_are_left_out(tmp_path):
    shapes = [*in_degrees(HOUSES), shapely.box(85_000, 447_000, 85_010, 447_010)]
    found = read(write_vectors(tmp_path / "mixed.gpkg", shapes, crs="EPSG:4326"))
    assert len(found.footprints) == 3
    assert sum(found.record["left_out"].values()) == 1
