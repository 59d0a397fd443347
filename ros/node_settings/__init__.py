"""The parameters of each ROS node, as settings; they need no ROS. Begin with `sections.py`."""
