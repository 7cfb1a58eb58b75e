"""
Draw the picture of the page on terrain, from the simulated village, and print how good its DTM is.

    lidar-buildings simulate --output survey
    lidar-buildings run survey --output result --until roof_selection
    python -m bench.pages.terrain result doc/algorithms/terrain.png
"""

import sys
from pathlib import Path

import numpy as np
import rasterio
from matplotlib.colors import LightSource

from bench.pages.drawing import plt, save
from lidar_buildings.simulation.named_scenes import make_scene

#: Direction and height of the light of the hillshades [deg].
LIGHT = LightSource(315, 45)
#: Largest error that the colours tell apart [m].
LARGEST_ERROR = 0.3


def main(result: Path, picture: Path) -> None:
    """Draw ground, surface, heights and the error of the ground; print the error in numbers."""
    dtm, dsm, ndsm = (read(result / f"{name}.tif") for name in ("dtm", "dsm", "ndsm"))
    error = dtm - true_elevation(result / "dtm.tif")
    figure, axes = plt.subplots(2, 2, figsize=(10.4, 10.4), dpi=75, layout="constrained")
    draw_shade(axes[0, 0], dtm, "dtm.tif: the ground, four times as steep", 4.0)
    draw_shade(axes[0, 1], dsm, "dsm.tif: the surface", 1.0)
    heights = axes[1, 0].imshow(ndsm, vmin=0, vmax=15, cmap="viridis")
    figure.colorbar(heights, ax=axes[1, 0], label="[m]", shrink=0.8)
    axes[1, 0].set_title("ndsm.tif: heights above the ground")
    errors = axes[1, 1].imshow(error, vmin=-LARGEST_ERROR, vmax=LARGEST_ERROR, cmap="RdBu")
    figure.colorbar(errors, ax=axes[1, 1], label="[m]", shrink=0.8)
    axes[1, 1].set_title("dtm.tif less the true terrain")
    for one in axes.flat:
        one.set_axis_off()
    save(figure, picture)
    sys.stdout.write(in_words(error.compressed()) + "\n")


def read(path: Path) -> np.ma.MaskedArray:
    """Read a raster."""
    with rasterio.open(path) as file:
        return file.read(1, masked=True)


def true_elevation(path: Path) -> np.ndarray:
    """Return the village's terrain at the middles of a raster's cells [m]."""
    scene = make_scene("village", 0)
    with rasterio.open(path) as file:
        rows, columns = np.indices(file.shape)
        side, west, north = file.res[0], file.bounds.left, file.bounds.top
    x = west + side * (columns + 0.5) - scene.frame.origin[0]
    y = north - side * (rows + 0.5) - scene.frame.origin[1]
    return scene.terrain.at(np.column_stack((x.ravel(), y.ravel()))).reshape(rows.shape)


def draw_shade(axes: plt.Axes, elevation: np.ma.MaskedArray, title: str, exaggeration: float) -> None:
    """Draw a hillshade."""
    level = elevation.filled(float(elevation.mean()))
    axes.imshow(LIGHT.hillshade(level, dx=0.5, dy=0.5, vert_exag=exaggeration), cmap="gray")
    axes.set_title(title)


def in_words(error: np.ndarray) -> str:
    """Say how large the errors are."""
    share = 100 * np.mean(np.abs(error) < 0.1)
    return (
        f"{len(error)} cells: RMSE {np.sqrt(np.mean(error**2)):.3f} m, mean {error.mean():+.3f} m, "
        f"{share:.1f} % within 0.1 m, largest {np.abs(error).max():.2f} m"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
