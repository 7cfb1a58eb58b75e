"""A tile's key and its revisions."""

#: Stamps of tiles are multiples of this, so that there is room for a tile's revisions between them [ns].
STEP = 1_000


def tile_of(stamp: int) -> int:
    """Return the stamp of the first revision of a tile, by which it is known as a whole [ns]."""
    return stamp - stamp % STEP
