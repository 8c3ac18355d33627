"""A bridge between ROS 2 and tendrild: `ros2 run tendril_ros2 bridge`."""
