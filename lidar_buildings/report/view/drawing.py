"""Draw by Open3D, into a picture without a display or into a window."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.report.view import ABOVE, NOTHING, OF_POINTS, OF_ROOFS, SIDES
from lidar_buildings.report.view.parts import Coloured

#: Width and height of pictures and of the window [pixels].
SIZE = (1600, 1000)
#: Pictures are drawn so many times as large and then reduced, which smooths edges.
_OVERSAMPLING = 2
#: Of points and lines [pixels].
_POINT_SIZE, _LINE_WIDTH = 2.0, 1.5
_LIBRARIES = (
    "install the libraries that Open3D needs (Debian: libegl1 libgl1 libgl1-mesa-dri libgomp1 libusb-1.0-0)"
)
#: Where the eye is → its direction clockwise from north, and above the horizon [deg].
_EYES = {side: (45.0 * k, 35.0) for k, side in enumerate(SIDES)} | {ABOVE: (180.0, 89.9)}
#: Height of the cone of view, and the share of it that is filled.
_FIELD_OF_VIEW_DEG, _FILLED = 30.0, 0.98


def write_picture(path: Path, parts: Sequence[Coloured], eye: str) -> None:
    """Draw parts into a PNG or JPEG; LidarBuildingsError without Open3D, OutputError if not writable."""
    open3d = _open3d()
    image = open3d.geometry.Image(picture_of(parts, eye))
    with atomic_file(path) as temporary:
        if not open3d.io.write_image(str(temporary), image):
            raise OSError("check that the folder exists and has space")


def picture_of(parts: Sequence[Coloured], eye: str, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    """Return a picture of parts, shape (height, width, 3), without a display."""
    width, height = size
    large = (width * _OVERSAMPLING, height * _OVERSAMPLING)
    window = _open3d().visualization.Visualizer()
    with _opened(window, large, _OVERSAMPLING, is_visible=False):
        _show(window, parts)
        _look(window, parts, eye, large)
        drawn = np.asarray(window.capture_screen_float_buffer(do_render=True))
    small = drawn.reshape(height, _OVERSAMPLING, width, _OVERSAMPLING, 3).mean(axis=(1, 3))
    return np.rint(255 * small).astype(np.uint8)


def open_window(parts_of: Callable[[str, str], Sequence[Coloured]], shown: tuple[str, str], eye: str) -> None:
    """
    Show parts in a window until it is closed; M and G give models and points their next colours.

    `parts_of` gives what is drawn by the colours of roofs and of points. LidarBuildingsError if there is no
    display, or no Open3D.
    """
    open3d = _open3d()
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise LidarBuildingsError("view: no display is available: use --picture FILE")
    now = list(shown)

    def show_next(what: int, choices: Sequence[str], window: Any) -> bool:
        now[what] = choices[(choices.index(now[what]) + 1) % len(choices)]
        window.clear_geometries()
        _show(window, parts_of(*now), is_first=False)
        return True

    window, parts = open3d.visualization.VisualizerWithKeyCallback(), parts_of(*now)
    with _opened(window, SIZE, is_visible=True):
        _show(window, parts)
        _look(window, parts, eye, SIZE)
        window.register_key_callback(ord("M"), partial(show_next, 0, (*OF_ROOFS, NOTHING)))
        window.register_key_callback(ord("G"), partial(show_next, 1, (*OF_POINTS, NOTHING)))
        window.run()


def _open3d() -> Any:
    """Import Open3D, which few need, and silence it."""
    try:
        import open3d
    except ModuleNotFoundError as error:
        raise LidarBuildingsError("view: needs Open3D: pip install '.[view]' in the sources") from error
    except (ImportError, OSError) as error:  # a library of the system is missing
        raise LidarBuildingsError(f"view: Open3D cannot be loaded ({error}): {_LIBRARIES}") from error
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


@contextmanager
def _opened(window: Any, size: tuple[int, int], larger: int = 1, *, is_visible: bool) -> Iterator[None]:
    os.environ.setdefault("XDG_RUNTIME_DIR", tempfile.gettempdir())  # Mesa complains where there is none
    if not window.create_window("lidar-buildings", *size, visible=is_visible):
        raise LidarBuildingsError(f"view: nothing can be drawn without OpenGL: {_LIBRARIES}")
    try:
        options = window.get_render_option()
        options.light_on = False  # colours are shaded already
        options.point_size, options.line_width = _POINT_SIZE * larger, _LINE_WIDTH * larger
        yield
    finally:
        window.destroy_window()


def _show(window: Any, parts: Sequence[Coloured], *, is_first: bool = True) -> None:
    for part in parts:
        window.add_geometry(_geometry(part), reset_bounding_box=is_first)


def _geometry(part: Coloured) -> Any:
    open3d = _open3d()
    n, n_corners, _ = part.places.shape
    places = open3d.utility.Vector3dVector(part.places.reshape(-1, 3))
    rows = np.arange(n * n_corners, dtype=np.int32).reshape(n, n_corners)
    each = open3d.utility.Vector3dVector(part.colours)
    if n_corners == 1:
        cloud = open3d.geometry.PointCloud(places)
        cloud.colors = each
        return cloud
    if n_corners == 2:
        lines = open3d.geometry.LineSet(places, open3d.utility.Vector2iVector(rows))
        lines.colors = each
        return lines
    mesh = open3d.geometry.TriangleMesh(places, open3d.utility.Vector3iVector(rows))
    mesh.vertex_colors = open3d.utility.Vector3dVector(np.repeat(part.colours, 3, axis=0))
    return mesh


def _look(window: Any, parts: Sequence[Coloured], eye: str, size: tuple[int, int]) -> None:
    focal, extrinsic = camera_of(np.concatenate([part.places.reshape(-1, 3) for part in parts]), eye, size)
    camera = _open3d().camera.PinholeCameraParameters()
    camera.intrinsic.set_intrinsics(*size, focal, focal, size[0] / 2 - 0.5, size[1] / 2 - 0.5)
    camera.extrinsic = extrinsic
    window.get_view_control().convert_from_pinhole_camera_parameters(camera, allow_arbitrary=True)


def camera_of(places: NDArray[np.float64], eye: str, size: tuple[int, int]) -> tuple[float, NDArray[Any]]:
    """
    Put a camera as near as it sees all places, from one of `SIDES` or `ABOVE`.

    Returned are the focal length [pixels] and the matrix map frame → right, down and ahead of the camera.
    """
    azimuth, tilt = np.deg2rad(_EYES[eye])
    to_eye = np.array([np.sin(azimuth) * np.cos(tilt), np.cos(azimuth) * np.cos(tilt), np.sin(tilt)])
    right = np.array([-np.cos(azimuth), np.sin(azimuth), 0.0])
    axes = np.stack([right, np.cross(right, to_eye), -to_eye])
    turned = places @ axes.T
    focal = size[1] / 2 / np.tan(np.deg2rad(_FIELD_OF_VIEW_DEG) / 2)
    slopes = np.array(size) / 2 / focal * _FILLED
    # each of the four sides of the cone touches one place; the narrower pair says how far back it begins
    high, low = ((sign * turned[:, :2] - slopes * turned[:, 2:]).max(axis=0) for sign in (1, -1))
    camera = np.append((high - low) / 2, -((high + low) / 2 / slopes).max())
    return focal, np.block([[axes, -camera[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
