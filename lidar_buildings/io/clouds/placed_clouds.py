"""The clouds that a live source has written of its points, as inputs of the classified ones."""

from __future__ import annotations

from pathlib import Path

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.las import InputFile, open_cloud

#: Names of the files; number `source` by name has that source's points, row `index` by row.
PLACED_CLOUDS = "points_*.laz"


def placed_inputs(folder: Path) -> list[InputFile]:
    """
    Return a live source's clouds by name; of one that cannot be read no point is known.

    Parameters
    ----------
    folder : Path
        Where the source writes them; it need not be there.
    """
    return [InputFile(path, _point_count(path)) for path in sorted(folder.glob(PLACED_CLOUDS))]


def _point_count(path: Path) -> int:
    try:
        return open_cloud(path).point_count
    except InputError:  # said when its points are to be read
        return 0
