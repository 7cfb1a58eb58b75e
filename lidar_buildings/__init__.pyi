"""The public names: type checkers read them here, and so does the package when it imports one."""

from .commands.from_python import Reconstruction as Reconstruction
from .commands.from_python import reconstruct as reconstruct
from .core.model.tile import PointTile as PointTile
from .core.stages.boundary_tracing.config import BoundaryTracingConfig as BoundaryTracingConfig
from .core.stages.boundary_tracing.tracing import trace_boundary as trace_boundary
from .core.stages.building_model.config import BuildingModelConfig as BuildingModelConfig
from .core.stages.building_model.model import build_model as build_model
from .core.stages.edge_labelling.config import EdgeLabellingConfig as EdgeLabellingConfig
from .core.stages.edge_labelling.labelling import label_edges as label_edges
from .core.stages.facades.config import FacadesConfig as FacadesConfig
from .core.stages.facades.finding import find_facades as find_facades
from .core.stages.footprints.config import FootprintConfig as FootprintConfig
from .core.stages.ground_filter.classification import classify_ground as classify_ground
from .core.stages.ground_filter.config import GroundFilterConfig as GroundFilterConfig
from .core.stages.plane_fitting.config import PlaneFittingConfig as PlaneFittingConfig
from .core.stages.plane_fitting.fitting import fit_roof_planes as fit_roof_planes
from .core.stages.regularisation.config import RegularisationConfig as RegularisationConfig
from .core.stages.regularisation.regularising import regularise_outline as regularise_outline
from .core.stages.roof_selection.config import RoofSelectionConfig as RoofSelectionConfig
from .core.stages.roof_selection.selection import select_roofs as select_roofs
from .core.stages.segmentation.config import SegmentationConfig as SegmentationConfig
from .core.stages.segmentation.segmentation import segment_buildings as segment_buildings
from .io.clouds.las import read as read
from .io.clouds.las import read_tile as read_tile
from .pipeline.config import PipelineConfig as PipelineConfig
from .pipeline.reconstruct import TileResult as TileResult
from .pipeline.reconstruct import reconstruct_tile as reconstruct_tile

__version__: str
