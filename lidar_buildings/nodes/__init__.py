"""Thin ROS 2 nodes: message to arrays, one call into the core, result to messages."""
