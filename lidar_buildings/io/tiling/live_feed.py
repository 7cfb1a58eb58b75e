"""A feed: messages in, placed points on disk, tiles out; in two threads, so that who listens never waits."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from lidar_buildings.core.model.errors import MessageError, OutputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.sides import ALL, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.scans.config import MOST_LOST, ScanConfig
from lidar_buildings.core.scans.placing import NO_POSE, ScanPlacer, lost_share
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.files.temporary_folder import make_temporary_folder, remove_folder
from lidar_buildings.io.tiling.live_files import (
    CLOUDS,
    Recorded,
    record,
    recorded_of,
    scale_of,
    write_placed_points,
)
from lidar_buildings.io.tiling.live_survey import LiveSurvey
from lidar_buildings.io.tiling.map_place import FrameSearch
from lidar_buildings.io.tiling.tiling_config import LiveTilingConfig

#: Why points, and messages with poses, are left out: more wait than there is room for.
TOO_FAST = "arrived faster than they could be placed"
POSES_TOO_FAST = f"poses {TOO_FAST}"
#: Points, and messages, that may wait (about 0.5 GB each).
_MOST_POINTS, _MOST_MESSAGES = 10_000_000, 50_000

#: Period of looking for tiles that were left [s].
_TICK = 0.1
#: Time that the first points wait for others that tell what tiles are like [s]; wide margin over `PERIOD`.
_PATIENCE = 10.0
#: If no point could be placed for so long it is told why [s]; wide margin: poses come every 0.1 s.
_LACK = 10.0
#: Different problems that are remembered.
_MOST_PROBLEMS = 100


class LiveFeed:
    """
    Takes messages and gives out tiles.

    An interrupted feed knows where the map lies; else `frame` may tell. `error` is what ended it, `obstacle`
    why nothing can be written now, empty if it can, and `problems` what was wrong with messages, and how
    often. `recorded` is how points are placed, as soon as that is settled; `n_flushed` is the number of the
    last flush that is done.
    """

    def __init__(self, tiling: LiveTilingConfig, scans: ScanConfig, frame: MapFrame | None = None) -> None:
        self.error: Exception | None = None
        self.problems: Counter[str] = Counter()
        self.n_flushed, self.obstacle = 0, ""
        self._tiling, self._scans = tiling, scans
        #: What is to be done with messages, in the order in which they came, and their points.
        self._inbox: queue.Queue[tuple[Callable[[], Any], int]] = queue.Queue()
        self._too_fast: Counter[str] = Counter()
        self._n_come = self._n_taken = 0
        self.folder = Path(tiling.spool) if tiling.spool else make_temporary_folder()
        self.recorded = recorded_of(self.folder, tiling)
        self._search = FrameSearch(frame, in_grid=scans.georeferenced)
        self._placer = ScanPlacer(scans)
        self._survey: LiveSurvey | None = None
        self._early: list[PlacedScan] = []
        #: Since when none is placed of the points that come, and how many had been left out till then.
        self._waits_since, self._n_unplaced = time.monotonic(), 0
        #: Numbers of the flushes that were asked for and begun last; files of points that are still to write.
        self._n_asked = self._n_begun = self._n_clouds_left = 0
        #: The tile that was asked for, once it is made.
        self._made: PointTile | None = None
        self._is_wanted = False
        self._made_lock = threading.Lock()
        self._has_work, self._stopping = threading.Event(), threading.Event()
        self._wake: Callable[[], None] = lambda: None
        if self.recorded is not None:
            self._open(self.recorded)
        self._threads = [threading.Thread(target=one, daemon=True) for one in (self._take_in, self._give_out)]

    def start(self, wake: Callable[[], None]) -> None:
        """Begin; `wake` is called, from another thread, when there is something to take or to tell."""
        self._wake = wake
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Write what has come, and end."""
        self._stopping.set()
        self._has_work.set()
        for thread in [one for one in self._threads if one.ident is not None]:
            thread.join()
        try:
            if self._tiling.spool:
                self._keep_placed(is_end=True)
                self._settle_frame(math.inf)
            if self._survey is not None:
                self._survey.close()
        finally:
            if not self._tiling.spool:
                remove_folder(self.folder)

    @property
    def frame(self) -> MapFrame | None:
        """Where the map lies, None as long as that is not settled."""
        return None if self._survey is None else self._survey.frame

    @property
    def tile_count(self) -> int:
        """Number of tiles that have points."""
        return 0 if self._survey is None else self._survey.n_tiles

    @property
    def n_left(self) -> int:
        """Number of tiles, roughly, with points that were not taken, also of points that wait; 0 if none."""
        n_early = bool(self._early or self._n_come > self._n_taken or self._placer.n_waiting)
        return n_early + (0 if self._survey is None else self._survey.n_left) + (self._made is not None)

    def counts(self) -> dict[str, int]:
        """Return what has come, what waits, and what was left out for which reason."""
        survey = self._survey
        left_out = self._too_fast + self._placer.left_out + (survey.left_out if survey else Counter())
        return {
            "scans": self._placer.n_scans,
            "points": survey.n_points if survey else 0,
            "points_waiting": self._n_come - self._n_taken + self._placer.n_waiting,
            "tiles_waiting": survey.n_waiting if survey else 0,
            "clouds_waiting": self._n_clouds_left,
            "places_skipped": survey.places.n_skipped if survey else 0,
            **{f"left out: {reason}": count for reason, count in sorted(left_out.items())},
            **dict(sorted(self._placer.messages.items())),
        }

    @property
    def loss(self) -> str:
        """How much of the points is lost, and why; empty if little."""
        left_out = self._placer.left_out + Counter({TOO_FAST: self._too_fast[TOO_FAST]})
        lost = lost_share(left_out, self._survey.n_points if self._survey else 0)
        why = self._placer.why_left_out(left_out)
        return f"{lost:.1%} of the points are left out: {why}" if lost > MOST_LOST else ""

    @property
    def thinned(self) -> str:
        """How the points from the street were thinned; empty if none came."""
        return self._survey.thinned if self._survey else ""

    def add_scan(self, message: Any) -> None:
        """Take a sensor_msgs/PointCloud2."""
        n_points = int(message.width) * int(message.height)
        self._put(lambda: self._placer.add_scan(message), TOO_FAST, n_points)

    def add_odometry(self, message: Any) -> None:
        """Take a nav_msgs/Odometry."""
        self._put(lambda: self._placer.add_odometry(message), POSES_TOO_FAST)

    def add_transforms(self, message: Any, *, is_static: bool) -> None:
        """Take a tf2_msgs/TFMessage."""
        self._put(lambda: self._placer.add_transforms(message, is_static=is_static), POSES_TOO_FAST)

    def add_fix(self, message: Any) -> None:
        """Take a sensor_msgs/NavSatFix."""
        self._put(lambda: self._search.fixes.take(message, self._placer), POSES_TOO_FAST)

    def add_frame(self, frame: MapFrame) -> None:
        """Take what others say of where the map lies; too late once points are kept."""
        self._put(lambda: self._search.take_frame(frame))

    def finish(self, stamp: int, *, is_done: bool = True) -> None:
        """Note that a tile is done, or was given up."""
        self._put(lambda: self._survey and self._survey.finish(stamp, is_done=is_done))

    def flush(self) -> int:
        """Have all tiles made that have new points; they are done when `n_flushed` is the number returned."""
        number = self._n_asked = self._n_asked + 1
        self._put(lambda: self._flush(number))
        return number

    def reset(self) -> None:
        """Forget all points and tiles."""
        self._put(self._reset)

    def take(self) -> PointTile | None:
        """Return the next tile; None if it must be made first, of all points there are then: `wake` tells."""
        with self._made_lock:
            tile, self._made = self._made, None
            self._is_wanted = tile is None
        if tile is None:
            self._has_work.set()
        return tile

    def take_places(self) -> Iterator[PointTile]:
        """Yield the places beside a vehicle's way that are ready."""
        while self._survey is not None and self._survey.places.ready:
            yield self._survey.places.ready.popleft()

    def take_newer(self) -> Iterator[PointTile]:
        """Yield points, some at a time, that were measured in tiles after these were sent."""
        while self._survey is not None and self._survey.newer:
            yield PointTile(self._survey.newer.popleft())

    def grown(self, tile: PointTile, sides: Sides = ALL) -> PointTile | None:
        """Return a tile with a larger buffer, None if there is none."""
        return None if self._survey is None else self._survey.grown(tile, sides)

    def fullness(self, n_more: int = 0) -> float:
        """Return the share of the room that is taken by what waits to be placed, and so many points more."""
        n_points = self._n_come - self._n_taken + n_more
        return max(n_points / _MOST_POINTS, self._inbox.qsize() / _MOST_MESSAGES)

    def _put(self, work: Callable[[], Any], too_fast: str = "", n_points: int = 0) -> None:
        """Let work wait; what may be left out, with a reason for it, only if there is room."""
        if too_fast and self.fullness(n_points) > 1.0:
            self._too_fast[too_fast] += n_points or 1
            return
        self._n_come += n_points
        self._inbox.put((work, n_points))

    def _take_in(self) -> None:
        next_tick = time.monotonic()
        try:
            while not (self._stopping.is_set() and self._inbox.empty()):
                if self.obstacle and not self._stopping.wait(_TICK):
                    self._try(self._tick)  # what comes waits in the inbox, which has its bound
                    continue
                with suppress(queue.Empty):
                    work, n_points = self._inbox.get(timeout=_TICK)
                    self._try(work)
                    self._n_taken += n_points
                if time.monotonic() >= next_tick:
                    self._try(self._tick)
                    next_tick = time.monotonic() + _TICK
        except Exception as error:
            self.error = error
            self._wake()

    def _try(self, work: Callable[[], Any]) -> None:
        """Do something; what is wrong with a message, or the disk, is told and goes no further."""
        try:
            work()
        except MessageError as error:
            self.problems[str(error) if len(self.problems) < _MOST_PROBLEMS else "more"] += 1
        except OutputError as error:
            self.obstacle = str(error)

    def _tick(self) -> None:
        self._keep_placed()
        self._tell_of_lack(time.monotonic())
        self._settle_frame(time.monotonic())
        if self._survey is not None and self.recorded is not None:
            self.problems.update(self._search.doubts(self.recorded.given, self._placer))
            self.problems |= dict.fromkeys(self._placer.doubts, 1)
            is_ready, self.obstacle = self._survey.tick(time.monotonic()), ""
            if self._survey.places.ready:
                self._wake()
            if is_ready or (self._n_begun > self.n_flushed and self._survey.is_flushed):
                self._has_work.set()

    def _keep_placed(self, *, is_end: bool = False) -> None:
        for scan in self._placer.placed(is_end=is_end):
            if len(scan.points):
                self._waits_since, self._n_unplaced = time.monotonic(), self._placer.left_out[NO_POSE]
            self._keep(scan)

    def _tell_of_lack(self, now: float) -> None:
        if not self._placer.n_waiting and self._placer.left_out[NO_POSE] <= self._n_unplaced:
            self._waits_since = now
        elif now - self._waits_since > _LACK:
            if not (why := self._placer.why_waiting()):
                why = self._placer.why_no_pose() and f"{NO_POSE}: {self._placer.why_no_pose()}"
            if why:
                self.problems[why] += 1
                self._waits_since = math.inf

    def _keep(self, scan: PlacedScan) -> None:
        if self._survey is not None and self.recorded is not None:
            self._survey.add(self.recorded.placed(scan), time.monotonic())
        elif len(scan.points):
            self._early.append(scan)

    def _settle_frame(self, now: float) -> None:
        """Begin to keep points once it is settled where the map lies, and what tiles are like."""
        if not self._early:
            return
        if self._survey is None:
            n_points = sum(len(scan.points) for scan in self._early)
            if (given := self._search.settled(self._placer, now, n_points)) is None:
                return
            is_end = self._search.is_over(now, n_points, _PATIENCE)
            if (scale := scale_of(self._early, self._tiling.buffer, is_end=is_end)) is None:
                return
            self.problems.update(given.warnings)
            scale = scale._replace(side=self._tiling.tile_size or scale.side)
            recorded = Recorded.beginning(scale, given, self._early[0], self._placer.target)
            record(self.folder, self._tiling, recorded)
            self._open(recorded)
        while self._early:
            self._keep(self._early.pop(0))

    def _open(self, recorded: Recorded) -> None:
        self.recorded, tiling = recorded, replace(self._tiling, tile_size=recorded.scale.side)
        self._survey = LiveSurvey(tiling, recorded.frame, self.folder, recorded.scale.spacing)

    def _flush(self, number: int) -> None:
        self._keep_placed(is_end=True)
        self._settle_frame(math.inf)
        if self._survey is not None:
            self._survey.flush()
            self._n_begun = number
        else:
            self.n_flushed = number

    def _reset(self) -> None:
        self._placer, self._early, self._n_unplaced = ScanPlacer(self._scans), [], 0
        self._too_fast.clear()
        if self._survey is not None:
            self._survey.clear()
            remove_folder(self.folder / CLOUDS)
        with self._made_lock:
            self._made = None

    def _give_out(self) -> None:
        """Make the tiles that are ready, and the files of points when a flush is done."""
        try:
            while not self._stopping.is_set():
                self._has_work.wait()
                self._has_work.clear()
                self._try(self._make)  # with a full disk again at the next tick
        except Exception as error:
            self.error = error
            self._wake()

    def _make(self) -> None:
        if self._is_wanted and self._survey is not None and (tile := self._survey.take()) is not None:
            with self._made_lock:
                self._made, self._is_wanted = tile, False
            self._wake()
        number = self._n_begun  # another flush may begin while files are written
        if self._survey is not None and number > self.n_flushed and self._survey.is_flushed:
            for n_left in write_placed_points(self._survey, self.folder):
                self._n_clouds_left = n_left
                if self._stopping.is_set():
                    return
            self.n_flushed = number
            self._wake()
