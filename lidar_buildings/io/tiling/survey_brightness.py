"""What a survey's intensities mean, the same for all its tiles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.recfunctions import repack_fields
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.surfaces.intensity import (
    MIN_CELL,
    IntensityScale,
    brightness_raster,
    measure_scale,
    normalised_intensity,
    strip_scales,
)
from lidar_buildings.io.tiling.survey_spacing import sample_square
from lidar_buildings.io.tiling.tile_grid import Rectangle

#: About how many points of a file tell the scales of its strips;
#: wide margin: quantiles of so many are known to 0.2 %.
MAX_SAMPLE = 100_000
#: Side of the square in the middle of a file in which modes of the ground are looked for [m], and how many
#: points it holds at least where points are few: fewer and wider cells show no modes.
SQUARE_SIDE, SQUARE_POINTS = 250.0, 100_000
#: Side of the square in the middle of that one in which the spacing is measured [m], and the fewest points
#: that tell it.
SPACING_SIDE, SPACING_POINTS = 80.0, 1000
#: Ground on which modes are looked for covers this much at least [m²];
#: wide margin: a road of 100 m fills a tenth.
MIN_GROUND_AREA = 10_000.0
#: Widest object that is told from the ground here [m];
#: wide margin: few buildings are wider, and halls only lose their own ground.
MAX_OBJECT = 60.0
#: Height above the opened surface up to which a point counts as ground here [m];
#: wide margin over the noise of a scanner.
GROUND_TOLERANCE = 0.3
#: Stands for all strips that have no scale of their own.
_OTHERS = -1
#: What tells the scale of a strip, and with its place what brightness parts dark ground from other.
_SAMPLE = ["intensity", "point_source_id", "return_number", "number_of_returns"]
_PLACED = ["x", "y", "z", *_SAMPLE]


def square_of_modes(area: Rectangle, n_points: int) -> Rectangle:
    """Return the square in the middle of a file's bounds in which the modes of its ground are looked for."""
    extent = (area.x_max - area.x_min) * (area.y_max - area.y_min)
    return sample_square(area, max(SQUARE_SIDE, math.sqrt(SQUARE_POINTS * extent / n_points)))


class SurveyBrightness:
    """
    Learns, file by file, the scale of every flight strip and what brightness parts dark ground from other.

    A strip keeps the scale of the first file that holds it, and the limit is that of the first file whose
    ground shows two modes: what was said of a strip stays true, whatever is read afterwards. `dark_limit` is
    the normalised intensity up to which ground is dark, None as long as no file has shown two modes; `scales`
    are those of strips, that of all others as of −1, if there is one.
    """

    def __init__(self) -> None:
        self.dark_limit: float | None = None
        self.scales: dict[int, IntensityScale] = {}
        self._samples: dict[int, list[NDArray[Any]]] = {}
        self._squares: dict[int, list[NDArray[Any]]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the samples of files that have not been read to their end."""
        return self.__dict__ | {"_samples": {}, "_squares": {}}

    def recall(self, dark_limit: float | None, scales: Mapping[int, tuple[float, float]]) -> None:
        """Begin with what was learnt before."""
        self.dark_limit = dark_limit
        self.scales = {strip: IntensityScale(*scale) for strip, scale in scales.items()}

    def add(
        self, source: int, first: int, records: NDArray[Any], n_points: int, square: Rectangle | None = None
    ) -> None:
        """
        Take a sample of a file's chunk, `io.tiling.spool.RECORD`, whose first point has the index `first`.

        Where a square of the map frame [m] is given the modes of the ground are looked for in it.
        """
        step = math.ceil(n_points / MAX_SAMPLE)
        self._samples.setdefault(source, []).append(repack_fields(records[-first % step :: step][_SAMPLE]))
        if square is not None and self.dark_limit is None:
            rows = np.flatnonzero(square.holds(records["x"], records["y"]))
            self._squares.setdefault(source, []).append(repack_fields(records.take(rows)[_PLACED]))

    def given(self, source: int, folder: Path) -> Path:
        """Write what was taken of a file to a folder, for another process; return the path."""
        path = folder / "samples.npz"
        kinds = {"sample": self._samples.pop(source, []), "square": self._squares.pop(source, [])}
        np.savez(path, **{name: np.concatenate(blocks) for name, blocks in kinds.items() if blocks})
        return path

    def take(self, source: int, path: Path) -> None:
        """Take what another process has taken of a file."""
        with np.load(path) as found:
            if "sample" in found:
                self._samples.setdefault(source, []).append(found["sample"])
            if "square" in found and self.dark_limit is None:
                self._squares.setdefault(source, []).append(found["square"])

    def hand_over(self, source: int, other: SurveyBrightness) -> None:
        """Give what was taken of a file to what learns of files of its kind."""
        for own, others in ((self._samples, other._samples), (self._squares, other._squares)):
            if source in own:
                others[source] = own.pop(source)

    def learn(self, source: int) -> None:
        """Measure what a file, read to its end, is the first to show."""
        samples, squares = self._samples.pop(source, []), self._squares.pop(source, [])
        if not samples:
            return
        sample = np.concatenate(samples)
        is_only = only_returns(sample)
        if not is_only.any():
            return
        found = strip_scales(sample["intensity"], sample["point_source_id"], is_only)
        self.scales = {_OTHERS: measure_scale(sample["intensity"][is_only]), **found, **self.scales}
        if squares and self.dark_limit is None:
            self._learn_limit(np.concatenate(squares))

    def _learn_limit(self, records: NDArray[Any]) -> None:
        is_only = only_returns(records)
        if not is_only.any():
            return
        points = np.stack([records[name] for name in "xyz"], dtype=np.float64, casting="safe").T
        only = points[is_only]
        away = np.abs(only - (only.min(axis=0) + only.max(axis=0)) / 2)
        middle = only[(away[:, :2] <= SPACING_SIDE / 2).all(axis=1)]
        spacing = quantised_spacing(middle if len(middle) >= SPACING_POINTS else only)
        ground = np.flatnonzero(_roughly_ground(points, max(MIN_CELL, 2 * spacing)))
        intensity, strip = records["intensity"][ground], records["point_source_id"][ground]
        normalised = normalised_intensity(intensity, strip, self.scales, self.scales[_OTHERS])
        raster = brightness_raster(points[ground], normalised, is_only[ground], spacing)
        if np.count_nonzero(raster.is_known) * raster.cell**2 >= MIN_GROUND_AREA:
            self.dark_limit = raster.dark_limit()

    def forget(self, source: int) -> None:
        """Drop the sample of a file that turned out unreadable."""
        self._samples.pop(source, None)
        self._squares.pop(source, None)

    def normalised(
        self, intensity: NDArray[np.float32], strip: NDArray[np.uint16]
    ) -> NDArray[np.float32] | None:
        """Return normalised intensities of points of some strips; None where no file has shown any scale."""
        others = self.scales.get(_OTHERS)
        return None if others is None else normalised_intensity(intensity, strip, self.scales, others)


def only_returns(records: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which points are the only return of their pulse; all are where returns are not known."""
    if not records["return_number"].any() or not records["number_of_returns"].any():
        return np.ones(len(records), dtype=bool)
    return np.asarray(records["number_of_returns"] <= 1)


def _roughly_ground(points: NDArray[np.float64], cell: float) -> NDArray[np.bool_]:
    """Tell which points lie near the lowest surface, freed of objects by one opening: roughly right."""
    column, row = (np.floor(along / cell).astype(np.int64) for along in points.T[:2])
    column -= column.min()
    row -= row.min()
    lowest = np.full((column.max() + 1, row.max() + 1), np.inf)
    np.minimum.at(lowest, (column, row), points[:, 2])
    nearest = ndimage.distance_transform_edt(np.isinf(lowest), return_distances=False, return_indices=True)
    opened = ndimage.grey_opening(lowest[tuple(nearest)], size=2 * round(MAX_OBJECT / cell / 2) + 1)
    return np.asarray(points[:, 2] <= opened[column, row] + GROUND_TOLERANCE)
