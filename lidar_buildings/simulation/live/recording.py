"""A survey written down: as a bag, and as the files of a survey with the truth."""

from __future__ import annotations

from pathlib import Path

from lidar_buildings.io.bags.bag_writer import BagWriter
from lidar_buildings.simulation.live.live_survey import BodyPose, LiveSurvey, Scan
from lidar_buildings.simulation.live.messages import LATCHED, TYPES, LiveMessages, Told


class SurveyBag:
    """
    A bag of a survey's messages, as a recorder would have made it.

    Parameters
    ----------
    path : Path
        The folder, which must not be there.
    survey : LiveSurvey
        What is written.
    storage : str
        ``mcap`` or ``sqlite3``.
    with_tf, with_fix : bool
        As for `LiveMessages`.

    Raises
    ------
    OutputError
        If there is something of that name, or it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        survey: LiveSurvey,
        storage: str = "mcap",
        *,
        with_tf: bool = True,
        with_fix: bool = False,
    ) -> None:
        self._bag = BagWriter(path, storage, latched={_absolute(topic) for topic in LATCHED})
        self._messages = LiveMessages(survey, self._bag.make, with_tf=with_tf, with_fix=with_fix)
        for told in self._messages.opening():
            self._write(told, survey.legs[0].stamp)

    def add(self, event: Scan | BodyPose) -> None:
        """Write what is said of a scan or a pose."""
        for told in self._messages.of(event):
            self._write(told, event.sent)

    def close(self) -> None:
        """Complete the bag."""
        self._bag.close()

    def _write(self, told: Told, time: int) -> None:
        self._bag.write(_absolute(told.topic), TYPES[told.topic], time, told.message)


def _absolute(topic: str) -> str:
    return "/" + topic.lstrip("/")
