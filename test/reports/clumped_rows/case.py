import numpy as np
from support.report_cases import Case

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model.spikes import spikes_of
from lidar_buildings.pipeline.reconstruct import reconstruct_tile


def case(folder, house):
    random = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(-15.0, 15.0), np.arange(-15.0, 15.0, 0.5))
    x = (x.ravel()[:, None] + random.uniform(0.0, 0.7, (x.size, 4))).ravel()
    y = np.repeat(y.ravel(), 4)
    is_roof = (np.abs(x) < 8) & (np.abs(y) < 6)
    points = np.column_stack(
        [x, y, np.where(is_roof, 10 - 0.6 * np.abs(y), 0) + random.normal(0, 0.02, x.size)]
    )

    def check():
        result = reconstruct_tile(PointTile(points, point_spacing=0.35))
        (one,) = result.models
        roof = points[is_roof]
        assert list(spikes_of(one.model.solids["2.2"], roof, 0.35)) == []

    return Case(check=check)
