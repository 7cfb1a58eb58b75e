"""Shape of every point's neighbourhood: `features` is what others call, the rest its compiled parts."""

from lidar_buildings.core.surfaces.eigenfeatures.features import EigenFeatures, eigen_features

__all__ = ["EigenFeatures", "eigen_features"]
