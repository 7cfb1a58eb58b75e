"""What a bag holds, what a run would take of it, and what it would miss."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from lidar_buildings.core.model.errors import InputError, MessageError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.placing import ScanPlacer
from lidar_buildings.core.scans.transform_tree import frame_name
from lidar_buildings.io.bags.bag import (
    CLOUD,
    FIX,
    ODOMETRY,
    POINT,
    TRANSFORMS,
    VECTOR,
    Bag,
    BagMessage,
    BagTopic,
    topic_contents,
)
from lidar_buildings.io.bags.bag_inputs import BagConfig
from lidar_buildings.io.bags.scan_types import remedy_of
from lidar_buildings.io.files.reference_systems import check_place
from lidar_buildings.io.tiling.map_place import Fix, zone_of

#: Poses are read from so long before the clouds to so long after them [s]: slow ones lie around.
_AROUND = 10.0
_ORIGIN, _UNITS = "map_origin", "map_units"


class BagTopics(NamedTuple):
    """The topics that are read of a bag; empty if there is none."""

    clouds: str
    odometry: str
    transforms: tuple[str, ...]  #: of /tf and /tf_static
    origin: str  #: where the map lies
    units: str  #: how long its reference system's units are
    fix: str  #: positions by satellite

    @property
    def all(self) -> set[str]:
        """All of them."""
        return {self.clouds, self.odometry, *self.transforms, self.origin, self.units, self.fix} - {""}

    @property
    def of_whole(self) -> set[str]:
        """Those that hold for the whole bag, whenever they were recorded."""
        static = (one for one in self.transforms if one.endswith("static"))
        return {*static, self.origin, self.units} - {""}


def choose_topics(bag: Bag, clouds: str = "", odometry: str = "") -> BagTopics:
    """Choose the topics that the user wants, or the only ones; InputError lists all if that is not clear."""
    topics = bag.topics
    own = [one for one in topics if one.type == TRANSFORMS]
    return BagTopics(
        _one(bag, topics, CLOUD, clouds, "--topic", is_needed=True),
        _one(bag, topics, ODOMETRY, odometry, "--odometry", is_needed=False),
        tuple(one.name for one in own),
        *(
            next((one.name for one in topics if one.type == kind and one.name.endswith(name)), "")
            for kind, name in ((POINT, _ORIGIN), (VECTOR, _UNITS), (FIX, ""))
        ),
    )


def chosen_messages(bag: Bag, topics: BagTopics, choice: BagConfig) -> Iterator[BagMessage]:
    """Read what holds for the whole bag first, then the clouds that are wanted, and poses around them."""
    yield from bag.messages(topics.of_whole)
    begin, end = choice.start, choice.start + choice.duration if choice.duration else math.inf
    around = max(begin - _AROUND, 0.0)
    duration = end + _AROUND - around if choice.duration else 0.0
    first = (bag.start or 0) + round(begin * 1e9)
    for message in bag.messages(topics.all - topics.of_whole, around, duration):
        if message.topic != topics.clouds or first <= message.time < (bag.start or 0) + end * 1e9:
            yield message


def told_frame(message: BagMessage, frame: MapFrame) -> MapFrame:
    """Return a frame with what a message of `map_origin` or `map_units` says; MessageError if nowhere."""
    if message.type == POINT:
        point = message.message.point
        frame = replace(frame, crs=message.message.header.frame_id, origin=(point.x, point.y, point.z))
    else:
        units = message.message.vector
        frame = replace(frame, horizontal_unit=units.x, vertical_unit=units.z)
    try:
        check_place(frame)
    except MessageError as error:
        raise MessageError(f"{message.topic}: {error}") from None
    return frame


def _one(bag: Bag, topics: list[BagTopic], kind: str, wanted: str, option: str, *, is_needed: bool) -> str:
    """Return the topic of a kind that is wanted, or the only one."""
    having = [one for one in topics if one.type == kind and one.n_messages]

    def refused(why: str) -> InputError:
        own = [f"  {one}" for one in topic_contents(bag)]
        return InputError(f"{bag.path}: {why}; its topics:{'' if own else ' none'}", *own)

    if wanted:
        found = [one for one in topics if one.name.lstrip("/") == wanted.lstrip("/")]
        if not found or found[0].type != kind:
            has = f"is {found[0].type}, not {kind}" if found else "is not in it"
            raise refused(f"{option} {wanted} {has}")
        return found[0].name
    if len(having) > 1:
        raise refused(f"contains several topics of {kind}: choose one with {option}")
    if not having and is_needed:
        other = [f"{one.name} holds {what}" for one in topics if (what := remedy_of(one.type))]
        what = f"; {other[0]}" if other and kind == CLOUD else ""
        raise refused(f"contains no {kind}{what}")
    return having[0].name if having else ""


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


def summarise_bag(path: Path) -> BagSummary:
    """Look into a bag; InputError if it cannot be read."""
    with Bag(path) as bag:
        topics, taken = topic_contents(bag), None
        try:
            taken = choose_topics(bag)
            notes = _placing(bag, topics, taken)
        except InputError as error:
            notes = [str(error).removeprefix(f"{bag.path}: ").split("; its topics:")[0]]
        return BagSummary(str(bag.path), bag.start, bag.seconds, topics, taken, notes)


def _placing(bag: Bag, topics: list[BagTopic], taken: BagTopics) -> list[str]:
    frame = frame_name(next(one.frame for one in topics if one.name == taken.clouds))
    map_frame = ScanConfig().map_frame
    placer = with_frames(bag, taken)
    notes = [_where(bag, taken)]
    if frame == map_frame:
        return [f"the scans are in frame {map_frame}: they are used unchanged", *notes]
    target = placer.target_of(frame)
    if target != frame:
        return [f"the scans are placed in frame {target}", *notes]
    known = ", ".join(placer.tree.frames)
    mounting = f"; or --set scan_assembler.mounting=…, if it is fixed to one of {known}" if known else ""
    return [
        f"no pose leads from the scans' frame {frame!r} to another one: record its odometry or /tf"
        f"{mounting}; or --georeferenced, if the points are already in map coordinates",
        *notes,
    ]


def _where(bag: Bag, taken: BagTopics) -> str:
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
    return f"{said}: the outputs have no reference system"


def with_frames(bag: Bag, taken: BagTopics, config: ScanConfig | None = None) -> ScanPlacer:
    """Return a placer that knows the frames that all transforms, and the first poses, tell of."""
    placer = ScanPlacer(config)
    for topic in (*taken.transforms, *filter(None, [taken.odometry])):
        for message in islice(bag.messages([topic]), None if topic in taken.transforms else _FIRST):
            if message.type == ODOMETRY:
                placer.add_odometry(message.message)
            else:
                placer.add_transforms(message.message, is_static=topic.endswith("static"))
    placer.tree.settle()
    return placer
