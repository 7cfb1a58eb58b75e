"""Virtual scanners on the move: what they send leads back to the truth."""

import itertools
from collections import Counter
from dataclasses import replace
from functools import cache

import laspy
import numpy as np
import pyproj
import pytest
import shapely
from scipy.spatial.transform import Rotation
from support.level_truth import in_grid

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.bags.bag import Bag
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.bags.placed_cloud import write_placed
from lidar_buildings.io.tiling.map_place import Geodetic
from lidar_buildings.simulation import SimulationConfig, make_scene
from lidar_buildings.simulation.live import BodyPose, Scan, VehicleConfig, drive, fly
from lidar_buildings.simulation.live.messages import LiveMessages, SurveyBag
from lidar_buildings.simulation.live.moving_survey import mounting_pose
from lidar_buildings.simulation.scanner import StripPoints, joined, scan
from lidar_buildings.simulation.survey import SurveyFiles

FLIGHT = SimulationConfig(density=0.3)
DRIVE = VehicleConfig(beams=16, pulse_rate=20_000.0, speed=20.0)
NOISELESS = replace(DRIVE, range_noise=0.0)
STILL = {"position_noise": 0.0, "angle_noise_deg": 0.0, "position_drift": 0.0}


@pytest.fixture(scope="module")
def flight():
    return fly(make_scene("village"), 3, FLIGHT, 7_500.0)


@pytest.fixture(scope="module")
def ride():
    return drive(make_scene("dense_block"), 3, DRIVE)


@pytest.fixture(scope="module", params=["flight", "ride"])
def survey(request):
    return request.getfixturevalue(request.param)


@cache
def scans(survey):
    return [event for event in survey.events() if isinstance(event, Scan)]


def truth_of(survey):
    return joined([one.truth for one in scans(survey)])


def recorded(survey, path, n_events=None, **how):
    """Write a bag of a survey, or of its first events."""
    with SurveyBag(path, survey, **how) as bag:
        for event in itertools.islice(survey.events(), n_events):
            bag.add(event)
    return path


def errors_of(survey, tmp_path, mounting=None, antenna="", **bag):
    """How far from the truth the points of the survey's bag are placed [m]."""
    config = ScanConfig(mounting=survey.mounting if mounting is None else mounting, antenna=antenna)
    path = recorded(survey, tmp_path / "bag", **bag)
    count = write_placed(path, tmp_path / "placed.laz", BagConfig(), config)
    truth, las = truth_of(survey), laspy.read(tmp_path / "placed.laz")
    places = survey.scene.frame.to_source(truth.points)
    if bag.get("with_fix"):
        origin = pyproj.Transformer.from_crs(25832, 4979, always_xy=True).transform(
            *survey.scene.frame.origin
        )
        places = in_grid(truth.points, Geodetic(*origin), "EPSG:32632")
        assert "points east" in count.place
    assert count.n_points == len(truth.points)
    assert np.abs(las.gps_time - truth.gps_time).max() < 1e-6
    return np.linalg.norm(las.xyz - places, axis=1)


def test_placed_points_lie_within_two_centimetres_of_the_truth(survey, tmp_path):
    errors = errors_of(survey, tmp_path, with_tf=False)
    assert np.quantile(errors, 0.95) < 0.02
    assert errors.max() < 0.05


# a hundredth of a radian at 300 m, and the lever arm
@pytest.mark.parametrize(
    ("mounting", "least"), [("0,0,0,0.4,-0.25,0.6", 0.5), ("0.35,-0.12,-0.45,0,0,0", 2.0)]
)
def test_without_lever_arm_or_boresight_they_lie_elsewhere(flight, tmp_path, mounting, least):
    assert np.median(errors_of(flight, tmp_path, mounting, with_tf=False)) > least


@pytest.mark.parametrize("config", [DRIVE, replace(DRIVE, is_profiler=True)])
def test_poses_that_are_told_wrong_place_the_points_as_the_files_have_them(tmp_path, config):
    scene = make_scene("dense_block")
    noisy = replace(
        config, speed=60.0, position_noise=0.05, angle_noise_deg=0.2, position_drift=0.1, range_noise=0.0
    )
    exact, survey = (drive(scene, 3, one) for one in (replace(noisy, **STILL), noisy))
    errors = errors_of(survey, tmp_path, with_tf=False)
    assert np.quantile(errors, 0.95) < 0.02
    off = np.linalg.norm(truth_of(survey).points - truth_of(exact).points, axis=1)
    assert 0.05 < np.median(off) < 0.5
    for name in ("true_building", "true_class", "true_part"):
        assert np.array_equal(getattr(truth_of(survey), name), getattr(truth_of(exact), name))


def test_transforms_tell_the_mounting_too(survey, tmp_path):
    assert np.quantile(errors_of(survey, tmp_path, mounting=""), 0.95) < 0.02


@pytest.mark.parametrize(("antenna", "least", "most"), [("-1.2,0.3,2.0", 0.0, 0.02), ("", 2.0, 3.0)])
def test_a_fix_is_where_the_antenna_is(flight, tmp_path, monkeypatch, antenna, least, most):
    fix = LiveMessages._fix

    def fix_of_antenna(self, event):
        place, attitude = np.array(event.pose.translation), Rotation.from_quat(event.pose.quaternion)
        place += attitude.apply([-1.2, 0.3, 2.0])
        return fix(self, replace(event, pose=event.pose._replace(translation=tuple(place))))

    monkeypatch.setattr(LiveMessages, "_fix", fix_of_antenna)
    errors = errors_of(flight, tmp_path, antenna=antenna, with_fix=True)
    assert least <= errors.min()
    assert errors.max() < most
    assert laspy.read(tmp_path / "placed.laz").header.parse_crs().to_epsg() == 32632


def test_scans_and_poses_come_in_the_order_of_time_the_poses_at_their_rate(survey):
    events = list(survey.events())
    sent = np.array([event.sent for event in events])
    assert (np.diff(sent) >= 0).all()
    stamps = np.array([event.stamp for event in events if isinstance(event, BodyPose)])
    steps = np.diff(stamps) * 1e-9
    turns = steps > 1.0
    assert turns.sum() == len(survey.legs) - 1
    assert np.allclose(steps[~turns], 1.0 / survey.pose_rate, atol=2e-9)
    for event in events:
        if isinstance(event, Scan):
            assert stamps[0] < event.stamp < event.sent < stamps[-1]


def test_the_same_seed_gives_the_same_scans_and_another_seed_others(survey):
    one, same = (next(e for e in survey.events() if isinstance(e, Scan)) for _ in range(2))
    assert np.array_equal(one.rows, same.rows)
    make, config = (fly, FLIGHT) if len(one.rows) == 1 else (drive, DRIVE)
    other = make(survey.scene, 4, config)
    assert not np.array_equal(next(e for e in other.events() if isinstance(e, Scan)).rows, one.rows)


def test_the_points_of_a_flight_are_those_of_the_same_survey_as_files(flight):
    files, live = joined(list(scan(flight.scene, 3, FLIGHT))), truth_of(flight)
    assert len(files.points) == len(live.points)
    # live they are rounded to millimetres; and the terrain is found from another first guess
    assert np.abs(files.points - live.points).max() < 1e-3
    for name in ("intensity", "true_class", "true_building", "return_number", "point_source_id"):
        assert np.array_equal(getattr(files, name), getattr(live, name))


def test_the_pulse_rate_is_the_one_asked_for():
    field = make_scene("flat_terrain_empty")
    survey = fly(field, 0, SimulationConfig(density=5.0, max_scan_angle_deg=5.0), 20_000.0)
    middle = scans(survey)[len(scans(survey)) // 2]
    # times are known to a quarter of a microsecond
    step = np.median(np.diff(np.unique(middle.rows["timestamp"])))
    assert 1 / step == pytest.approx(20_000.0, rel=0.06)


def test_a_flight_too_fast_for_the_default_says_what_to_set(flight):
    fast = fly(flight.scene, 0, FLIGHT, 90_000.0)
    assert set(flight.settings) == {"scan_assembler.mounting"}
    assert float(fast.settings["scan_assembler.max_speed"]) > fast.legs[0].speed > 150.0


def test_spinning_scans_are_organised_and_hold_zeros_where_nothing_comes_back(ride):
    for one in scans(ride)[:3]:
        assert one.rows.shape == (16, 125)
        assert {len(getattr(one.truth, name)) for name in StripPoints.__dataclass_fields__} == {
            len(one.truth.points)
        }
        distance = np.linalg.norm([one.rows[axis] for axis in "xyz"], axis=0)
        assert 0 < (distance == 0).sum() < distance.size
        assert (distance > 0).sum() == len(one.truth.points)
        assert np.abs(one.rows["range"] - distance * 1000.0).max() < 0.51
        assert one.rows["t"].max() < 100_000_000
        assert (np.diff(one.rows["t"].astype(int), axis=1) > 0).all()


def test_what_a_vehicle_sees_lies_on_the_surfaces_that_it_is_said_to_lie_on():
    scene = make_scene("dense_block")
    truth = truth_of(drive(scene, 0, NOISELESS))
    ground = truth.true_class == PointClass.GROUND
    assert np.abs(truth.points[ground, 2] - scene.terrain.at(truth.points[ground, :2])).max() < 1e-3
    facade = (truth.true_building > 0) & (truth.true_plane == 0)
    assert ground.sum() > 1000
    assert facade.sum() > 1000
    for building in scene.buildings:
        rows = facade & (truth.true_building == building.number)
        distance = shapely.distance(building.polygon.exterior, shapely.points(truth.points[rows, :2]))
        assert (distance < 1e-3).all()


def test_no_ray_of_a_vehicle_goes_through_a_house_or_the_ground():
    scene = make_scene("dense_block")
    survey = drive(scene, 0, NOISELESS)
    leg = survey.legs[0]
    (one,) = (scan for number, scan in enumerate(survey.scans_of(leg)) if number == 20)
    times = one.rows["t"].ravel()[one.rows["range"].ravel() > 0]
    sensor = leg.at((one.stamp - leg.stamp + times) * 1e-9).of_mounted(mounting_pose(survey.mounting)).place
    # each way from the scanner to a point, up to 2 cm before it, in steps of 5 cm and more
    way = one.truth.points - sensor
    length = np.linalg.norm(way, axis=1)
    share = np.linspace(0.0, 1.0, 1000)[:, None, None] * (1.0 - 0.02 / length)[:, None]
    samples = (sensor + share * way).reshape(-1, 3)
    assert (samples[:, 2] > scene.terrain.at(samples[:, :2])).all()
    for building in scene.buildings:
        near = shapely.intersects_xy(building.polygon, *samples[:, :2].T)
        _, roof = building.roof_at(samples[near, :2])
        assert (samples[near, 2] > roof - 1e-6).all()


def test_rays_upwards_meet_roofs_and_crowns_and_end_at_the_range():
    scene = make_scene("village")
    survey = drive(scene, 0, replace(DRIVE, max_range=60.0))
    counts = Counter()
    for one in scans(survey):
        counts.update(one.truth.true_class.tolist())
        counts["roof"] += int((one.truth.true_plane > 0).sum())
        assert one.rows["range"].max() <= 60_200
    assert counts["roof"] > 100
    assert counts[int(PointClass.HIGH_VEGETATION)] > 100
    assert counts[int(PointClass.UNCLASSIFIED)] > 100  # cars


def test_a_scene_without_streets_and_a_pulse_rate_of_zero_are_refused():
    with pytest.raises(ParameterError, match=r"single_house.*no street"):
        drive(make_scene("single_house"))
    with pytest.raises(ParameterError, match=r"pulse rate = 0: must be above 0"):
        fly(make_scene("single_house"), pulse_rate=0)


@pytest.mark.parametrize(("with_fix", "tells"), [(False, "/map_origin"), (True, "/fix")])
def test_a_bag_tells_where_the_map_lies(flight, tmp_path, with_fix, tells):
    recorded(flight, tmp_path / "bag", 100, with_fix=with_fix)
    with Bag(tmp_path / "bag") as bag:
        names = {topic.name for topic in bag.topics}
        (first, *_) = bag.messages([tells])
    base = {"/scan", "/odometry", "/tf", "/tf_static", "/clock"}
    assert names == {*base, tells}
    if with_fix:
        assert first.message.latitude == pytest.approx(53.52, abs=0.01)
        assert first.message.longitude == pytest.approx(9.98, abs=0.01)
    else:
        assert first.message.header.frame_id == "EPSG:25832"


def test_the_files_of_a_survey_on_the_move_hold_its_points_and_the_truth(survey, tmp_path):
    (tmp_path / "strip_09.laz").write_text("of an earlier survey")
    with SurveyFiles(tmp_path, survey.scene) as files:
        for one in scans(survey):
            if len(one.truth.points):
                files.add(int(one.truth.point_source_id[0]), one.truth)
    names = [f"strip_0{leg.number}.laz" for leg in survey.legs] + ["truth.gpkg", "truth.city.jsonl"]
    assert [path.name for path in files.files] == names
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    clouds = [laspy.read(path) for path in files.files[:-2]]
    truth = truth_of(survey)
    xyz = survey.scene.frame.to_source(truth.points)
    assert np.abs(np.concatenate([las.xyz for las in clouds]) - xyz).max() < 0.001
    assert np.array_equal(np.concatenate([las.TrueBuilding for las in clouds]), truth.true_building)
    assert np.array_equal(np.concatenate([las.gps_time for las in clouds]), truth.gps_time)


def test_what_keeps_the_files_from_being_whole_leaves_no_truth(flight, tmp_path):
    def fail_at_once():
        with SurveyFiles(tmp_path / "survey", flight.scene):
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        fail_at_once()
    assert list((tmp_path / "survey").iterdir()) == []
