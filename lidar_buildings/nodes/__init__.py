"""One thin ROS 2 node per file: message to arrays, one call into the core, result to messages."""
