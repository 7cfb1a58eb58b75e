"""
Draw the picture of the page on roof topology, from the virtual roofs of the tests, and print its figures.
"""

import sys
from pathlib import Path

import numpy as np
import shapely

from bench.pages.drawing import plt, save
from bench.scenes.models import ModelScene, model_scene
from lidar_buildings.core.stages.roof_topology.result import HIP, RIDGE, VALLEY, RoofTopology
from lidar_buildings.core.stages.roof_topology.topology import find_topology

COLOURS = {RIDGE: "#c8472f", HIP: "#a03f9b", VALLEY: "#2f5f9f"}
STEP_COLOUR, OUTLINE_COLOUR = "#1d1f24", "#8d95a3"
#: Shape → what `find_topology` should call it.
KINDS = {
    "flat": "flat",
    "shed": "shed",
    "gable": "gable",
    "low_gable": "gable",
    "hip": "hip",
    "half_hip": "half-hip",
    "pyramid": "pyramid",
    "l_shape": "L",
    "t_shape": "T",
    "hipped_l": "L",
    "cross_gable": "complex",
    "double_gable": "complex",
    "dormer": "gable",
    "gable_dormer": "gable",
    "pitched_courtyard": "complex",
    "gambrel": "complex",
    "mansard": "complex",
    "sawtooth": "complex",
    "barrel": "complex",
    "step": "flat",
    "courtyard": "flat",
    "pointed_tower": "pyramid",
    "church": "complex",
}
ROTATIONS_DEG = range(0, 90, 10)


def main(picture: Path) -> None:
    """Draw hips into corners, a spire, a courtyard, wings, a dormer, a failure; print the figures."""
    figure, axes = plt.subplots(2, 3, figsize=(13.0, 8.8), dpi=80, layout="constrained")
    draw(axes[0, 0], "hip", "hips hit the corners, three lines one point")
    draw(axes[0, 1], "pitched_courtyard", "four planes meet in each corner")
    draw(axes[0, 2], "pointed_tower", "24 planes meet in one point")
    draw(axes[1, 0], "t_shape", "two valleys, a wing in the middle")
    draw(axes[1, 1], "dormer", "a dormer's step edges close with its valley")
    draw(axes[1, 2], "gable_dormer", "failure: at 2 points/m² a small dormer closes badly", density=2.0)
    save(figure, picture, 64)
    for density in (2.0, 8.0, 20.0):
        print_figures(density)


def draw(axis, name: str, title: str, density: float = 8.0) -> None:
    """Draw points by plane, and the lines found."""
    scene = model_scene(name, density=density, rotation_deg=20.0, seed=1)
    topology = topology_of(scene, density)
    axis.scatter(*scene.points[:, :2].T, c=scene.plane_id % 10, s=3, cmap="Pastel1", vmin=0, vmax=9)
    for ring in scene.outline.rings:
        axis.plot(*np.vstack([ring, ring[:1]]).T, color=OUTLINE_COLOUR, lw=1.0)
    for line in topology.intersections:
        axis.plot(*line.segment[:, :2].T, color=COLOURS[line.kind], lw=2.0)
    for step in topology.steps:
        axis.plot(*step.segment.T, color=STEP_COLOUR, lw=2.0)
    axis.set_title(f"{topology.roof_type}: {title}", fontsize=10)
    axis.set_aspect("equal")
    axis.axis("off")


def topology_of(scene: ModelScene, density: float) -> RoofTopology:
    """Find the topology of a scene with its true planes."""
    return find_topology(scene.points, scene.plane_id, scene.outline, point_spacing=density**-0.5)


def print_figures(density: float) -> None:
    """Print how well all shapes are found at a density, in nine directions each."""
    rows = [
        figures_of(model_scene(name, density=density, rotation_deg=turn, seed=turn), kind, density)
        for name, kind in KINDS.items()
        for turn in ROTATIONS_DEG
    ]
    right, angle, ridge, true, found, drawn, correct = np.array(rows).T
    print(
        f"{density:g} pts/m²: {right.mean():.3f} of the types right, planes within {angle.max():.2f}°, "
        f"ridges within {np.nanmax(ridge):.3f} m, completeness {found.sum() / true.sum():.4f}, "
        f"correctness {correct.sum() / drawn.sum():.4f}"
    )


def figures_of(scene: ModelScene, kind: str, density: float) -> tuple[float, ...]:
    """
    Return whether the type is right, the worst angle and ridge, and lengths: true, found, drawn, correct.
    """
    topology = topology_of(scene, density)
    angle = max(
        np.degrees(np.arccos(np.clip(plane.normal @ face.normal, -1.0, 1.0)))
        for plane, face in zip(topology.planes, scene.building.faces, strict=True)
    )
    true = true_lines(scene)
    drawn = shapely.MultiLineString(
        [line.segment[:, :2] for line in topology.intersections] + [step.segment for step in topology.steps]
    )
    reach = 0.5 * density**-0.5
    return (
        topology.roof_type == kind,
        angle,
        ridge_error(scene, topology),
        true.length,
        shapely.intersection(true, drawn.buffer(reach)).length,
        drawn.length,
        shapely.intersection(drawn, true.buffer(reach)).length,
    )


def true_lines(scene: ModelScene) -> shapely.Geometry:
    """Return all borders between faces of a building in plan."""
    faces = [face.polygon for face in scene.building.faces]
    borders = [
        part
        for k, face in enumerate(faces)
        for other in faces[:k]
        for part in shapely.get_parts(shapely.intersection(face, other))
        if part.geom_type == "LineString"
    ]
    return shapely.MultiLineString(borders)


def ridge_error(scene: ModelScene, topology: RoofTopology) -> float:
    """Return the largest difference in height between a true ridge and the line found over its middle [m]."""
    errors = [np.nan]
    for ridge in scene.ridges:
        middle = shapely.Point(ridge.mean(axis=0)[:2])
        lines = [line.segment for line in topology.intersections]
        nearest = min(lines, key=lambda line: shapely.distance(shapely.LineString(line[:, :2]), middle))
        plan = shapely.LineString(nearest[:, :2])
        share = shapely.line_locate_point(plan, middle, normalized=True)
        errors.append(abs((1 - share) * nearest[0, 2] + share * nearest[1, 2] - ridge[:, 2].mean()))
    return float(np.nanmax(errors)) if len(errors) > 1 else np.nan


if __name__ == "__main__":
    main(Path(sys.argv[1]))
