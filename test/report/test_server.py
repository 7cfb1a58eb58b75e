"""A served result: its page round any place, its files, nothing from beside it."""

import threading
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np
import pytest
from support.model_survey import DUTCH
from support.pages import Page
from support.result_folders import written_models

from lidar_buildings.cli import main
from lidar_buildings.report import contents as contents_module
from lidar_buildings.report.result_folder import read_result
from lidar_buildings.report.server import result_server


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return written_models(tmp_path_factory.mktemp("served") / "out", DUTCH)


@pytest.fixture
def address(folder):
    with result_server(folder, 0) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def _get(url):
    with urlopen(url, timeout=60) as answer:
        return answer.read()


def test_the_page_shows_the_buildings_near_the_place_that_is_asked_for(folder, address, monkeypatch):
    monkeypatch.setattr(contents_module, "MOST_BUILDINGS", 1)
    monkeypatch.setattr(contents_module, "worst_buildings", lambda *_: [])
    buildings = read_result(folder).buildings
    for one in buildings:
        x, y = one.shape.centroid.coords[0]
        for query in (f"?at={x},{y}", f"report.html?building={one.name}"):
            page = Page(_get(f"{address}/{query}").decode())
            assert page.data["facts"]["names"] == [one.name]
            assert len(page.data["dots"]) == len(buildings) - 1
            assert page.data["facts"]["is_served"]
    middle = np.median([one.shape.centroid.coords[0] for one in buildings], axis=0)
    for query in ("", "?at=here", "?at=nan,1"):
        (name,) = Page(_get(f"{address}/{query}").decode()).data["facts"]["names"]
        (shown,) = (one for one in buildings if one.name == name)
        far = [np.abs(np.subtract(one.shape.centroid.coords[0], middle)).max() for one in buildings]
        assert far[buildings.index(shown)] == min(far)


def test_files_are_served_and_nothing_beside_them(folder, address):
    assert _get(f"{address}/run.json") == (folder / "run.json").read_bytes()
    (folder.parent / "secret").write_text("no")
    for path in ("../secret", "%2e%2e/secret", "nothing"):
        with pytest.raises(HTTPError, match="404"):
            _get(f"{address}/{path}")


def test_a_port_that_is_taken_is_refused_in_one_line(folder, capsys):
    with result_server(folder, 0) as server:
        assert main(["serve", str(folder), "--port", str(server.server_port)]) == 2
    assert f"--port {server.server_port}: cannot be used" in capsys.readouterr().err
