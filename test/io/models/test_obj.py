"""Meshes: closed, of the solids' volume, with materials and names, in local coordinates."""

import numpy as np
import pytest
import trimesh
from support import model_survey

from lidar_buildings.io.models.obj import obj_file
from lidar_buildings.io.models.survey_building import ModelHeading


def written(folder, frame=model_survey.DUTCH, buildings=None):
    """Write a survey as OBJ, and return its buildings and the path."""
    path = folder / "model.obj"
    with model_survey.survey(folder, model_survey.shapes(frame, buildings), frame=frame) as survey:
        with obj_file(path, ModelHeading(frame=frame)) as add:
            for building in survey:
                add(building)
        return list(survey), path


def offset_of(path):
    (line,) = [line for line in path.read_text().splitlines() if line.startswith("# Offset")]
    return np.array([float(c) for c in line.split(":")[1].split()])


@pytest.fixture(scope="module")
def dutch(tmp_path_factory):
    return written(tmp_path_factory.mktemp("obj"))


def meshes_of(path):
    return trimesh.load_scene(path, split_objects=True, group_material=False).geometry


def test_every_solid_is_a_closed_mesh_of_the_same_volume_the_gable_house_that_of_a_prism(dutch):
    buildings, path = dutch
    meshes = meshes_of(path)
    solid = {b.readable_id: b.solid for b in buildings if b.solid}
    assert set(meshes) == set(solid)
    assert len(solid) == 4
    for name, mesh in meshes.items():
        assert mesh.is_watertight, name
        assert mesh.is_winding_consistent
        assert mesh.volume == pytest.approx(solid[name].volume, rel=1e-6)
    (gable,) = [b.readable_id for b in buildings if b.building_id == 5]
    assert meshes_of(path)[gable].volume == pytest.approx(10 * 8 * 3 + 10 * 8 * 3 / 2)


def test_faces_have_the_material_of_their_surface_and_a_building_without_solid_is_told_of(dutch):
    _, path = dutch
    used = {line.split()[1] for line in path.read_text().splitlines() if line.startswith("usemtl")}
    known = {
        line.split()[1]
        for line in path.with_suffix(".mtl").read_text().splitlines()
        if line.startswith("newmtl")
    }
    assert used == known == {"roof", "wall", "ground"}
    assert "mtllib model.mtl\n" in path.read_text()
    (line,) = [line for line in path.read_text().splitlines() if "no solid" in line]
    assert line.startswith("# building-84980.0-447400.0:")
    assert line.endswith("no roof points")


@pytest.mark.parametrize("frame", [model_survey.DUTCH, model_survey.FEET])
def test_coordinates_with_the_offset_are_those_of_the_source(tmp_path, frame):
    buildings, path = written(tmp_path, frame, {5: model_survey.gable})
    places = np.array(
        [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")], dtype=float
    )
    assert np.abs(places).max() < 100.0
    expected = frame.to_source(buildings[0].solid.vertices)
    assert places + offset_of(path) == pytest.approx(expected, abs=1e-4)


def test_no_buildings_give_a_file_without_faces(tmp_path):
    _, path = written(tmp_path, buildings={})
    assert all(line.startswith(("#", "mtllib")) for line in path.read_text().splitlines())
    assert path.with_suffix(".mtl").is_file()
