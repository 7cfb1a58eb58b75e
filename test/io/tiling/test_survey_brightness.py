import laspy
import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.io.tiling.spool import RECORD
from lidar_buildings.io.tiling.survey_brightness import SurveyBrightness
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig
from lidar_buildings.pipeline.tile_stages import filter_ground, select_roof_points

SIDE, SPACING = 160.0, 0.8
GRASS, ASPHALT, ROOF = 150.0, 60.0, 110.0
#: How two strips record a brightness, as 8- and as 16-bit numbers.
GAINS = {706: (1.0, 0.0), 707: (200.0, 3000.0)}


def save_strip_files(folder, *, roads=True, seed=0, scale=1.0):
    """Write a suburb with roads of 8 m and houses of 10 m as two files, west and east, of two strips each."""
    random = np.random.default_rng(seed)
    for number, west in enumerate((0.0, SIDE)):
        x, y = (
            each.ravel()
            for each in np.meshgrid(np.arange(west, west + SIDE, SPACING), np.arange(0.0, SIDE, SPACING))
        )
        on_road = roads & ((abs(x % 80 - 40) < 4) | (abs(y % 80 - 40) < 4))
        on_roof = (abs((x + 20) % 40 - 20) < 5) & (abs((y + 20) % 40 - 20) < 5) & ~on_road
        brightness = np.select([on_roof, on_road], [ROOF, ASPHALT], GRASS)
        brightness = brightness * random.normal(1.0, 0.08, len(x))
        strip = np.where(y < SIDE / 2, 706, 707)
        gain, offset = np.array([GAINS[s] for s in strip.tolist()]).T
        las = laspy.LasData(laspy.LasHeader(point_format=1, version="1.2"))
        las.header.scales, las.header.offsets = [0.001] * 3, [0.0] * 3
        las.x, las.y, las.z = 85_000 + scale * x, 447_000 + scale * y, np.where(on_roof, 9.0, 3.0)
        las.intensity = np.clip(np.rint(brightness * gain + offset), 0, 65_535).astype(np.uint16)
        las.point_source_id = strip.astype(np.uint16)
        las.return_number = las.number_of_returns = np.ones(len(x), dtype=np.uint8)
        las.classification = np.where(on_road, 30, 0).astype(np.uint8)  # the truth, to be carried along
        las.write(folder / f"{number}.laz")


def tiles_of(folder, tile_size):
    with TileSource(folder, TilingConfig(tile_size=tile_size, buffer=20.0, max_buffer=20.0)) as source:
        return [tile.read() for tile in source.ready()]


def test_all_tiles_have_one_scale_and_one_limit_whatever_their_size(tmp_path):
    save_strip_files(tmp_path)
    found = {}
    for tile_size in (60.0, 200.0):
        values = {}
        for tile in tiles_of(tmp_path, tile_size):
            assert tile.normalised_intensity.dtype == np.float32
            rows = zip(tile.source.tolist(), tile.index.tolist(), strict=True)
            values.update(zip(rows, tile.normalised_intensity.tolist(), strict=True))
            found.setdefault("limit", set()).add(tile.dark_limit)
        found.setdefault("values", []).append(values)
    assert len(found["limit"]) == 1
    assert found["values"][0] == found["values"][1]
    assert len(found["values"][0]) == 2 * 200 * 200


def test_8_and_16_bit_strips_mean_the_same(tmp_path):
    save_strip_files(tmp_path)
    (tile,) = tiles_of(tmp_path, 1000.0)
    ground = tile.points[:, 2] < 5
    for truth in (tile.classification == 30, (tile.classification == 0) & ground):
        medians = [np.median(tile.normalised_intensity[truth & (tile.point_source_id == s)]) for s in GAINS]
        assert abs(medians[0] - medians[1]) < 5.0
    assert np.median(tile.intensity[tile.point_source_id == 707]) > 10_000


def test_tiles_too_small_to_show_two_modes_still_find_their_roads(tmp_path):
    save_strip_files(tmp_path)
    for tile in tiles_of(tmp_path, 60.0):
        result = select_roof_points(
            filter_ground(tile, GroundFilterConfig(kept_classes=())).tile, RoofSelectionConfig()
        )
        truth = tile.classification == 30
        found = result.classification == 11
        assert (found & truth).sum() > 0.85 * max(truth.sum(), found.sum())


def test_sparse_surveys_show_their_modes_on_a_wider_square(tmp_path):
    """In a square of 250 m few cells are without an edge of a road in them."""
    save_strip_files(tmp_path, scale=4.0)
    limits = {tile.dark_limit for tile in tiles_of(tmp_path, 240.0)}
    assert len(limits) == 1
    assert ASPHALT < limits.pop() < GRASS


def test_a_survey_without_roads_has_no_limit(tmp_path):
    save_strip_files(tmp_path, roads=False)
    assert all(tile.dark_limit is None for tile in tiles_of(tmp_path, 200.0))


def test_a_survey_without_intensities_is_dark_and_has_no_limit(tmp_path):
    save_strip_files(tmp_path)
    for path in tmp_path.glob("*.laz"):
        las = laspy.read(path)
        las.intensity[:] = 0
        las.write(path)
    for tile in tiles_of(tmp_path, 200.0):
        assert tile.dark_limit is None
        assert not tile.normalised_intensity.any()


def test_what_was_said_of_a_strip_stays_true():
    records = np.ones(5000, RECORD)
    records["intensity"] = np.linspace(0.0, 1000.0, 5000)
    survey = SurveyBrightness()
    assert survey.normalised(records["intensity"], records["point_source_id"]) is None
    survey.add(0, 0, records, len(records))
    survey.learn(0)
    before = survey.normalised(records["intensity"], records["point_source_id"])
    brighter = records.copy()
    brighter["intensity"] *= 7
    survey.add(1, 0, brighter, len(brighter))
    survey.learn(1)
    after = survey.normalised(records["intensity"], records["point_source_id"])
    np.testing.assert_array_equal(before, after)
    assert before.max() == pytest.approx(200 * 990 / 940, rel=0.01)


def test_a_file_that_cannot_be_read_leaves_no_trace():
    records = np.ones(5000, RECORD)
    survey = SurveyBrightness()
    survey.add(0, 0, records, len(records))
    survey.forget(0)
    survey.learn(0)
    assert survey.normalised(records["intensity"], records["point_source_id"]) is None


@pytest.mark.parametrize("shift", [(0.0, 0.0), (-400.0, 0.0), (0.0, -400.0)], ids=["origin", "west", "south"])
def test_the_limit_is_found_wherever_points_lie_about_the_origin(shift):
    random = np.random.default_rng(0)
    x, y = (
        axis.ravel() for axis in np.meshgrid(np.arange(0.0, 240.0, SPACING), np.arange(0.0, 240.0, SPACING))
    )
    on_roof = (abs(x % 60 - 30) < 10) & (abs(y % 60 - 30) < 10)
    on_road = (x % 60 < 12) & ~on_roof
    records = np.zeros(len(x), RECORD)
    records["x"], records["y"], records["z"] = x + shift[0], y + shift[1], np.where(on_roof, 9.0, 3.0)
    brightness = np.select(
        [on_roof, on_road], [20.0, ASPHALT], GRASS
    )  # a roof taken for ground is the darkest
    records["intensity"] = brightness * random.normal(1.0, 0.05, len(x))
    survey = SurveyBrightness()
    survey.add(0, 0, records, len(records), Rectangle(-1000.0, -1000.0, 1000.0, 1000.0))
    survey.learn(0)
    normalised = survey.normalised(records["intensity"], records["point_source_id"])
    assert np.median(normalised[on_road]) < survey.dark_limit < np.median(normalised[~(on_road | on_roof)])
