"""The ROS 2 nodes of a chair, one file per node. Begin with `nodes/node.py` (common to all) and `stack.py` (the processes).

This is the only package that may import rclpy or a *_msgs package.
"""
