"""What the topics of a bag carry, a line each."""

from __future__ import annotations

from typing import NamedTuple

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.bags.bag import CLOUD, Bag, BagTopic


class TopicContent(NamedTuple):
    """
    A topic of a bag and what its first message tells.

    Attributes
    ----------
    name, type, n_messages, rate
        As of `BagTopic`.
    frame, child_frame : str
        Of its header, and of odometry; empty where it has none.
    n_points : int or None
        Points of the first cloud.
    fields : tuple of str
        The cloud's fields.
    problem : str
        Why the message cannot be read, empty if it can.
    """

    name: str
    type: str
    n_messages: int
    rate: float
    frame: str = ""
    child_frame: str = ""
    n_points: int | None = None
    fields: tuple[str, ...] = ()
    problem: str = ""

    def __str__(self) -> str:
        parts = [self.type, f"{self.n_messages} message{'s' * (self.n_messages != 1)}"]
        parts += [f"{self.rate:.3g} Hz"] if self.rate else []
        if self.frame:
            child = f" → {self.child_frame}" if self.child_frame else ""
            parts.append(f"frame {self.frame}{child}")
        if self.n_points is not None:
            parts.append(f"first cloud of {self.n_points:,} points ({' '.join(self.fields)})")
        if self.problem:
            parts.append(f"not readable: {self.problem}")
        return f"{self.name}: {', '.join(parts)}"


def topic_contents(bag: Bag) -> list[TopicContent]:
    """Look at the first message of every topic of an open bag."""
    return [_content(bag, topic) for topic in bag.topics]


def _content(bag: Bag, topic: BagTopic) -> TopicContent:
    known = TopicContent(*topic)
    if not topic.n_messages:
        return known
    try:
        message = bag.first(topic)
    except InputError as error:
        return known._replace(problem=str(error).removeprefix(f"{bag.path}: "))
    one = next(iter(getattr(message, "transforms", ())), message)  # of /tf the first edge
    known = known._replace(
        frame=str(getattr(getattr(one, "header", None), "frame_id", "")),
        child_frame=str(getattr(one, "child_frame_id", "")),
    )
    if topic.type != CLOUD:
        return known
    fields = tuple(field.name for field in message.fields)
    return known._replace(n_points=message.width * message.height, fields=fields)
