"""The ROS 2 shell: one file per node; the only room that may import rclpy or a *_msgs package."""
