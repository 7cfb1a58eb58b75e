"""A survey written down: as a bag, and as the files of a survey with the truth."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from lidar_buildings.io.bags.bag_writer import BagWriter
from lidar_buildings.simulation.las_strips import strip_file
from lidar_buildings.simulation.live.messages import LATCHED, TYPES, LiveMessages, Told
from lidar_buildings.simulation.live.moving_survey import BodyPose, MovingSurvey, Scan
from lidar_buildings.simulation.survey import STRIP_NAME, make_folder, remove_surplus, write_truth


class SurveyBag:
    """
    A bag of a survey's messages, as a recorder would have made it; see `BagWriter` and `LiveMessages`.

    OutputError if there is something of that name, or it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        survey: MovingSurvey,
        storage: str = "mcap",
        compression: str = "",
        *,
        with_tf: bool = True,
        with_fix: bool = False,
    ) -> None:
        self.files = [path]
        self._bag = BagWriter(path, storage, compression, latched={_absolute(topic) for topic in LATCHED})
        self._messages = LiveMessages(survey, self._bag.make, with_tf=with_tf, with_fix=with_fix)
        for told in self._messages.opening():
            self._write(told, survey.legs[0].stamp)

    def __enter__(self) -> SurveyBag:
        return self

    def __exit__(self, *_: object) -> None:
        self._bag.close()

    def add(self, event: Scan | BodyPose) -> None:
        """Write what is said of a scan or a pose."""
        for told in self._messages.of(event):
            self._write(told, event.sent)

    def _write(self, told: Told, time: int) -> None:
        self._bag.write(_absolute(told.topic), TYPES[told.topic], time, told.message)


class SurveyFiles:
    """
    The files that `simulate_survey` makes, of a survey on the move: a LAZ file per leg, and the truth.

    `files` are the clouds that are complete, and at the end the truth. OutputError if the folder or a file
    cannot be written.
    """

    def __init__(self, output: Path, survey: MovingSurvey) -> None:
        self.files: list[Path] = []
        self._output, self._scene = output, survey.scene
        self._leg = 0
        self._file = ExitStack()
        make_folder(output)

    def __enter__(self) -> SurveyFiles:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self._file.close()  # of an interrupted survey with what there is
        if kind is None or issubclass(kind, KeyboardInterrupt):
            remove_surplus(self._output, self.files)
            self.files.extend(write_truth(self._output, self._scene))

    def add(self, event: Scan | BodyPose) -> None:
        """Write the returns of a scan."""
        if not isinstance(event, Scan) or not len(event.truth.points):
            return
        leg = int(event.truth.point_source_id[0])
        if leg != self._leg:
            self._file.close()
            self._leg = leg
            path = self._output / STRIP_NAME.format(leg)
            self._write = self._file.enter_context(strip_file(path, self._scene.frame))
            self.files.append(path)
        self._write(event.truth)


def _absolute(topic: str) -> str:
    return "/" + topic.lstrip("/")
