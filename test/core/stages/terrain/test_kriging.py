"""Ordinary kriging against its equations, a field of known variogram, and the rasters made by it."""

import numpy as np
import pytest

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.kriging import MODELS, Variogram, fit_variogram, kriged
from lidar_buildings.core.stages.terrain.rasters import make_rasters

RANDOM = np.random.default_rng(0)
PLAN = RANDOM.uniform(0.0, 40.0, (500, 2))
PLACES = RANDOM.uniform(5.0, 35.0, (40, 2))
VERTICES = np.column_stack([PLAN, 2.0 * np.sin(PLAN[:, 0] / 7.0)])


def solved(place, variogram):
    """Covariances instead of semivariances, simple kriging of the rest beside the best mean (GLS)."""
    away, angle = VERTICES[:, :2] - place, np.arctan2(*(VERTICES[:, 1::-1] - place[::-1]).T) % (2.0 * np.pi)
    distance, sector = np.hypot(*away.T), (angle // (np.pi / 4.0)).astype(int)
    rows = [np.flatnonzero(sector == one)[np.argsort(distance[sector == one])[:2]] for one in range(8)]
    near = VERTICES[np.concatenate(rows)]
    everything = variogram.nugget + variogram.sill
    apart = np.hypot(*(near[:, None, :2] - near[None, :, :2]).transpose(2, 0, 1))
    inverse = np.linalg.inv(everything - variogram(apart))
    beside = everything - variogram(np.hypot(*(near[:, :2] - place).T))
    ones = np.ones(len(near))
    mean = ones @ inverse @ near[:, 2] / (ones @ inverse @ ones)
    of_mean = (1.0 - ones @ inverse @ beside) ** 2 / (ones @ inverse @ ones)
    return mean + beside @ inverse @ (near[:, 2] - mean), everything - beside @ inverse @ beside + of_mean


@pytest.mark.parametrize("model", MODELS)
def test_elevations_and_variances_are_those_of_the_best_linear_unbiased_estimate(model):
    variogram = Variogram(model, 0.01, 2.0, 25.0)
    found = np.column_stack(kriged(VERTICES, variogram, PLACES))
    np.testing.assert_allclose(found, [solved(place, variogram) for place in PLACES], atol=1e-8)


def test_a_vertex_is_met_without_doubt_and_far_away_the_sill_is_left():
    variogram = Variogram("spherical", 0.0, 2.0, 25.0)
    elevation, variance = kriged(VERTICES, variogram, PLAN)
    np.testing.assert_allclose(elevation, VERTICES[:, 2], atol=1e-9)
    assert variance.max() < 1e-9
    _, far = kriged(VERTICES, variogram, np.array([[500.0, 20.0], [-300.0, -300.0]]))
    assert (far >= 2.0).all()
    assert (far <= 4.0).all()  # twice the sill: beside one vertex alone


def test_the_variogram_of_a_field_is_found_again():
    random = np.random.default_rng(0)
    xy = random.uniform(0.0, 150.0, (900, 2))
    true = Variogram("exponential", 0.04, 1.0, 20.0)
    apart = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    z = np.linalg.cholesky(1.04 - true(apart)) @ random.standard_normal(len(xy))
    found = fit_variogram(np.column_stack([xy, z]))
    lags = np.array([1.0, 3.0, 10.0, 20.0, 40.0])
    # one field of 150 m scatters about the truth by about so much
    np.testing.assert_allclose(found(lags), true(lags), rtol=0.3)


def test_the_variance_grows_under_a_building_and_is_known_where_the_ground_is():
    random = np.random.default_rng(0)
    xy = random.uniform(0.0, 40.0, (6000, 2))
    z = 0.1 * xy[:, 0] + np.sin(xy[:, 1] / 8.0) + random.normal(0.0, 0.03, len(xy))
    roof = (np.abs(xy - 20.0) < 6.0).all(axis=1)
    classes = np.where(roof, PointClass.BUILDING, PointClass.GROUND)
    points = np.column_stack([xy, np.where(roof, z + 6.0, z)])
    found = make_rasters(points, classes, RasterConfig(dtm_interpolation="kriging"))
    np.testing.assert_array_equal(np.isnan(found.dtm_variance), np.isnan(found.dtm))
    middle, ground = found.dtm_variance[38:42, 38:42], found.dtm_variance[5:20, 5:20]
    assert middle.min() > 5.0 * np.median(ground)
    x, y = found.window.centres(*np.indices(found.window.shape), (0.0, 0.0)).transpose(2, 0, 1)
    off = found.dtm - (0.1 * x + np.sin(y / 8.0))
    assert np.sqrt(np.nanmean(off[28:52, 28:52] ** 2)) < 0.1
    assert make_rasters(points, classes).dtm_variance is None
