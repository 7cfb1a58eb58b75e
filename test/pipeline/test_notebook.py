"""The example notebook runs from its first cell to its last; no outputs are stored in it."""

import json

import matplotlib.pyplot as plt
import pytest
import shapely
from support.source_tree import ROOT

NOTEBOOK = json.loads((ROOT / "examples" / "first_model.ipynb").read_text(encoding="utf-8"))
CELLS = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def test_the_notebook_finds_the_house_that_was_scanned(capsys):
    plt.switch_backend("agg")
    names = {}
    for cell in CELLS:
        exec("".join(cell["source"]), names)
    plt.close("all")
    (building,), (house,) = names["result"].outlines, names["truth"].scene.buildings
    found, true = (shapely.Polygon(one.outline.exterior) for one in (building, house))
    assert found.intersection(true).area / found.union(true).area > 0.9
    assert f"{building.building_id} {house.roof_type} " in capsys.readouterr().out
    assert names["solid"].volume == pytest.approx(names["building"].model.attributes["volume"])


def test_the_notebook_is_stored_without_outputs():
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in CELLS)
