"""Feeds of live scans whose tiles are done as they come, and messages for them."""

import threading
import time
from types import SimpleNamespace

import numpy as np
from support.scan_messages import header

from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.tiling.live_feed import LiveFeed
from lidar_buildings.io.tiling.tiling_config import LiveTilingConfig

FAR_LATER = 3600.0


class Running:
    """A feed whose tiles are done as they come."""

    def __init__(self, folder="", frame=None, scans=None, **tiling):
        given = {"tile_size": 40.0, "buffer": 5.0, "leave_after": FAR_LATER, "spool": str(folder)} | tiling
        config = LiveTilingConfig(**given)
        self._news = threading.Condition()
        self.feed = LiveFeed(config, scans or ScanConfig(), frame)
        self.tiles = []

    def __enter__(self):
        self.feed.start(self._wake)
        return self

    def __exit__(self, *_):
        self.feed.stop()

    def _wake(self):
        with self._news:
            self._news.notify_all()

    def flush(self):
        """Take all tiles that there are."""
        n_before, end = self.feed.n_flushed, time.monotonic() + 240.0
        self.feed.flush()
        while self.feed.n_flushed == n_before:
            assert self.feed.error is None
            assert time.monotonic() < end
            tile = self.feed.take()
            if tile is not None:
                self.tiles.append(tile)
                self.feed.finish(tile.stamp)
                continue
            with self._news:
                self._news.wait(0.05)
        return self.tiles


def points(n_points=500, seed=0, at=(20.0, 20.0, 2.0)):
    random = np.random.default_rng(seed)
    return random.uniform(-5.0, 5.0, (n_points, 3)) + np.array(at)


def core(tiles):
    return sum(int(np.count_nonzero(tile.buffer == 0)) for tile in tiles)


def fix(stamp, latitude, longitude, altitude, status=0):
    return SimpleNamespace(
        header=header(stamp, "gps"),
        status=SimpleNamespace(status=status),
        latitude=latitude,
        longitude=longitude,
        altitude=altitude,
        position_covariance=[0.0] * 9,
        position_covariance_type=0,
    )
