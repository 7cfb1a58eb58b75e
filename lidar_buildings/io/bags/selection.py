"""Which topics of a bag are taken."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from lidar_buildings.core.model.errors import InputError, MessageError
from lidar_buildings.core.model.map_frame import MapFrame
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
from lidar_buildings.io.bags.bag_config import BagConfig
from lidar_buildings.io.files.reference_systems import check_place

_ORIGIN, _UNITS = "map_origin", "map_units"


class BagTopics(NamedTuple):
    """What is read of a bag."""

    #: Topic of the scans; of the poses, empty if there is none.
    clouds: str
    odometry: str
    transforms: tuple[str, ...]  #: topics of /tf and /tf_static
    #: Topics that tell where the map lies, how long its reference system's units are, and where by satellite
    #: what moves is; empty if there is none.
    origin: str
    units: str
    fix: str

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
    """
    Choose the topics of an open bag: those that the user wants, or the only ones.

    InputError if one is missing, or it is not clear which; then all topics are listed.
    """
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
    """Read what holds for the whole bag first, and then what is wanted of the rest."""
    yield from bag.messages(topics.of_whole)
    yield from bag.messages(topics.all - topics.of_whole, choice.start, choice.duration)


def told_frame(message: BagMessage, frame: MapFrame) -> MapFrame:
    """
    Return a map frame with what a message of `map_origin` or `map_units` says of it.

    MessageError if that is nowhere.
    """
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

    def listed() -> str:
        return "".join(f"\n  {one}" for one in topic_contents(bag)) or " none"

    if wanted:
        found = [one for one in topics if one.name.lstrip("/") == wanted.lstrip("/")]
        if not found or found[0].type != kind:
            has = f"is {found[0].type}, not {kind}" if found else "is not in it"
            raise InputError(f"{bag.path}: {option} {wanted} {has}; its topics:{listed()}")
        return found[0].name
    if len(having) > 1:
        raise InputError(
            f"{bag.path}: holds several topics of {kind}: choose by {option}; its topics:{listed()}"
        )
    if not having and is_needed:
        raise InputError(f"{bag.path}: holds no {kind}; its topics:{listed()}")
    return having[0].name if having else ""
