"""What `lidar-buildings run` does: the request, the graph or the local run, progress."""
