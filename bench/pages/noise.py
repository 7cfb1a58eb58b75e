"""Draw the picture of the page on gross errors: what is found, and what is hard to tell."""

import sys
from pathlib import Path

import numpy as np

from bench.pages.drawing import plt, save
from lidar_buildings.core.stages.ground_filter.classification import classify_ground

#: Class → colour and name.
COLOURS = {
    1: ("#7f8fa6", "object"),
    2: ("#b9a57c", "ground"),
    7: ("#d0342c", "low noise"),
    18: ("#8e2fb0", "high noise"),
}
#: Half the width of the strip that a profile shows [m].
HALF_STRIP = 3.0
SIZE = 70.0


def main(picture: Path) -> None:
    """Draw a profile of every scene, its points coloured by the class found."""
    scenes = {
        "hillside: a clump, a group, a bird": hillside(),
        "town: a sheet behind a façade; the courtyard stays": town(),
        "failure: a shaft of 1.5 m is taken for an error": shaft(),
        "failure: one metre below is too near": shallow(),
    }
    figure, axes = plt.subplots(2, 2, figsize=(13.5, 7.0), dpi=75, layout="constrained")
    for panel, (title, points) in zip(axes.flat, scenes.items(), strict=True):
        classes = classify_ground(points).classification
        in_strip = np.abs(points[:, 1] - 35.0) < HALF_STRIP
        for code, (colour, label) in COLOURS.items():
            chosen = in_strip & (classes == code)
            size = 12.0 if code > 2 else 1.5
            panel.scatter(
                points[chosen, 0], points[chosen, 2], s=size, color=colour, label=label, linewidths=0
            )
        panel.set_title(title, fontsize=10)
    axes[0, 0].legend(markerscale=3, loc="upper left", fontsize=8)
    save(figure, picture)


def surface(density: float, seed: int) -> np.ndarray:
    """Level ground with 3 cm of noise."""
    random = np.random.default_rng(seed)
    xy = random.uniform(0, SIZE, (int(density * SIZE * SIZE), 2))
    return np.column_stack((xy, random.normal(0, 0.03, len(xy))))


def clump(x: float, z: float, n_points: int, radius: float, seed: int) -> np.ndarray:
    """Points round a place in the middle of the strip."""
    spread = np.random.default_rng(seed).uniform(-radius, radius, (n_points, 3))
    return np.array([x, 35.0, z]) + spread * (1.0, 1.0, 0.2)


def hillside() -> np.ndarray:
    """A slope of 40 %, with errors below it and above."""
    points = surface(4.0, 0)
    errors = np.vstack(
        (
            clump(20, -6, 40, 1.2, 1),
            clump(40, -4, 6, 0.5, 2),
            clump(52, -11, 1, 0, 3),
            clump(30, 22, 2, 0.5, 4),
        )
    )
    points = np.vstack((points, errors))
    points[:, 2] += 0.4 * points[:, 0]
    return points


def town() -> np.ndarray:
    """A block with a courtyard of 4 m, and reflections behind its façade."""
    points = surface(8.0, 5)
    block = (np.abs(points[:, 0] - 38.0) < 16.0) & (np.abs(points[:, 1] - 35.0) < 14.0)
    courtyard = (np.abs(points[:, 0] - 44.0) < 2.0) & (np.abs(points[:, 1] - 35.0) < 2.0)
    points[block & ~courtyard, 2] += 12.0
    return np.vstack((points, clump(26, -5, 50, 2.5, 6)))


def shaft() -> np.ndarray:
    """An open shaft, 1.5 m wide and 6 m deep, to whose bottom two pulses came."""
    points = surface(1.0, 7)
    inside = (np.abs(points[:, :2] - 35.0) < 0.75).all(axis=1)
    return np.vstack((points[~inside], [[34.7, 35.2, -6.0], [35.4, 34.9, -6.0]]))


def shallow() -> np.ndarray:
    """Errors 0.9 m, 1.6 m and 2.5 m below the ground."""
    return np.vstack(
        (surface(4.0, 8), *(clump(12 + 20 * k, z, 3, 0.4, k) for k, z in enumerate((-0.9, -1.6, -2.5))))
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
