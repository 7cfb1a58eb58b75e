"""Virtual scanners on the move: their scans, and the poses of what carries them, in the order of time."""

from lidar_buildings.simulation.live.airborne import fly
from lidar_buildings.simulation.live.moving_survey import BodyPose, MovingSurvey, Scan
from lidar_buildings.simulation.live.vehicle import VehicleConfig, drive

__all__ = ["BodyPose", "MovingSurvey", "Scan", "VehicleConfig", "drive", "fly"]
