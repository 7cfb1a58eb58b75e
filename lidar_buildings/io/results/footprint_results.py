"""What given footprints add to the results: the names they have in their file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lidar_buildings.io.files.compact_json import compact_json
from lidar_buildings.io.models.cityjson import load_feature
from lidar_buildings.io.results.tile_products import Shapes

if TYPE_CHECKING:  # what reads them takes time to import
    from lidar_buildings.io.vectors.footprints import FootprintFile

#: Attribute and column that carries a footprint's name.
FOOTPRINT_ID = "footprint_id"


@dataclass(frozen=True)
class FootprintResults:
    """Names and record of the footprints of a run; of traced outlines there are neither."""

    names: Mapping[int, str] = field(default_factory=dict)  #: building id → what the file calls the footprint
    record: Mapping[str, Any] = field(default_factory=dict)  #: what ``run.json`` tells of the file

    @classmethod
    def of(cls, file: FootprintFile | None) -> FootprintResults:
        """Return what a file of footprints adds, nothing if there is none."""
        return cls() if file is None else cls(file.footprint_id, file.record)

    def __bool__(self) -> bool:
        return bool(self.record)

    def named(self, tiles: Iterable[Shapes]) -> Iterator[Shapes]:
        """
        Yield the buildings of every tile with their footprints' names, each building once.

        A footprint wider than a tile's buffer may grow is in two tiles: the first one's building counts.
        """
        seen: set[int] = set()
        for tile in tiles:
            yield self._named(tile, seen) if self else tile
            seen.update(one.building_id for one in (*tile.traced, *tile.outlines))

    def _named(self, tile: Shapes, seen: set[int]) -> Shapes:
        features = map(load_feature, tile.features)
        return Shapes(
            tuple(one for one in tile.traced if one.building_id not in seen),
            tuple(one for one in tile.outlines if one.building_id not in seen),
            tuple(self._line(feature, number) for feature, number in features if number not in seen),
        )

    def _line(self, feature: dict[str, Any], number: int) -> str:
        """Return a feature's line with the footprint's name among the attributes."""
        building = feature["CityObjects"][feature["id"]]
        attributes = building["attributes"] | {FOOTPRINT_ID: self.names.get(number, "")}
        building["attributes"] = dict(sorted(attributes.items()))
        return compact_json(feature)

    def summary(self, n_buildings: int) -> dict[str, Any]:
        """Return the record with the number of footprints that lie outside the data."""
        return {**self.record, "n_outside": self.record["n_used"] - n_buildings} if self else {}
