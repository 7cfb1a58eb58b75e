"""What tests look at in the output folder of a run."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import laspy
import numpy as np
import pyogrio

#: Files that tell of buildings.
MODELS = [
    "city_model.city.json",
    "city_model.city.jsonl",
    "city_model.dxf",
    "city_model.mtl",
    "city_model.obj",
]
RESULTS = ("buildings.gpkg", *MODELS, "dtm.tif", "dsm.tif", "ndsm.tif")


def contents(output: Path) -> dict[str, str]:
    """Return name → digest of every file whose content must not depend on how the run was laid out."""
    in_folders = [path for name in ("classified", "tiles3d") for path in sorted((output / name).glob("*"))]
    files = (*in_folders, *(output / name for name in RESULTS))
    return {path.name: hashlib.sha256(_without_day(path)).hexdigest() for path in files}


def _without_day(path: Path) -> bytes:
    """Return a file's bytes, but for the day on which a LAS file was made: tests run at midnight, too."""
    content = path.read_bytes()
    return content[:90] + bytes(4) + content[94:] if content.startswith(b"LASF") else content


def assert_complete(survey: Path, output: Path, *, min_tiles: int = 1) -> None:
    """Every point has a class and its old dimensions, every building is there once, nothing is left over."""
    run = json.loads((output / "run.json").read_text())
    assert run["n_tiles"] >= min_tiles
    assert run["n_unclassified"] == 0
    assert not (output / ".partial").exists()
    for path in sorted(survey.glob("*.laz")):
        before, after = laspy.read(path), laspy.read(output / "classified" / path.name)
        for name in set(before.point_format.dimension_names) - {"classification"}:
            np.testing.assert_array_equal(np.asarray(before[name]), np.asarray(after[name]), err_msg=name)
        assert np.isfinite(np.asarray(after["HeightAboveGround"])).all()
    assert_buildings_once(output)


def building_features(output: Path) -> list[dict]:
    """Return the features of a run's city model that are buildings; the others are the terrain's."""
    lines = (output / "city_model.city.jsonl").read_text().splitlines()[1:]
    features = [json.loads(line) for line in lines]
    return [one for one in features if one["CityObjects"][one["id"]]["type"] == "Building"]


def assert_buildings_once(output: Path) -> None:
    """Layers and models name the same buildings, each once, and no two outlines overlap."""
    import shapely

    _, _, geometry, columns = pyogrio.raw.read(
        output / "buildings.gpkg", layer="outlines", columns=["building_id"]
    )
    numbers = columns[0].tolist()
    assert len(set(numbers)) == len(numbers) > 0
    in_models = [of["CityObjects"][of["id"]]["attributes"]["building_id"] for of in building_features(output)]
    assert sorted(in_models) == sorted(numbers)
    outlines = shapely.from_wkb(geometry)
    tree = shapely.STRtree(outlines)
    pairs = tree.query(outlines, predicate="intersects")
    shared = [
        shapely.area(outlines[a] & outlines[b]) / min(outlines[a].area, outlines[b].area)
        for a, b in pairs.T
        if a < b
    ]
    assert all(share < 0.1 for share in shared), shared


def assert_rest_is_complete(survey: Path, output: Path, whole: Path, n_unclassified: int) -> None:
    """But for the points of one tile and its buildings, the results are those of an undisturbed run."""
    name = "classified/strip_01.laz"
    given = laspy.read(survey / "strip_01.laz").classification
    one, other = (laspy.read(folder / name).classification for folder in (output, whole))
    differ = np.asarray(one) != np.asarray(other)
    assert 0 < n_unclassified < len(one) / 4
    assert 0 < differ.sum() <= n_unclassified
    np.testing.assert_array_equal(np.asarray(one)[differ], np.asarray(given)[differ])
    found, expected = (building_ids(folder) for folder in (output, whole))
    assert set(found) <= set(expected)


def building_ids(output: Path) -> list[int]:
    """The numbers of a run's buildings, by their outlines."""
    columns = pyogrio.raw.read(output / "buildings.gpkg", layer="outlines", columns=["building_id"])[3]
    return columns[0].tolist()
