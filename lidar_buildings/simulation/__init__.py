"""Virtual scenes with exact truth, and a virtual airborne scanner."""

from lidar_buildings.simulation.flight import SimulationConfig
from lidar_buildings.simulation.named_scenes import SCENES, make_scene
from lidar_buildings.simulation.survey import SurveySummary, TileTruth, simulate_survey, simulate_tile

__all__ = [
    "SCENES",
    "SimulationConfig",
    "SurveySummary",
    "TileTruth",
    "make_scene",
    "simulate_survey",
    "simulate_tile",
]
