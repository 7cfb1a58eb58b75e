"""The truth of a scene as CityJSONSeq 2.0: one LoD2.2 solid per building."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.io.files.compact_json import compact_json
from lidar_buildings.simulation.building import Building
from lidar_buildings.simulation.flight import SURVEY_DATE
from lidar_buildings.simulation.scene import VirtualScene
from lidar_buildings.simulation.shell import shell_of
from lidar_buildings.simulation.truth_layers import building_attributes

#: Coordinates are whole multiples of this [m].
SCALE = 0.001


def write_truth_city_model(path: Path, scene: VirtualScene) -> None:
    """Write the header and one feature per building, one JSON text per line."""
    path.write_text("".join(f"{line}\n" for line in city_model_lines(scene)), encoding="utf-8")


def city_model_lines(scene: VirtualScene) -> Iterator[str]:
    """Yield the lines of the CityJSONSeq."""
    yield compact_json(_header(scene))
    for building, attributes in zip(scene.buildings, building_attributes(scene), strict=True):
        yield compact_json(_feature(building, attributes))


def _header(scene: VirtualScene) -> dict[str, Any]:
    authority, code = scene.frame.crs.split(":")
    return {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [SCALE] * 3, "translate": list(scene.frame.origin)},
        "metadata": {
            "referenceSystem": f"https://www.opengis.net/def/crs/{authority}/0/{code}",
            "referenceDate": SURVEY_DATE.isoformat(),
            "title": f"True buildings of the virtual scene {scene.name}",
        },
        "CityObjects": {},
        "vertices": [],
    }


def _feature(building: Building, attributes: dict[str, Any]) -> dict[str, Any]:
    name = f"building-{building.number}"
    shell = shell_of(building)
    vertices: dict[tuple[int, ...], int] = {}
    boundary = [[_ring(ring, vertices) for ring in surface] for surface in shell.surfaces]
    kinds = [0] * len(shell.roofs) + [1] * len(shell.walls) + [2]
    solid = {
        "type": "Solid",
        "lod": "2.2",
        "boundaries": [boundary],
        "semantics": {
            "surfaces": [{"type": "RoofSurface"}, {"type": "WallSurface"}, {"type": "GroundSurface"}],
            "values": [kinds],
        },
    }
    rounded = {
        key: round(value, 4) if isinstance(value, float) else value for key, value in attributes.items()
    }
    return {
        "type": "CityJSONFeature",
        "id": name,
        "CityObjects": {name: {"type": "Building", "attributes": rounded, "geometry": [solid]}},
        "vertices": [list(vertex) for vertex in vertices],
    }


def _ring(ring: NDArray[np.float64], vertices: dict[tuple[int, ...], int]) -> list[int]:
    """Numbers of a ring's vertices, new ones appended."""
    rounded = [tuple(int(c) for c in row) for row in np.round(ring / SCALE)]
    return [vertices.setdefault(vertex, len(vertices)) for vertex in rounded]
