"""Virtual scanners on the move: their scans, and the poses of what carries them, in the order of time."""

from lidar_buildings.simulation.live.airborne import fly
from lidar_buildings.simulation.live.live_survey import BodyPose, LiveSurvey, Scan
from lidar_buildings.simulation.live.vehicle import VehicleConfig, drive

__all__ = ["BodyPose", "LiveSurvey", "Scan", "VehicleConfig", "drive", "fly"]
