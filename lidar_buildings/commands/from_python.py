"""What Python calls: buildings of files, folders, bags or points, and what a run leaves on disk."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from lidar_buildings.commands.run import carry_out
from lidar_buildings.commands.run_options import UNTOLD
from lidar_buildings.commands.run_request import request_of
from lidar_buildings.core.model.errors import InputError, LidarBuildingsError, ParameterError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.models.cityjson import whole_document
from lidar_buildings.io.results.building_layers import LAYERS, STREET_LAYERS
from lidar_buildings.io.results.output_config import FORMAT_FILES
from lidar_buildings.io.results.run_folder import (
    BLOCKS,
    RUN,
    check_folder,
    files_of_run,
    remove_files,
    sole_use,
    usable,
)
from lidar_buildings.io.results.run_summary import counted

if TYPE_CHECKING:
    import geopandas

_Path = str | os.PathLike[str]
#: Columns of a tile that a file carries.
_CARRIED = (
    "intensity", "return_number", "number_of_returns", "classification", "scan_angle", "scan_direction_flag",
    "point_source_id", "gps_time", "view",
)  # fmt: skip


class Reconstruction:
    """
    A result: the files that a run wrote into `folder`, whose coordinates are the source's.

    `reconstruct` returns one; ``Reconstruction("my_result")`` opens one of ``lidar-buildings run``.
    InputError if the folder holds none.
    """

    def __init__(self, folder: _Path) -> None:
        self.folder = Path(folder)
        if not (self.folder / RUN).is_file():
            raise InputError(f"{self.folder}: contains no {RUN}: give the output folder of a finished run")
        self._temporary: TemporaryDirectory[str] | None = None

    def __repr__(self) -> str:
        n_buildings = counted(sum(self.run["buildings"].values()), "building")
        return f"<Reconstruction of {n_buildings} in {self.folder}>"

    @cached_property
    def run(self) -> dict[str, Any]:
        """The content of ``run.json``: counts, remarks, parameters, files."""
        content: dict[str, Any] = json.loads((self.folder / RUN).read_text(encoding="utf-8"))
        return content

    def to_geodataframe(self, layer: str = "outlines") -> geopandas.GeoDataFrame:
        """
        Return a layer of ``buildings.gpkg`` with its attributes and reference system.

        Layers are `outlines`, `traced`, `roof_faces`, `roof_lines` and `roof_corners`; `facades` and
        `street_lines` where walls were seen from the street. It needs geopandas. ParameterError if there is
        no such layer.
        """
        try:
            import geopandas
            import pandas
        except ImportError as error:
            raise LidarBuildingsError(f"to_geodataframe needs {error.name}: pip install geopandas") from None
        known = {*LAYERS, *STREET_LAYERS}
        if layer not in known:
            raise ParameterError(f"layer = {layer!r}: must be one of {', '.join(sorted(known))}")
        (name,) = FORMAT_FILES["gpkg"]
        whole = self.folder / name
        files = [whole] if whole.exists() else sorted(self.folder.glob(f"{BLOCKS}/*/{layer}.fgb"))
        tables = [
            geopandas.read_file(one, layer=layer)
            for one in files
            if layer in geopandas.list_layers(one)["name"].tolist()
        ]
        if not tables:
            raise ParameterError(f"layer = {layer!r}: {self.folder} has none: its run made no such layer")
        return pandas.concat(tables, ignore_index=True)

    def to_cityjson(self) -> dict[str, Any]:
        """
        Return the city model, terrain included, as one CityJSON document.

        InputError if the run wrote none, or wrote it in blocks, as it does of very many buildings.
        """
        path = self.folder / FORMAT_FILES["cityjson"][0]
        if not path.exists():
            raise InputError(f"{path}: no such file: the run wrote no CityJSON, or wrote it in {BLOCKS}/")
        with open(path, encoding="utf-8") as lines:
            return whole_document(lines)

    def write(self, folder: _Path, *, overwrite: bool = False) -> Path:
        """Copy all files into a folder, made if it is not there; OutputError if it cannot be used."""
        path = Path(folder)
        with sole_use(path), usable(path):
            check_folder(path, overwrite=overwrite)
            remove_files(path, files_of_run(path))
            shutil.copytree(self.folder, path, dirs_exist_ok=True)
        return path


def reconstruct(
    points: PointTile | ArrayLike | _Path | Iterable[_Path],
    output: _Path | None = None,
    *,
    crs: str = "",
    bounds: Sequence[float] | None = None,
    footprints: _Path | None = None,
    preset: str | None = None,
    until: str | None = None,
    overwrite: bool = False,
    processes: int = 1,
    **settings: Mapping[str, Any],
) -> Reconstruction:
    """
    Reconstruct buildings as ``lidar-buildings run`` does, without ROS: tile by tile, whatever the size.

    Parameters
    ----------
    points : path or paths, PointTile of `read`, or array of shape (n_points, 3)
        Files, folders, globs, URLs, bags; or points, an array in the coordinates of `crs`. Of paths the
        classified files keep every dimension.
    output : path, optional
        Folder for the results; without one they are deleted together with what is returned.
    crs : str
        Reference system of points that name none, such as ``"EPSG:28992"``.
    bounds : four float, optional
        West, south, east and north of the points that are wanted, in their own coordinates.
    footprints : path, optional
        File of polygons to use instead of traced outlines.
    preset, until : str, optional
        A paper's parameters; the last stage.
    overwrite : bool
        Whether earlier results in `output` may be replaced.
    processes : int
        With more than one, a script needs ``if __name__ == "__main__":``, as with `multiprocessing`.
    **settings : dict
        Parameters by stage, such as ``roof_selection={"min_height": 2.5}``.

    Returns
    -------
    Reconstruction
        What could not be done is told as a warning for each file or tile.

    Raises
    ------
    LidarBuildingsError
        InputError, OutputError, ParameterError: in one line what is wrong, why, and what to do.

    Examples
    --------
    >>> from lidar_buildings.simulation import simulate_tile
    >>> tile, truth = simulate_tile("single_house", density=2.0)
    >>> result = reconstruct(tile, roof_selection={"min_height": 2.5}, model_writer={"formats": ["gpkg"]})
    >>> result.to_geodataframe()[["roof_type", "lod"]].values.tolist()
    [['gable', '2.2']]
    >>> result.to_geodataframe("roof_faces").crs.to_string()
    'EPSG:25832'
    """
    temporary = TemporaryDirectory(prefix="lidar_buildings-")
    folder = Path(temporary.name, "result") if output is None else Path(output)
    options = {
        "input": _inputs(points, Path(temporary.name, "points.laz")),
        "output": folder,
        "crs": crs or None,
        "bounds": bounds,
        "footprints": None if footprints is None else Path(footprints),
        "set": list(_assignments(settings)),
        **{"params": None, "preset": preset, "until": until, "overwrite": overwrite},
        **{"no_ros": True, "quiet": True, "workers": 0},
    }
    chosen = argparse.Namespace(**{**UNTOLD, **options})
    request = request_of(chosen)
    with sole_use(folder):
        _, outcome = carry_out(request, chosen, processes)
    failed = (f"tile {stamp} failed: {reason}" for stamp, reason in outcome.failed.items())
    for line in (*outcome.summary.problems, *failed):
        warnings.warn(line, stacklevel=2)
    result = Reconstruction(folder)
    if output is None:
        result._temporary = temporary
    else:
        temporary.cleanup()
    return result


def _assignments(settings: Mapping[str, Mapping[str, Any]]) -> Iterable[str]:
    for stage, values in settings.items():
        if not isinstance(values, Mapping):
            raise ParameterError(
                f"{stage} = {values!r}: must be the parameters of a stage, as in "
                "roof_selection={'min_height': 2.5}"
            )
        yield from (f"{stage}.{name}={json.dumps(value, default=str)}" for name, value in values.items())


def _inputs(points: Any, path: Path) -> tuple[str, ...]:
    """Return what a run reads: the paths given, or a file of the points given."""
    if isinstance(points, (str, os.PathLike)):
        return (os.fspath(points),)
    if not isinstance(points, (PointTile, np.ndarray)):
        points = list(points)
        if all(isinstance(one, (str, os.PathLike)) for one in points):
            return tuple(map(os.fspath, points))
    from lidar_buildings.io.tiling.placed_laz import PlacedLaz

    if isinstance(points, PointTile):
        frame, xyz = points.frame, points.points
        columns = {name: value for name, value in points.columns.items() if name in _CARRIED}
    else:
        frame, xyz, columns = MapFrame(), np.asarray(points, dtype=np.float64), {}
    if xyz.ndim != 2 or xyz.shape[1] != 3 or not np.isfinite(xyz).all():
        raise ParameterError(f"points has shape {xyz.shape}: must be (n_points, 3), of finite numbers")
    file = PlacedLaz(path)
    file.place(frame)
    file.add(PlacedScan(xyz, np.zeros(len(xyz), np.int64), columns))
    file.close()
    return (str(path),)
