# SPDX-License-Identifier: Apache-2.0
"""
Raw lidar in, valid 3D city models out, while the data stream in.

The names below are imported when first used: ``import lidar_buildings`` takes no time and needs no ROS.
"""

from importlib import import_module
from typing import Any

__version__ = "0.2.0"

_MODULES = {
    "core.stages.ground_filter.config": ("GroundFilterConfig",),
    "core.stages.ground_filter.classification": ("classify_ground",),
    "core.stages.roof_selection.config": ("RoofSelectionConfig",),
    "core.stages.roof_selection.selection": ("select_roofs",),
    "core.stages.edge_labelling.config": ("EdgeLabellingConfig",),
    "core.stages.edge_labelling.labelling": ("label_edges",),
    "core.stages.segmentation.config": ("SegmentationConfig",),
    "core.stages.segmentation.segmentation": ("segment_buildings",),
    "core.stages.boundary_tracing.config": ("BoundaryTracingConfig",),
    "core.stages.boundary_tracing.tracing": ("trace_boundary",),
    "core.stages.footprints.config": ("FootprintConfig",),
    "core.stages.regularisation.config": ("RegularisationConfig",),
    "core.stages.regularisation.regularising": ("regularise_outline",),
    "core.stages.facades.config": ("FacadesConfig",),
    "core.stages.facades.finding": ("find_facades",),
    "core.stages.plane_fitting.config": ("PlaneFittingConfig",),
    "core.stages.plane_fitting.fitting": ("fit_roof_planes",),
    "core.stages.building_model.config": ("BuildingModelConfig",),
    "core.stages.building_model.model": ("build_model",),
    "core.model.tile": ("PointTile",),
    "io.clouds.las": ("read_tile",),
    "pipeline.config": ("PipelineConfig",),
    "pipeline.reconstruct": ("TileResult", "reconstruct_tile"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}
__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> Any:
    """Import a public name's module when the name is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, imported or not."""
    return sorted({*globals(), *_MODULE_OF})
