"""The terrain of a result, where points of a reference are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.errors import RasterioError

from lidar_buildings.core.model.errors import InputError

_Floats = NDArray[np.float64]


def read_dtm(result: Path, points: _Floats) -> tuple[_Floats, _Floats, _Floats]:
    """
    Read the DTM of a run and where points, shape (n, 3) [m], lie in it; NaN where it is unknown.

    Returned are its elevations [m], rows and columns of the points from the first cell's middle, shape
    (n, 2), and their elevations [m]. InputError if the folder holds no DTM.
    """
    path = result / "dtm.tif"
    try:
        frame = json.loads((result / "run.json").read_text(encoding="utf-8"))["frame"]
        horizontal, vertical = float(frame["horizontal_unit"]), float(frame["vertical_unit"])
        with rasterio.open(path) as file:
            dtm = file.read(1, masked=True).astype(np.float64).filled(np.nan) * vertical
            place = file.transform
        x, y = points[:, :2].T / horizontal
    except (OSError, RasterioError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read ({error}): control needs the output folder of a run"
        ) from error
    rows, columns = (y - place.f) / place.e, (x - place.c) / place.a
    return dtm, np.column_stack([rows, columns]) - 0.5, points[:, 2]
