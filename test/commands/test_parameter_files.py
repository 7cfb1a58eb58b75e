"""Parameter files as users and launch files write them."""

import pytest

from lidar_buildings.commands.node import check_parameter_files
from lidar_buildings.core.model.errors import InputError

#: As launch_ros writes a list of texts (yaml.dump of a tuple).
LAUNCHED = """/**/tile_player:
  ros__parameters:
    input: !!python/tuple
    - first.laz
    - second.laz
"""


def complaint(path, text):
    path.write_text(text)
    try:
        check_parameter_files(["node", "--ros-args", "--params-file", str(path)])
    except InputError as error:
        return str(error)
    return None


@pytest.mark.parametrize("text", [LAUNCHED, "", "# nothing\n", "/**:\n  ros__parameters: {rate: 1.0}\n"])
def test_files_that_ros_takes_pass(tmp_path, text):
    assert complaint(tmp_path / "good.yaml", text) is None


@pytest.mark.parametrize(
    ("text", "reason"), [("a: [", "not valid YAML"), ("- a\n- b\n", "no node names at its top")]
)
def test_files_that_ros_refuses_are_named_in_one_line(tmp_path, text, reason):
    line = complaint(tmp_path / "bad.yaml", text)
    assert str(tmp_path / "bad.yaml") in line
    assert reason in line
    assert "\n" not in line


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        check_parameter_files(["node", "--params-file", str(tmp_path / "nowhere.yaml")])
