"""What a preset sets, as the stages' configs."""

from __future__ import annotations

from lidar_buildings.commands.settings import preset_file, read_settings
from lidar_buildings.pipeline.config import STAGE_CONFIGS, PipelineConfig


def config_of(preset: str) -> PipelineConfig:
    """Return all stages' configs with what a preset sets."""
    settings = read_settings(None, [], preset=preset_file(preset))
    return PipelineConfig(**{stage: kind(**settings.get(stage, {})) for stage, kind in STAGE_CONFIGS.items()})
