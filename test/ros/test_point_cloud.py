import array
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import PointCloud2, PointField

from lidar_buildings.core.model.errors import InputError, MessageError
from lidar_buildings.core.model.tile import COLUMNS, PointTile
from lidar_buildings.ros.point_cloud import cloud_message, from_message, to_message

NUMBERS = {
    PointField.INT8: "i1",
    PointField.UINT8: "u1",
    PointField.INT16: "i2",
    PointField.UINT16: "u2",
    PointField.INT32: "i4",
    PointField.UINT32: "u4",
    PointField.FLOAT32: "f4",
    PointField.FLOAT64: "f8",
}


def full_tile(n, stamp=0):
    random = np.random.default_rng(0)
    columns = {name: random.integers(0, 200, n).astype(dtype) for name, dtype in COLUMNS.items()}
    return PointTile(random.normal(scale=100, size=(n, 3)), stamp=stamp, **columns)


def cloud(fields, rows, **members):
    """A message from rows of (name, datatype code, offset), packed bytes and whatever else is given."""
    message = PointCloud2(
        height=1,
        width=len(rows),
        fields=[PointField(name=n, datatype=d, offset=o, count=1) for n, d, o in fields],
        point_step=rows.dtype.itemsize,
        row_step=rows.dtype.itemsize * len(rows),
        is_dense=True,
    )
    message.data = array.array("B", rows.tobytes())
    for name, value in members.items():
        setattr(message, name, value)
    return message


def xyz_cloud(points, dtype="<f4", **members):
    rows = np.zeros(len(points), dtype=[(name, dtype) for name in "xyz"])
    for axis, name in enumerate("xyz"):
        rows[name] = np.asarray(points)[:, axis]
    code = PointField.FLOAT64 if dtype.endswith("8") else PointField.FLOAT32
    size = np.dtype(dtype).itemsize
    return cloud([(name, code, axis * size) for axis, name in enumerate("xyz")], rows, **members)


def assert_same(left, right):
    assert np.array_equal(left.points, right.points)
    assert left.columns.keys() == right.columns.keys()
    for name, column in left.columns.items():
        assert np.array_equal(column, getattr(right, name)), name
    assert left.stamp == right.stamp


@pytest.mark.parametrize(("n", "stamp"), [(5, 1_234_567_890_123_456_789), (1, -1_500_000_001), (0, 0)])
def test_a_tile_comes_back_as_it_was_sent(n, stamp):
    tile = full_tile(n, stamp)
    assert_same(from_message(to_message(tile)).tile, tile)


def test_a_message_is_packed_little_endian_dense_and_in_one_row():
    message = to_message(full_tile(7))
    assert [field.name for field in message.fields] == ["x", "y", "z", *COLUMNS]
    ends = [field.offset + np.dtype(NUMBERS[field.datatype]).itemsize for field in message.fields]
    assert [0, *ends[:-1]] == [field.offset for field in message.fields]
    assert message.point_step == ends[-1]
    assert (message.height, message.width) == (1, 7)
    assert message.row_step == len(message.data) == 7 * message.point_step
    assert message.is_dense
    assert not message.is_bigendian
    assert message.header.frame_id == "map"


def test_a_cloud_without_points_needs_no_fields():
    assert len(from_message(PointCloud2()).tile) == 0


@st.composite
def layouts(draw):
    """
    Fields in any order, at any offset, of any type, some unknown, in either byte order, rows padded or not.
    """
    known = draw(st.lists(st.sampled_from(sorted(COLUMNS)), unique=True, max_size=6))
    unknown = draw(st.lists(st.sampled_from(["ring", "rgb", "t", "label"]), unique=True, max_size=3))
    names = draw(st.permutations(["x", "y", "z", *known, *unknown]))
    fields, offset = [], 0
    for name in names:
        code = draw(
            st.sampled_from([PointField.FLOAT32, PointField.FLOAT64] if name in "xyz" else sorted(NUMBERS))
        )
        offset += draw(st.integers(0, 5))
        fields.append((name, code, offset))
        offset += np.dtype(NUMBERS[code]).itemsize
    shape = (draw(st.integers(1, 3)), draw(st.integers(1, 4)))
    padding = draw(st.integers(0, 9)), draw(st.integers(0, 9))
    return fields, offset + padding[0], shape, padding[1], draw(st.booleans())


@settings(max_examples=60)
@given(layouts())
def test_any_layout_of_fields_is_read(layout):
    fields, point_step, (height, width), row_padding, big_endian = layout
    order = ">" if big_endian else "<"
    row_step = point_step * width + row_padding
    data = np.full(height * row_step, 0xAB, dtype=np.uint8)
    expected = {}
    for number, (name, code, offset) in enumerate(fields):
        view = np.ndarray(
            (height, width), order + NUMBERS[code], data.data, offset, strides=(row_step, point_step)
        )
        values = np.arange(height * width).reshape(height, width) + number
        view[...] = values
        expected[name] = values.reshape(-1)
    message = PointCloud2(
        height=height,
        width=width,
        point_step=point_step,
        row_step=row_step,
        is_bigendian=big_endian,
        fields=[PointField(name=n, datatype=d, offset=o, count=1) for n, d, o in fields],
    )
    message.data = array.array("B", data.tobytes())
    tile = from_message(message).tile
    assert np.array_equal(tile.points, np.column_stack([expected[name] for name in "xyz"]))
    assert set(tile.columns) == {name for name, _, _ in fields} & set(COLUMNS)
    for name, column in tile.columns.items():
        assert column.dtype == COLUMNS[name]
        assert np.array_equal(column, expected[name])


def test_values_that_our_type_cannot_hold_become_the_nearest():
    rows = np.zeros(3, dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("classification", "<f4")])
    rows["classification"] = [300.0, -1.0, np.nan]
    fields = [(n, PointField.FLOAT32, 4 * i) for i, n in enumerate(rows.dtype.names)]
    assert from_message(cloud(fields, rows)).tile.classification.tolist() == [255, 0, 0]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_points_that_are_not_finite_are_dropped_and_counted(bad):
    reading = from_message(xyz_cloud([[0, 0, 0], [1, bad, 1], [2, 2, 2]]))
    assert reading.n_dropped == 1
    assert reading.tile.points[:, 0].tolist() == [0, 2]


@pytest.mark.parametrize(("dtype", "n_bad", "times"), [("<f4", 0, 2.3), ("<f4", 1, 2.9), ("<f8", 1, 1.5)])
def test_reading_a_cloud_takes_little_more_memory_than_its_points(dtype, n_bad, times):
    points = np.random.default_rng(0).uniform(0.0, 100.0, (100_000, 3))
    points[:n_bad] = np.nan
    message = xyz_cloud(points, dtype)
    from_message(message)
    tracemalloc.start()
    tile = from_message(message).tile
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= times * len(message.data)  # float64 of float32 are two of it
    assert np.array_equal(tile.points, points[n_bad:].astype(np.float32))


def test_points_that_no_map_holds_are_left_out_and_counted_and_a_cloud_of_them_is_refused():
    reading = from_message(xyz_cloud([[0, 0, 1e300], [0, 1.88e30, 0], [np.nan, 0, 0], [0, 0, 1]], "<f8"))
    assert (len(reading.tile), reading.n_dropped, reading.n_beyond) == (1, 1, 2)
    with pytest.raises(MessageError, match="no point can be held: x or y is further than 1,049 km"):
        from_message(xyz_cloud([[0, 1.88e30, 0]]))


@pytest.mark.parametrize("name", ["x", "y", "z"])
def test_a_cloud_without_a_coordinate_is_refused_in_one_line(name):
    message = xyz_cloud([[1, 2, 3]])
    message.fields = [field for field in message.fields if field.name != name]
    with pytest.raises(InputError, match=f"^the cloud has no field {name} ") as caught:
        from_message(message)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("number", "member", "value", "words"),
    [
        (1, "datatype", PointField.INT32, "field y is int32: must be float32 or float64"),
        (2, "offset", 9, "field z ends at byte 13 of a point of 12"),
        (0, "datatype", 99, "field x has the unknown datatype 99"),
        (0, "count", 3, "field x has 3 values a point"),
    ],
)
def test_a_field_that_cannot_be_is_refused(number, member, value, words):
    message = xyz_cloud([[1, 2, 3]])
    setattr(message.fields[number], member, value)
    with pytest.raises(InputError, match=words):
        from_message(message)


@pytest.mark.parametrize("n_bytes", [0, 11, 13])
def test_data_of_the_wrong_length_are_refused(n_bytes):
    message = xyz_cloud([[1, 2, 3]])
    message.data = array.array("B", bytes(n_bytes))
    with pytest.raises(InputError, match=f"{n_bytes} bytes of data: must be"):
        from_message(message)


def test_a_row_shorter_than_its_points_is_refused():
    with pytest.raises(InputError, match="row_step is 3"):
        from_message(xyz_cloud([[1, 2, 3]], row_step=3))


def test_the_largest_number_of_a_column_is_held_whatever_float_carries_it():
    rows = np.zeros((1, 3), [(name, "<f4") for name in ("x", "y", "z", "index", "building_id")])
    rows["index"] = [1e30, 4294967296.0, -1.0]
    rows["building_id"] = [np.nan, np.inf, 7.0]
    tile = from_message(cloud_message(0, rows)).tile
    assert tile.index.tolist() == [2**32 - 1, 2**32 - 1, 0]
    assert tile.building_id.tolist() == [0, 2**32 - 1, 7]
