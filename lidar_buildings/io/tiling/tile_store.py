"""Points on disk by cell, which tiles take them as theirs, and what is known of their survey."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import are_held
from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.sides import ALL, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import steady_spacing
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.point_columns import (
    last_returns,
    point_columns,
    views_of_tile,
    without_empty_columns,
    xyz_of,
)
from lidar_buildings.io.tiling.spool import RECORD, Head, Pieces, Spool, order_key
from lidar_buildings.io.tiling.survey_brightness import SurveyBrightness, square_of_modes
from lidar_buildings.io.tiling.survey_spacing import expected_spacing, pulses_of, sample_square
from lidar_buildings.io.tiling.survey_views import SurveyViews
from lidar_buildings.io.tiling.tile_grid import Block, Buffer, Cell, Rectangle, TileGrid


@dataclass(frozen=True)
class KnownSurvey:
    """What all tiles of a survey share: given to a later source of the same place, its tiles are the same."""

    #: Side of the tiles, where they begin, and the width of their buffer in the east [m].
    tile_size: float
    start: float
    buffer: float
    spacing: float | None = None  #: the point spacing that they are expected to have [m]
    dark_limit: float | None = None  #: normalised intensity up to which ground is dark
    #: Flight strip → the two intensities that become 0 and the high anchor; −1 stands for all others.
    scales: dict[int, tuple[float, float]] = field(default_factory=dict)
    #: The same three of what was seen from the street.
    street_spacing: float | None = None
    street_dark_limit: float | None = None
    street_scales: dict[int, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def from_json(cls, found: dict[str, Any]) -> KnownSurvey:
        """Make it from what JSON held."""
        scales = {
            name: {int(strip): (float(low), float(high)) for strip, (low, high) in found[name].items()}
            for name in ("scales", "street_scales")
            if name in found  # earlier versions knew no views
        }
        return cls(**{**found, **scales})


class ReadPart(NamedTuple):
    """What another process has read of a file."""

    pieces: Pieces  #: where the records of each spool cell are
    samples: Path  #: what tells of intensities
    counts: NDArray[Any]  #: what tells from where strips were seen


class TileStore:
    """
    Holds all points that were read, and knows which tiles have taken them.

    The points lie by cell in `spool`, a temporary folder that is made in `temporary`. `spacing` is what tiles
    are expected to have [m]; if it is not known `learn_spacing` measures it. `brightness` is what is known of
    what intensities mean; `street_spacing` and `street_brightness` are those of what was seen from the
    street, and `views` tells what was. `view` is that of all points, unless it is unknown.
    """

    def __init__(
        self,
        grid: TileGrid,
        frame: MapFrame,
        temporary: str | Path | None,
        spacing: float | None = None,
        view: View = View.UNKNOWN,
    ) -> None:
        self.grid = grid
        self.frame = frame
        self.spool = Spool(temporary)
        self._planned: dict[Cell, int] = {}
        self._dropped: list[int] = []
        self.spacing = self.street_spacing = spacing
        self.brightness, self.street_brightness = SurveyBrightness(), SurveyBrightness()
        self.views = SurveyViews(view)

    def known(self, buffer: float) -> KnownSurvey:
        """Return what has been learnt of the survey, the width of its buffers given [m]."""
        grid, above, street = self.grid, self.brightness, self.street_brightness
        return KnownSurvey(
            grid.tile_size,
            grid.start,
            buffer,
            self.spacing,
            above.dark_limit,
            above.scales,
            self.street_spacing,
            street.dark_limit,
            street.scales,
        )

    def recall(self, known: KnownSurvey) -> None:
        """Begin with what was learnt before."""
        self.spacing, self.street_spacing = known.spacing, known.street_spacing
        self.brightness.recall(known.dark_limit, known.scales)
        self.street_brightness.recall(known.street_dark_limit, known.street_scales)

    def learn(self, source: int) -> None:
        """Learn from where a file was seen that was read to its end, and what its intensities mean."""
        self.views.learn(source)
        if self.views.of_file(source) is View.STREET:
            self.brightness.hand_over(source, self.street_brightness)
            self.street_brightness.learn(source)
        else:
            self.brightness.learn(source)

    def add(self, source: int, first: int, chunk: laspy.ScaleAwarePointRecord, cloud: Cloud) -> set[Cell]:
        """Keep a chunk of a file's points, the first of index `first`; return the tiles they lie in."""
        xyz = xyz_of(chunk)
        places = self.frame.to_map(xyz)
        held = are_held(places)
        records = np.empty(len(chunk), RECORD)
        records["x"], records["y"], records["z"] = places.T
        for name, column in point_columns(chunk).items():
            records[name] = column
        records["source"] = source
        records["index"] = np.arange(first, first + len(chunk), dtype=np.uint32)
        if not held.all():  # noise, which the classified file says
            records, xyz = records.compress(held), xyz.compress(held, axis=0)
        area = Rectangle.of_cloud(cloud)
        self.views.add(source, records, area)
        square = None if area is None else self.in_map(square_of_modes(area, cloud.point_count))
        self.brightness.add(source, first, records, cloud.point_count, square)
        cells = self.grid.cells_at(xyz[:, :2] * self.frame.horizontal_unit)
        return {self.grid.tile_of(cell) for cell in self.spool.append(cells, records)}

    def join(self, source: int, part: ReadPart) -> set[Cell]:
        """Take what another process has read of a file; return the tiles that it belongs to."""
        self.brightness.take(source, part.samples)
        self.views.take(source, part.counts)
        return {self.grid.tile_of(cell) for cell in self.spool.join(part.pieces)}

    def part(self, source: int) -> ReadPart:
        """Return what was read of a single file, for the store of another process."""
        samples = self.brightness.given(source, self.spool.folder)
        return ReadPart(self.spool.with_heads(), samples, self.views.counted(source))

    def part_of(self, cells: Iterable[Cell]) -> TileStore:
        """Return the store as if it held some cells alone: little to send."""
        part = copy(self)
        part.spool = self.spool.near(cells)
        part._planned, part._dropped = {}, list(self._dropped)
        return part

    def in_map(self, area: Rectangle) -> Rectangle:
        """Move an area from the source's position into the map frame [m]."""
        return area.moved(-self.frame.origin[0], -self.frame.origin[1])

    def count_in(self, cells: Iterable[Cell]) -> int:
        """Count the records of cells."""
        return sum(self.spool.count(cell) for cell in cells)

    def drop(self, source: int) -> None:
        """Forget the points of a file that turned out unreadable."""
        self._dropped.append(source)
        self.brightness.forget(source)
        self.views.forget(source)

    def n_waiting(self, block: Block) -> int:
        """Count the records of a block's cells that no plan has taken."""
        return sum(self.spool.count(cell) - self._planned.get(cell, 0) for cell in block.cells)

    def take_core(self, block: Block) -> dict[Cell, tuple[int, int]]:
        """Return which records of a block's cells no earlier plan has taken, and count them as taken."""
        core = {}
        for cell in block.cells:
            first, last = self._planned.get(cell, 0), self.spool.count(cell)
            if first < last:
                core[cell] = (first, last)
                self._planned[cell] = last
        return core

    def first_point(self, core: dict[Cell, tuple[int, int]]) -> Head | None:
        """Return the first core point, None if no file with such points could be read."""
        heads = (self.spool.heads(cell, *records, self._dropped) for cell, records in core.items())
        return min(chain.from_iterable(heads), default=None)

    @property
    def lacks_spacing(self) -> bool:
        """Whether a spacing is not known of which a file that was read may tell."""
        of = {View.ABOVE: self.spacing, View.STREET: self.street_spacing}
        return any(of[view] is None for view in self.views.of_files)

    def learn_spacing(self, area: Rectangle, source: int | None = None) -> None:
        """
        Measure what spacing the survey's tiles are expected to have, unless that is known already.

        It is measured in the middle of an area at the source's position [m], by one file that has been read,
        or all.
        """
        for view, name in ((View.ABOVE, "spacing"), (View.STREET, "street_spacing")):
            is_other = source is not None and self.views.of_file(source) is not view
            if getattr(self, name) is None and not is_other:
                samples = self._within(sample_square(area), source, view)
                setattr(self, name, expected_spacing(pulses_of(block) for block in samples))

    def _within(self, square: Rectangle, source: int | None, view: View) -> Iterator[NDArray[Any]]:
        """
        Read a file's records, or all, within a square at the source's position, seen from somewhere.

        Those of a cell come as one.
        """
        local = self.in_map(square)
        for cell in self.grid.cells_touching(square):
            kept = [np.empty(0, RECORD)]  # in how many pieces a cell was read must not tell
            for block in self.blocks(cell):
                views = self.views.of(block)
                inside = local.holds(block["x"], block["y"])
                if views is None:
                    inside &= view is View.ABOVE
                else:
                    inside &= (views >= View.STREET) == (view is View.STREET)
                if source is not None:
                    inside &= block["source"] == source
                kept.append(block.compress(inside))
            yield np.concatenate(kept)

    def blocks(self, cell: Cell, first: int = 0, last: int | None = None) -> Iterator[NDArray[Any]]:
        """Read a cell's records without those of dropped files."""
        for block in self.spool.blocks(cell, first, last):
            kept = block.compress(~np.isin(block["source"], self._dropped)) if self._dropped else block
            if len(kept):
                yield kept


@dataclass
class SpooledTile:
    """A tile that is ready to be read; it can be sent to another process that sees the store's folder."""

    store: TileStore
    stamp: int  #: the tile's key [ns]
    block: Block
    core: dict[Cell, tuple[int, int]]  #: spool cell → first and last (exclusive) record of its core points
    #: The strip of neighbours that comes with it, and how wide it may grow [m].
    buffer: Buffer
    max_buffer: float
    #: What was known of the survey's ground when the tile became ready, by what was seen from above and from
    #: the street.
    dark_limit: float | None = None
    street_dark_limit: float | None = None

    def area(self, buffer: Buffer) -> Rectangle:
        """Return where the points of the tile lie in the map frame, with a buffer [m]."""
        return self.store.in_map(self._area(buffer))

    @property
    def largest(self) -> Buffer:
        """The widest buffer that it may have."""
        return Buffer.largest(self.max_buffer)

    def alone(self) -> SpooledTile:
        """Return the tile without what it can never need: little to send to another process."""
        return replace(self, store=self.store.part_of(self._cells(self.largest)))

    def read(self) -> PointTile:
        """Return the tile, rows in the order of (source, index)."""
        columns = self._gathered()
        order = np.argsort(order_key(columns), kind="stable")
        for name, column in columns.items():
            columns[name] = column.take(order, axis=0)
        del order, column
        view = self.store.views.of(columns, columns["points"])
        columns["view"] = np.zeros(len(columns["view"]), np.uint8) if view is None else view
        brightness = self._normalised(columns)
        points, is_buffer = columns.pop("points"), columns.pop("buffer")
        kept = without_empty_columns(columns)
        last = last_returns(points, kept["return_number"], kept["number_of_returns"])
        expected, limit = self.store.spacing, self.dark_limit
        if view is not None:
            kept["view"], is_measured = views_of_tile(points, columns, expected)
            if not (view < View.STREET).any():
                expected, limit = self.store.street_spacing, self.street_dark_limit
            last = points.compress(is_measured, axis=0)
        spacing = steady_spacing(last, expected)
        del last
        return PointTile(
            points,
            buffer=is_buffer,
            point_spacing=spacing,
            normalised_intensity=brightness,
            dark_limit=limit,
            stamp=self.stamp,
            bounds=tuple(self.area(self.buffer)),
            frame=self.store.frame,
            **kept,
        )

    def _normalised(self, columns: dict[str, NDArray[Any]]) -> NDArray[np.float32] | None:
        """Return normalised intensities, each by the scales of its view if these are known."""
        strip, is_street = columns["point_source_id"], columns["view"] >= View.STREET
        above = self.store.brightness.normalised(columns["intensity"], strip)
        if not is_street.any():
            return above
        street = self.store.street_brightness.normalised(columns["intensity"], strip)
        if above is None or street is None:
            return street if above is None else above
        return np.where(is_street, street, above)

    def grow(self, sides: Sides = ALL) -> bool:
        """Double the buffer on some sides until it brings more points; False if the largest does not."""
        n_before, buffer = self._count(self.buffer), self.buffer
        while (wider := buffer.doubled(sides, self.store.grid.cell_size, self.max_buffer)) != buffer:
            if self._count(wider) > n_before:
                self.buffer = wider
                return True
            buffer = wider
        return False

    def _count(self, buffer: Buffer) -> int:
        return sum(len(block) for block, _ in self._blocks(buffer))

    def _area(self, buffer: Buffer) -> Rectangle:
        return self.store.grid.area_of(self.block).buffered(buffer)

    def _cells(self, buffer: Buffer) -> list[Cell]:
        return list(dict.fromkeys([*self.core, *self.store.grid.cells_touching(self._area(buffer))]))

    def _gathered(self) -> dict[str, NDArray[Any]]:
        """Read points and columns with the buffer; `buffer` is 1 for points that belong to that."""
        # room for all of the cells' records: what stays empty is never touched, so it takes no memory
        n = self.store.count_in(self._cells(self.buffer))
        names = RECORD.names[3:]
        columns = {name: np.empty(n, RECORD[name]) for name in names}
        columns |= {"points": np.empty((n, 3), np.float32), "buffer": np.empty(n, np.uint8)}
        n = 0
        for block, kind in self._blocks(self.buffer):
            rows = slice(n, n := n + len(block))
            for name in names:
                columns[name][rows] = block[name]
            for axis, name in enumerate("xyz"):
                columns["points"][rows, axis] = block[name]
            columns["buffer"][rows] = kind
        return {name: column[:n] for name, column in columns.items()}

    def _blocks(self, buffer: Buffer) -> Iterator[tuple[NDArray[Any], int]]:
        """Read the records with a buffer: (records, 0 for core points or 1)."""
        near = self.area(buffer)
        for cell in self._cells(buffer):
            first, last = self.core.get(cell, (0, 0))
            for block in self.store.blocks(cell, first, last):
                yield block, 0
            for start, end in ((0, first), (last, None)):
                for block in self.store.blocks(cell, start, end):
                    yield block.compress(near.holds(block["x"], block["y"])), 1
