"""`lidar-buildings score`: one module a kind of score."""
