"""What diagnostics tell of a run, whoever sends them."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from lidar_buildings.io.results.run_record import RunRecord
from lidar_buildings.nodes.model_writer import note_diagnostics


def status(name, **values):
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticArray(status=[DiagnosticStatus(level=DiagnosticStatus.OK, name=name, values=pairs)])


def test_seconds_of_nodes_that_share_tiles_count_as_their_stages():
    record = RunRecord()
    share = '{"roof_selection":{"min_height":2.0},"replicas":{"replica":1}}'
    note_diagnostics(record, status("roof_selector_0", tile="1000", seconds="1.5", parameters=share))
    note_diagnostics(record, status("roof_selector_1", tile="2000", seconds="2.0", parameters=share))
    told = record.as_dict({})
    assert told["seconds"]["roof_selection"] == 3.5
    assert told["parameters"] == {"roof_selection": {"min_height": 2.0}}


@pytest.mark.parametrize(
    "values",
    [
        {"tile": "x"},
        {"parameters": "["},
        {"parameters": "[]"},
        {"parameters": '{"bags":1}'},
        {"seconds": "-"},
    ],
)
def test_what_is_no_status_of_a_tile_is_refused_and_changes_nothing(values):
    record = RunRecord()
    with pytest.raises(ValueError, match=r"\S"):
        note_diagnostics(record, status("roof_selector", **{"tile": "1000", "seconds": "1"} | values))
    assert record.as_dict({})["parameters"] == {}


def test_who_is_no_node_of_the_graph_is_not_heard():
    record = RunRecord()
    note_diagnostics(record, status("stranger", tile="1000", seconds="9"))
    assert record.as_dict({})["seconds"].keys() == {"wall"}
