"""The example notebook runs from its first cell to its last, and shows what its cells print today."""

import json

import matplotlib.pyplot as plt
import pytest
from support.source_tree import ROOT

PATH = ROOT / "examples" / "first_model.ipynb"
NOTEBOOK = json.loads(PATH.read_text(encoding="utf-8"))
CELLS = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def test_the_notebook_prints_what_is_stored_in_it(capsys):
    """`jupyter execute --inplace` stores it anew."""
    plt.switch_backend("agg")
    names = {}
    for cell in CELLS:
        exec("".join(cell["source"]), names)
        stored = (output["text"] for output in cell["outputs"] if output["output_type"] == "stream")
        assert capsys.readouterr().out == "".join(line for text in stored for line in text)
    plt.close("all")
    (house,) = names["truth"].scene.buildings
    (outline,) = names["buildings"].geometry
    assert names["buildings"].roof_type.tolist() == [house.roof_type]
    assert outline.area == pytest.approx(house.outline.area, rel=0.1)


def test_the_notebook_is_small():
    assert PATH.stat().st_size < 300_000
