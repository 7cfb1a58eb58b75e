"""Raw lidar in, valid 3D city models out, while the data stream in."""

__version__ = "0.1.0"
