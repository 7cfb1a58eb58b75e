"""Files that people reported, of the folder of real data: what each is to give."""

import logging

import pytest
from support.report_cases import areas_of, run_of

#: Case → words of the output, exit status, and the first areas [m²], largest last, if any.
EXPECTED = {
    "int32_clamp": (["y is the same at all points, the limit of the file's integers"], 2, []),
    "whole_metres": (["x and y and z have steps of 1 m"], 0, []),
    "web_mercator": (["EPSG:3857 is not true to scale here"], 0, [96.0, 100.0, 150.0]),
    "metres_and_feet": (["x and y are in units of 1 metre, z of 1 US survey foot"], 0, [96.0, 100.0, 150.0]),
}


@pytest.mark.slow
@pytest.mark.real_data
@pytest.mark.parametrize("name", EXPECTED)
def test_a_reported_file_gives_what_is_expected(name, data_folder, command, tmp_path, caplog):
    folder = data_folder / "reports" / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    inputs = [one for one in folder.iterdir() if one.name != "README.md"]
    words, status, areas = EXPECTED[name]
    with caplog.at_level(logging.WARNING):
        spoken = command(*run_of(tmp_path, *inputs))
    lines = [*spoken.out, *spoken.err, *caplog.messages]
    assert spoken.status == status, lines
    assert all(any(word in line for line in lines) for word in words), lines
    if areas:
        assert sorted(areas_of(tmp_path / "out"))[: len(areas)] == pytest.approx(areas, rel=0.1)
