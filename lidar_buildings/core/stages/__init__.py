"""One folder a stage, in the order of `lidar_buildings.core.model.stage_table`."""
