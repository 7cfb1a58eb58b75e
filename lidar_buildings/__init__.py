# SPDX-License-Identifier: Apache-2.0
"""
Raw lidar in, valid 3D city models out, while the data stream in.

The names below are imported when first used: ``import lidar_buildings`` takes no time and needs no ROS.
`reconstruct` takes files or points to all files of a run; each stage alone takes arrays:

>>> import numpy as np
>>> import lidar_buildings as lb
>>> x, y = (one.ravel() for one in np.mgrid[0:40:0.5, 0:40:0.5])
>>> is_house = (abs(x - 20) <= 6) & (abs(y - 20) <= 4)
>>> points = np.column_stack([x, y, np.where(is_house, 8.0 - 0.7 * abs(y - 20), 0.0)])
>>> heights = lb.classify_ground(points).height_above_ground
>>> roofs = points[lb.select_roofs(points, height_above_ground=heights).classification == 6]
>>> traced = lb.trace_boundary(roofs)
>>> found = lb.regularise_outline(traced.outline)
>>> found.outline.exterior.round(2).tolist()
[[26.0, 24.0], [14.0, 24.0], [14.0, 16.0], [26.0, 16.0]]
>>> planes = lb.fit_roof_planes(roofs)
>>> model = lb.build_model(roofs, found.outline, plane_id=planes.plane_id, ground_elevation=0.0)
>>> model.attributes["roof_type"], sorted(model.solids)
('gable', ['1.2', '1.3', '2.2'])

"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.2.0"

#: Public name → its module, as the stub beside this file has them for type checkers.
_MODULE_OF = {
    name.name: statement.module
    for statement in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(statement, ast.ImportFrom)
    for name in statement.names
}
__all__ = ["__version__", *_MODULE_OF]


def __getattr__(name: str) -> Any:
    """Import a public name's module when the name is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, imported or not."""
    return sorted({*globals(), *_MODULE_OF})
