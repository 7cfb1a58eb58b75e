"""The stages applied to one tile, in their order, without ROS."""
