"""Recorded drives in and out: text logs, ROS 1 and ROS 2 bags, folders of pictures. Begin with `recording.py`."""
