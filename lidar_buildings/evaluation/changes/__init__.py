"""What has changed between two surveys of one place: per building, by how much and how sure."""

from lidar_buildings.evaluation.changes.comparing import Change, ChangeConfig, Comparison, compare_runs

__all__ = ["Change", "ChangeConfig", "Comparison", "compare_runs"]
