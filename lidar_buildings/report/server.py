"""A result by HTTP on this machine: its files, and its page, round a place where it is large."""

from __future__ import annotations

import math
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from lidar_buildings.io.results.output_config import REPORT_FILE
from lidar_buildings.report.contents import contents_of
from lidar_buildings.report.page_file import page_of
from lidar_buildings.report.result_folder import Result, read_result


def result_server(folder: Path, port: int) -> ThreadingHTTPServer:
    """
    Return a server of a result, for this machine alone; port 0 takes any that is free.

    InputError if the folder holds no result that can be read, OSError if the port is taken.
    """
    result = read_result(folder)
    return ThreadingHTTPServer(("127.0.0.1", port), partial(_Handler, result, directory=str(folder)))


class _Handler(SimpleHTTPRequestHandler):
    def __init__(self, result: Result, *request: object, directory: str) -> None:
        self.result = result
        super().__init__(*request, directory=directory)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        """Answer with the page, or with a file."""
        address = urlsplit(self.path)
        if address.path not in ("/", f"/{REPORT_FILE}"):
            super().do_GET()
            return
        page = page_of(contents_of(self.result, middle=self._middle(address.query), is_served=True)).encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(page)))
        self.end_headers()
        self.wfile.write(page)

    def _middle(self, query: str) -> tuple[float, float] | None:
        """Return the place that is asked for: ``at=X,Y`` in the map frame, or ``building=ID``."""
        asked = {name: values[-1] for name, values in parse_qs(query).items()}
        found = [one for one in self.result.buildings if one.name == asked.get("building")]
        if found and found[0].shape is not None:
            return found[0].shape.centroid.x, found[0].shape.centroid.y
        try:
            x, y = map(float, asked.get("at", "").split(","))
        except ValueError:
            return None
        return (x, y) if math.isfinite(x) and math.isfinite(y) else None

    def log_message(self, *_: object) -> None:
        """Say nothing: a terminal is for messages."""
