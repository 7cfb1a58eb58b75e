"""What became of a building: one word each, with the reason beside it in words."""

from enum import Enum


class BuildingStatus(str, Enum):
    """The worst thing that happened to a building on its way; a building is never left out."""

    #: Regularised outline and a valid solid.
    OK = "ok"
    #: The outline is the traced ring: it could not be regularised.
    TRACED_OUTLINE = "traced_outline"
    #: The building reaches the edge of the data, or is larger than the tile's buffer may grow.
    CUT_OFF = "cut_off"
    #: No solid passed the validity checks; the outline is given.
    NO_SOLID = "no_solid"
    #: Points too few or all on a line: a marker for a ring, one height at most.
    DEGENERATE = "degenerate"
    #: An unexpected error, named in the reason; the other buildings are not touched by it.
    FAILED = "failed"
