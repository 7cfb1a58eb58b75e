"""The names of the stages that a run may end with, in the order of the chain."""

#: Segmentation is the first half of tracing and has no name here.
STAGES = (
    "ground_filter",
    "roof_selection",
    "edge_labelling",
    "boundary_tracing",
    "regularisation",
    "plane_fitting",
    "building_model",
)
