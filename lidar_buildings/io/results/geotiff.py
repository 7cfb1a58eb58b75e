"""Cloud-optimised GeoTIFF files of one band, written block by block so that memory holds little of them."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.errors import RasterioError
from rasterio.shutil import copy
from rasterio.windows import Window

from lidar_buildings import __version__
from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.files.atomic_files import write_error
from lidar_buildings.io.files.failures import captured_stderr

#: Side of a block in cells.
BLOCK = 512
#: What stands in cells that are not known.
NODATA = -9999.0
#: A raster of more blocks than this is refused: their index alone would be 16 MB.
MOST_BLOCKS = 1_000_000
#: Overviews are left out where fewer than one block in so many holds anything: GDAL visits all the others.
_OVERVIEW_SPARSITY = 16
_PACKED = {"compress": "deflate", "predictor": 3, "SPARSE_OK": True, "BIGTIFF": "IF_SAFER"}
_FORMAT = {
    "driver": "GTiff", "count": 1, "dtype": "float32", "nodata": NODATA,
    "tiled": True, "blockxsize": BLOCK, "blockysize": BLOCK, **_PACKED,
}  # fmt: skip
#: GDAL's driver for cloud-optimised files copies what is whole: overviews first, then rows of blocks.
_CLOUD_OPTIMISED = {
    "driver": "COG", "BLOCKSIZE": BLOCK, "LEVEL": 6, "OVERVIEW_RESAMPLING": "average", **_PACKED
}  # fmt: skip
#: Effort of deflate: for what stays, and for what is to be copied.
_LEVEL, _LEVEL_OF_COPIED = 6, 1
#: GDAL would take a twentieth of the memory; an integer cache size is in bytes.
_GDAL = {"GDAL_CACHEMAX": 64_000_000}
_FAILURES = (RasterioError, OSError, RuntimeError)

# what GDAL logs of a file that cannot be written is said in the one line of the OutputError
logging.getLogger("rasterio").addFilter(lambda record: record.levelno < logging.ERROR)
logging.getLogger("rasterio._env").addFilter(lambda record: record.levelno < logging.ERROR)


@dataclass(frozen=True)
class RasterLayout:
    """What a file of elevations says of itself."""

    #: Columns and rows of cells.
    width: int
    height: int
    #: Outer corner of the north-western cell in source coordinates.
    west: float
    north: float
    cell: float  #: side of a cell in the source's horizontal unit
    crs: str  #: ``"EPSG:28992"``, a WKT text, or empty if unknown
    unit: str

    @property
    def n_blocks(self) -> int:
        """Number of blocks, empty ones too."""
        return -(-self.width // BLOCK) * -(-self.height // BLOCK)


class GeotiffWriter:
    """
    Writes one file block by block; a context, at whose end the file is complete and read back.

    An existing file is replaced. Blocks that were not written hold no data and take no room. Equal content
    gives equal bytes if blocks come in the same order. `n_known` counts the cells that are known. OutputError
    if the file cannot be written.
    """

    def __init__(self, path: Path, layout: RasterLayout, meaning: str) -> None:
        self._path, self._layout = path, layout
        self._blocks: list[Window] = []
        self.n_known = 0
        with self._reported():
            self._file = rasterio.open(
                path,
                "w",
                width=layout.width,
                height=layout.height,
                crs=layout.crs or None,
                transform=rasterio.Affine(layout.cell, 0.0, layout.west, 0.0, -layout.cell, layout.north),
                zlevel=_LEVEL if layout.n_blocks == 1 else _LEVEL_OF_COPIED,
                **_FORMAT,
            )
            self._file.set_band_description(1, meaning)
            self._file.units = (layout.unit,)
            self._file.update_tags(TIFFTAG_SOFTWARE=f"lidar_buildings {__version__}")

    def write(self, row: int, column: int, values: NDArray[np.float32]) -> None:
        """
        Write the block that begins at a row and a column, multiples of `BLOCK`; NaN becomes nodata.

        It is as large as a block, less at the raster's southern and eastern edges.
        """
        known = ~np.isnan(values)
        n_known = int(np.count_nonzero(known))
        if not n_known:
            return
        window = Window(column, row, values.shape[1], values.shape[0])
        with self._reported():
            self._file.write(np.where(known, values, np.float32(NODATA)), 1, window=window)
        self._blocks.append(window)
        self.n_known += n_known

    def __enter__(self) -> GeotiffWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file; without an error optimise and read it back."""
        with self._reported(quiet=error is not None):
            self._file.close()
        if error is None:
            with self._reported():
                self._optimise()
                self._check_complete()

    def _optimise(self) -> None:
        """Put coarser copies before the cells, each half as wide, until one block holds all."""
        if self._layout.n_blocks == 1 or self._layout.n_blocks > _OVERVIEW_SPARSITY * len(self._blocks):
            return  # without overviews any file in blocks is optimised
        optimised = self._path.with_suffix(f".cog{self._path.suffix}")
        try:
            copy(self._path, optimised, **_CLOUD_OPTIMISED)
            os.replace(optimised, self._path)
        finally:
            for left in self._path.parent.glob(f"{optimised.name}*"):
                left.unlink()

    def _check_complete(self) -> None:
        """Count the known cells again: a full disk may show no sooner."""
        with rasterio.open(self._path) as file:
            n_known = sum(
                int(np.count_nonzero(file.read(1, window=window) != np.float32(NODATA)))
                for window in self._blocks
            )
        if n_known != self.n_known:
            raise OSError(f"it holds {n_known} of {self.n_known} known cells")

    @contextmanager
    def _reported(self, *, quiet: bool = False) -> Iterator[None]:
        """Turn what fails within into one OutputError, or into nothing where there is an error already."""
        try:
            # libtiff prints what the operating system refused
            with rasterio.Env(**_GDAL), captured_stderr(lambda error: isinstance(error, _FAILURES)):
                yield
        except _FAILURES as error:
            if not quiet:
                raise _refusal(self._path, error) from error


def _refusal(path: Path, error: Exception) -> OutputError:
    """Return the error of a file that cannot be written, with the system's message where there is one."""
    code = getattr(error, "errno", None)
    return write_error(path, OSError(code, os.strerror(code)) if code else error)
