"""A line scanner in an aircraft that rolls, pitches and yaws."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.scans.trajectory import Pose
from lidar_buildings.simulation.casting import surfaces_of
from lidar_buildings.simulation.flight import TAKE_OFF, SimulationConfig, Strip, plan_flight
from lidar_buildings.simulation.live.moving_survey import (
    SECOND,
    TAKE_OFF_STAMP,
    Leg,
    MovingSurvey,
    Scan,
    Sway,
    mounting_pose,
)
from lidar_buildings.simulation.scanner import DEFAULTS, StripPoints, measured
from lidar_buildings.simulation.scene import VirtualScene
from lidar_buildings.simulation.survey import SCALE

#: Lever arm [m] and boresight angles [deg] of the scanner; those of a good installation are smaller.
MOUNTING = "0.35,-0.12,-0.45,0.4,-0.25,0.6"
#: An aircraft in ordinary air.
AIRCRAFT = Sway(
    (0.0, 1.5, 2.0), ((0, 3.0, 4.1, 0.3), (0, 0.5, 1.7, 1.1), (1, 1.0, 5.3, 2.0), (2, 1.2, 6.7, 0.9))
)
#: Poses a second, as an inertial unit tells them.
POSE_RATE = 200.0
#: Clouds a second: small ones, of which none gets lost on its way.
SCAN_RATE = 50.0
#: Turns are cut to this [s], more than any reader fills between two poses.
TURN = 5.0
#: What the driver sends of each return: name → type. The time is absolute [s].
ROW = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "intensity")]
    + [("timestamp", "<f8"), ("scan_angle", "<f4"), ("point_source_id", "<u2")]
    + [(name, "u1") for name in ("return_number", "number_of_returns", "scan_direction_flag")]
)


def fly(
    scene: VirtualScene, seed: int = 0, config: SimulationConfig = DEFAULTS, pulse_rate: float | None = None
) -> MovingSurvey:
    """
    Fly over a scene with a scanner of this pulse rate, or what `config.ground_speed` makes it.

    The pulses are those of `scan`, so that a file of the same points can be had from their truth; the flight
    is as fast as the pulse rate makes it at the density asked for. ParameterError if that is not above 0.
    """
    if pulse_rate is not None and not pulse_rate > 0:
        raise ParameterError(f"pulse rate = {pulse_rate}: must be above 0 [1/s]")
    strips = _timed(plan_flight(scene, config), pulse_rate)
    surfaces, mounting = surfaces_of(scene, config.max_scan_angle_deg), mounting_pose(MOUNTING)

    def scans_of(leg: Leg) -> Iterator[Scan]:
        strip = strips[leg.number - 1]
        n_scans = int(np.ceil(strip.duration * SCAN_RATE))
        firsts = [round(number * strip.pulse_rate / SCAN_RATE) for number in range(n_scans)]
        for window in pairwise([*firsts, strip.n_pulses]):
            points = measured(strip, window, scene.size, seed, surfaces, config)
            # whole millimetres: placed again, and rounded as in a file, they are the same numbers
            points = replace(points, points=np.round(points.points / SCALE) * SCALE)
            if len(points.points):
                begin, end = (leg.stamp + round(pulse / strip.pulse_rate * SECOND) for pulse in window)
                elapsed = points.gps_time - strip.start_time
                yield Scan(begin, end, _rows(leg, mounting, points, elapsed), points)

    return MovingSurvey(scene, MOUNTING, tuple(map(_leg, strips)), POSE_RATE, scans_of)


def _rows(leg: Leg, mounting: Pose, points: StripPoints, elapsed: NDArray[np.float64]) -> NDArray[Any]:
    rows = np.empty((1, len(elapsed)), dtype=ROW)
    rows["x"], rows["y"], rows["z"] = leg.at(elapsed).of_mounted(mounting).seen(points.points).T
    rows["timestamp"] = leg.stamp / SECOND + elapsed
    rows["scan_direction_flag"] = points.scan_direction
    for name in ("intensity", "scan_angle", "point_source_id", "return_number", "number_of_returns"):
        rows[name] = getattr(points, name)
    return rows


def _timed(strips: tuple[Strip, ...], pulse_rate: float | None) -> list[Strip]:
    timed: list[Strip] = []
    for strip in strips:
        faster = 1.0 if pulse_rate is None else pulse_rate / strip.pulse_rate
        begin = timed[-1].start_time + timed[-1].duration + TURN if timed else TAKE_OFF
        speed, rate = strip.speed * faster, strip.pulse_rate * faster
        start = float(np.ceil(begin))
        timed.append(replace(strip, speed=speed, pulse_rate=rate, start_time=start))
    return timed


def _leg(strip: Strip) -> Leg:
    lever_arm = mounting_pose(MOUNTING).translation
    stamp = TAKE_OFF_STAMP + round((strip.start_time - TAKE_OFF) * SECOND)
    return Leg(
        strip.number, strip.start, strip.heading, strip.speed, strip.duration, stamp, AIRCRAFT, lever_arm
    )
