"""The algorithms: arrays in, arrays out; no ROS, no files, no printing."""
