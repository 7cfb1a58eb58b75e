"""A bag's scans placed in the map, as one LAZ file that everything after it reads like any other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from lidar_buildings.core.model.errors import InputError, MessageError
from lidar_buildings.core.scans.config import MOST_LOST, ScanConfig
from lidar_buildings.core.scans.placing import NO_POSE, UNREADABLE, ScanPlacer, lost_share
from lidar_buildings.core.scans.seen_points import SeenPoints
from lidar_buildings.io.bags.bag import CLOUD, FIX, ODOMETRY, POINT, TRANSFORMS, VECTOR, Bag, BagMessage
from lidar_buildings.io.bags.bag_inputs import BagConfig, is_point_file
from lidar_buildings.io.bags.bag_summary import choose_topics, chosen_messages, told_frame, with_frames
from lidar_buildings.io.bags.point_files import write_points
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.reference_systems import check_metres, true_frame
from lidar_buildings.io.tiling.live_feed import LiveFeed
from lidar_buildings.io.tiling.map_place import MapPlace, SatelliteFixes
from lidar_buildings.io.tiling.placed_laz import FAR, PlacedLaz

#: Fixes whose poses are looked up at once: before the poses are so many that the first are forgotten.
_BATCH = 100


class PlacedCount(NamedTuple):
    """What became of a bag's points, as ``run.json`` tells it."""

    #: Scans that were read, points that were placed.
    n_scans: int
    n_points: int
    left_out: dict[str, int]  #: reason → points
    messages: dict[str, int]  #: what is to be said of messages → how many
    place: str  #: how satellites told where the map lies, empty if they did not
    warnings: list[str]  #: what is doubtful
    lost: float = 0.0  #: share of the measured points that are left out


def write_placed(bag_path: Path, path: Path, choice: BagConfig, config: ScanConfig) -> PlacedCount:
    """
    Place the scans of a bag and write them to a LAZ file.

    Points are in the order in which they were recorded; GPS times are the points' own. InputError if the bag
    cannot be read, a topic is missing, or nothing says where the scans were made; OutputError if the file
    cannot be written.
    """
    if is_point_file(bag_path):
        n_points, left_out = write_points(bag_path, path)
        return PlacedCount(1, n_points, left_out, {}, "", [], 0.0)
    with Bag(bag_path) as bag, atomic_file(path) as temporary:
        topics = choose_topics(bag, choice.topic, choice.odometry)
        frames = with_frames(bag, topics, config).tree
        placer = ScanPlacer(config, SeenPoints(), frames)
        file = PlacedLaz(temporary)
        place = MapPlace()
        try:
            if topics.fix and not topics.origin:
                poses = chosen_messages(bag, topics._replace(clouds=""), choice)
                place = _place_by_fixes(poses, ScanPlacer(config, frames=frames), file)
            frame = place.frame
            for message in chosen_messages(bag, topics, choice):
                hand_over(message, placer)
                if message.type in (POINT, VECTOR):
                    frame = told_frame(message, frame)
                    file.place(frame if config.georeferenced else true_frame(frame))
                for scan in placer.placed():
                    file.add(place.placed(scan))
            for scan in placer.placed(is_end=True):
                file.add(place.placed(scan))
        except InputError as error:
            raise InputError(str(error) if str(bag_path) in str(error) else f"{bag_path}: {error}") from error
        finally:
            file.close()
        if not file.n_points and (why := placer.refusal or bag.why_unreadable):
            raise InputError(f"{bag_path}: {why}")
        if not file.n_points and placer.left_out[NO_POSE]:
            n, told = placer.left_out[NO_POSE], placer.messages.items()
            said = "".join(f"; {number:,} {what}" for what, number in told)
            raise InputError(
                f"{bag_path}: none of its {n} points could be placed: no pose at their times: "
                f"{placer.why_no_pose()}{said}"
            )
        check_metres(bag_path, file.n_points, file.size)
    left_out = placer.left_out + Counter({FAR: file.n_far})
    messages = placer.messages + Counter({UNREADABLE: bag.unreadable[topics.clouds]})
    warnings = [*place.warnings, *placer.doubts]
    lost = lost_share(left_out, file.n_points)
    if lost > MOST_LOST:
        warnings.append(f"{lost:.1%} of its points are left out: {placer.why_left_out(left_out)}")
    if why := placer.unreadable or bag.why_unreadable:
        warnings.append(f"one of the messages that cannot be read: {why}")
    return PlacedCount(
        placer.n_scans,
        file.n_points,
        dict(sorted(left_out.items())),
        dict(sorted(messages.items())),
        place.said,
        warnings,
        lost,
    )


def _place_by_fixes(messages: Iterator[BagMessage], placer: ScanPlacer, file: PlacedLaz) -> MapPlace:
    """Say, and return, where the map lies by the fixes that poses stand beside."""
    fixes = SatelliteFixes()
    for message in messages:
        hand_over(message, placer)
        if message.type == FIX:
            fixes.take(message.message, placer)
            if fixes.n_usable % _BATCH == 0:
                fixes.pair(placer)
    fixes.pair(placer)
    place = fixes.place() or fixes.no_place()
    file.place(place.frame)
    return place


def hand_over(message: BagMessage, placer: ScanPlacer | LiveFeed) -> None:
    """Give a scan, or poses, to what places them."""
    if message.type == CLOUD:
        with suppress(MessageError):  # the placer counts it
            placer.add_scan(message.message)
    elif message.type == ODOMETRY:
        placer.add_odometry(message.message)
    elif message.type == TRANSFORMS:
        placer.add_transforms(message.message, is_static=message.topic.endswith("static"))
