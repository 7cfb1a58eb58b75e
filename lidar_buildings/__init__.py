"""
Raw lidar in, valid 3D city models out, while the data stream in.

The names below are imported when first used: ``import lidar_buildings`` takes no time and needs no ROS.
"""

from importlib import import_module
from typing import Any

__version__ = "0.2.0"

_MODULES = {
    "core.stages.ground_filter": ("GroundFilterConfig", "classify_ground"),
    "core.stages.roof_selection": ("RoofSelectionConfig", "select_roofs"),
    "core.stages.edge_labelling": ("EdgeLabellingConfig", "label_edges"),
    "core.stages.segmentation": ("SegmentationConfig", "segment_buildings"),
    "core.stages.boundary_tracing": ("BoundaryTracingConfig", "trace_boundary"),
    "core.stages.footprints": ("FootprintConfig",),
    "core.stages.regularisation": ("RegularisationConfig", "regularise_outline"),
    "core.stages.plane_fitting": ("PlaneFittingConfig", "fit_roof_planes"),
    "core.stages.building_model": ("BuildingModelConfig", "build_model"),
    "core.model.tile": ("PointTile",),
    "io.clouds.las": ("read_tile",),
    "pipeline.reconstruct": ("PipelineConfig", "TileResult", "reconstruct_tile"),
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
