"""Messages of a scanner and of poses, as plain objects."""

from types import SimpleNamespace

import numpy as np

SECOND = 1_000_000_000
T0 = 1_700_000_000 * SECOND
_CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def header(stamp, frame):
    stamp = SimpleNamespace(sec=stamp // SECOND, nanosec=stamp % SECOND)
    return SimpleNamespace(seq=0, stamp=stamp, frame_id=frame)


def xyzw(numbers):
    return SimpleNamespace(**dict(zip("xyzw", map(float, numbers), strict=False)))


def cloud_of(stamp, frame, rows, **changes):
    """A cloud with a field per member of a structured array."""
    fields = [
        SimpleNamespace(
            name=n, offset=rows.dtype.fields[n][1], datatype=_CODES[rows.dtype[n].str[1:]], count=1
        )
        for n in rows.dtype.names
    ]
    step = rows.dtype.itemsize
    values = {
        "header": header(stamp, frame),
        "height": 1,
        "width": len(rows),
        "fields": fields,
        "is_bigendian": rows.dtype[0].str[0] == ">",
        "point_step": step,
        "row_step": step * len(rows),
        "data": rows.tobytes(),
        "is_dense": True,
    }
    return SimpleNamespace(**values | changes)


def scan(stamp, points, frame="lidar", seconds=None, kind="<f4", **more):
    """A cloud of points with their times since the stamp and more columns."""
    seconds = np.linspace(0.0, 0.1, len(points)) if seconds is None else seconds
    columns = dict(zip("xyz", np.asarray(points, dtype=float).reshape(-1, 3).T, strict=True))
    columns |= {"time": seconds} | more
    rows = np.zeros(len(points), [(name, kind) for name in columns])
    for name, values in columns.items():
        rows[name] = values
    return cloud_of(stamp, frame, rows)


def odometry(stamp, place, attitude=(0.0, 0.0, 0.0, 1.0), frame="odom", child="lidar"):
    pose = SimpleNamespace(position=xyzw(place), orientation=xyzw(attitude))
    still = SimpleNamespace(linear=xyzw((0, 0, 0)), angular=xyzw((0, 0, 0)))
    return SimpleNamespace(
        header=header(stamp, frame),
        child_frame_id=child,
        pose=SimpleNamespace(pose=pose, covariance=np.zeros(36)),
        twist=SimpleNamespace(twist=still, covariance=np.zeros(36)),
    )


def transforms(*edges):
    """A TFMessage of (stamp, parent, child, place) and, where there is one, the attitude."""
    return SimpleNamespace(
        transforms=[
            SimpleNamespace(
                header=header(stamp, parent),
                child_frame_id=child,
                transform=SimpleNamespace(
                    translation=xyzw(place), rotation=xyzw(attitude[0] if attitude else (0, 0, 0, 1))
                ),
            )
            for stamp, parent, child, place, *attitude in edges
        ]
    )
