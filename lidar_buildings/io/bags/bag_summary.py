"""What a bag holds, what a run would take of it, and what it would miss."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import NamedTuple

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.placing import ScanPlacer
from lidar_buildings.core.scans.transform_tree import frame_name
from lidar_buildings.io.bags.bag import ODOMETRY, Bag, BagTopic, topic_contents
from lidar_buildings.io.bags.cut_mcap import open_bag
from lidar_buildings.io.bags.selection import BagTopics, choose_topics
from lidar_buildings.io.tiling.map_place import zone_of
from lidar_buildings.io.tiling.satellite_fixes import Fix

#: Messages of odometry that are looked at for the tree of frames; wide margin: one tells both.
_FIRST = 100
#: Satellite positions among which the first usable one is looked for: ten minutes and more.
_MOST_FIXES = 10_000


class BagSummary(NamedTuple):
    """A bag at a glance."""

    path: str
    start: int | None  #: when it begins [ns]
    seconds: float  #: how long it is [s]
    topics: list[BagTopic]  #: all, by name
    taken: BagTopics | None  #: what a run takes without options, None if it cannot choose
    notes: list[str]  #: how the scans are placed, or what is missing for it
    problem: str  #: why only a part of it can be read, empty if all can


def summarise_bag(path: Path) -> BagSummary:
    """
    Look into a bag, of an MCAP file that was cut off into what is whole; InputError if nothing can be read.
    """
    bag, problem = open_bag(path)
    with bag:
        topics, taken = topic_contents(bag), None
        try:
            taken = choose_topics(bag)
            notes = _placing(bag, topics, taken)
        except InputError as error:
            notes = [str(error).removeprefix(f"{bag.path}: ").split("; its topics:")[0]]
        return BagSummary(str(bag.path), bag.start, bag.seconds, topics, taken, notes, problem)


def _placing(bag: Bag, topics: list[BagTopic], taken: BagTopics) -> list[str]:
    """Say how the scans would be placed."""
    frame = frame_name(next(one.frame for one in topics if one.name == taken.clouds))
    map_frame = ScanConfig().map_frame
    placer = with_frames(bag, taken)
    notes = [_where(bag, taken)]
    if frame == map_frame:
        return [f"the scans are in frame {map_frame}: they are taken as they are", *notes]
    target = placer.target_of(frame)
    if target != frame:
        return [f"the scans are placed in frame {target}", *notes]
    known = ", ".join(placer.tree.frames)
    mounting = f"; or --set scan_assembler.mounting=…, if it is fixed to one of {known}" if known else ""
    return [
        f"no pose leads from the scans' frame {frame!r} to another one: record its odometry or /tf"
        f"{mounting}; or --georeferenced, if the points are in the map already",
        *notes,
    ]


def _where(bag: Bag, taken: BagTopics) -> str:
    """Say what tells where the map lies."""
    if taken.origin:
        for message in islice(bag.messages([taken.origin]), 1):
            point = message.message.point
            crs = message.message.header.frame_id or "no reference system"
            where = f"{point.x:.3f}, {point.y:.3f}, {point.z:.3f}"
            return f"the map lies in {crs}, its origin at {where} ({taken.origin})"
    fixes = (Fix.of(one.message) for one in islice(bag.messages([taken.fix]), _MOST_FIXES) if taken.fix)
    for fix in filter(None, fixes):
        place = fix.place
        return (
            f"the map lies in {zone_of(place)} by {taken.fix}: first at latitude {place.latitude:.6f}, "
            f"longitude {place.longitude:.6f}, {place.height:.1f} m above the ellipsoid"
        )
    said = f"no fix among the first of {taken.fix}" if taken.fix else "no map_origin"
    return f"{said}: the outputs carry no reference system"


def with_frames(bag: Bag, taken: BagTopics, config: ScanConfig | None = None) -> ScanPlacer:
    """Return a placer that knows the frames that all transforms, and the first poses, tell of."""
    placer = ScanPlacer(config)
    for topic in (*taken.transforms, *filter(None, [taken.odometry])):
        for message in islice(bag.messages([topic]), None if topic in taken.transforms else _FIRST):
            if message.type == ODOMETRY:
                placer.add_odometry(message.message)
            else:
                placer.add_transforms(message.message, is_static=topic.endswith("static"))
    return placer
