"""rosbag2 (MCAP, sqlite3) and rosbag1 files, read by rosbags without any ROS installation."""
