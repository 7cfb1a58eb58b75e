import laspy
import numpy as np
import pytest
from support.cut_surveys import tiles_of

from lidar_buildings.core.neighbours.point_spacing import steady_spacing
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.io.clouds.point_columns import last_returns
from lidar_buildings.io.tiling.spool import RECORD
from lidar_buildings.io.tiling.survey_brightness import SurveyBrightness
from lidar_buildings.io.tiling.survey_spacing import expected_spacing
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig
from lidar_buildings.pipeline.tile_stages import filter_ground, select_roof_points
from lidar_buildings.simulation import simulate_survey

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


def strip_tiles(folder, tile_size):
    with TileSource(folder, TilingConfig(tile_size=tile_size, buffer=20.0, max_buffer=20.0)) as source:
        return [tile.read() for tile in source.ready()]


def test_all_tiles_have_one_scale_and_one_limit_whatever_their_size(tmp_path):
    save_strip_files(tmp_path)
    found = {}
    for tile_size in (60.0, 200.0):
        values = {}
        for tile in strip_tiles(tmp_path, tile_size):
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
    (tile,) = strip_tiles(tmp_path, 1000.0)
    ground = tile.points[:, 2] < 5
    for truth in (tile.classification == 30, (tile.classification == 0) & ground):
        medians = [np.median(tile.normalised_intensity[truth & (tile.point_source_id == s)]) for s in GAINS]
        assert abs(medians[0] - medians[1]) < 5.0
    assert np.median(tile.intensity[tile.point_source_id == 707]) > 10_000


def test_tiles_too_small_to_show_two_modes_still_find_their_roads(tmp_path):
    save_strip_files(tmp_path)
    for tile in strip_tiles(tmp_path, 60.0):
        result = select_roof_points(
            filter_ground(tile, GroundFilterConfig(kept_classes=())).tile, RoofSelectionConfig()
        )
        truth = tile.classification == 30
        found = result.classification == 11
        assert (found & truth).sum() > 0.85 * max(truth.sum(), found.sum())


def test_sparse_surveys_show_their_modes_on_a_wider_square(tmp_path):
    """In a square of 250 m few cells are without an edge of a road in them."""
    save_strip_files(tmp_path, scale=4.0)
    limits = {tile.dark_limit for tile in strip_tiles(tmp_path, 240.0)}
    assert len(limits) == 1
    assert ASPHALT < limits.pop() < GRASS


def test_a_survey_without_roads_has_no_limit(tmp_path):
    save_strip_files(tmp_path, roads=False)
    assert all(tile.dark_limit is None for tile in strip_tiles(tmp_path, 200.0))


def test_a_survey_without_intensities_is_dark_and_has_no_limit(tmp_path):
    save_strip_files(tmp_path)
    for path in tmp_path.glob("*.laz"):
        las = laspy.read(path)
        las.intensity[:] = 0
        las.write(path)
    for tile in strip_tiles(tmp_path, 200.0):
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


def lattice(spacing: float, side: float = 30.0) -> np.ndarray:
    x, y = np.meshgrid(np.arange(0.0, side, spacing), np.arange(0.0, side, spacing))
    return np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))


def test_a_pulse_counts_once_however_many_returns_it_has():
    points = np.repeat(lattice(0.5), 2, axis=0)
    return_number = np.tile([1, 2], len(points) // 2).astype(np.uint8)
    number_of_returns = np.full(len(points), 2, dtype=np.uint8)
    np.testing.assert_array_equal(last_returns(points, return_number, number_of_returns), points[1::2])


def test_without_return_numbers_every_point_is_a_pulse():
    assert len(last_returns(lattice(1.0), None, None)) == 900


def test_few_points_tell_nothing_of_the_survey():
    assert expected_spacing([]) is None
    assert expected_spacing([lattice(1.0)[:999]]) is None
    assert expected_spacing([lattice(0.5)[:1800], lattice(0.5)[1800:]]) == pytest.approx(0.5, rel=0.05)


def test_a_tile_takes_the_expected_spacing_unless_its_own_is_quite_another():
    assert steady_spacing(lattice(0.5), 0.45) == 0.45
    assert steady_spacing(lattice(0.5), 2.0) == pytest.approx(0.5, rel=0.2)


def test_all_tiles_of_a_survey_have_one_spacing_whatever_their_size(tmp_path):
    simulate_survey(tmp_path, "village", density=2.0)
    found = set()
    for tile_size in (70.0, 200.0):
        with TileSource(tmp_path, TilingConfig(tile_size=tile_size)) as source:
            found |= {tile.point_spacing for tile in tiles_of(source)}
    assert len(found) == 1


def test_a_survey_in_one_file_has_the_spacing_that_it_has_in_many(tmp_path):
    simulate_survey(tmp_path / "strips", "village", density=2.0)
    strips = [laspy.read(path) for path in sorted((tmp_path / "strips").glob("*.laz"))]
    assert len(strips) > 1
    whole = laspy.LasData(strips[0].header)
    records = np.concatenate([strip.points.array for strip in strips])
    whole.points = laspy.ScaleAwarePointRecord(
        records, strips[0].point_format, strips[0].header.scales, strips[0].header.offsets
    )
    whole.write(tmp_path / "whole.laz")
    found = []
    for path in (tmp_path / "strips", tmp_path / "whole.laz"):
        with TileSource(path, TilingConfig(tile_size=100.0)) as source:
            found.append({tile.point_spacing for tile in tiles_of(source)})
    assert found[0] == found[1]
    assert len(found[0]) == 1
