"""Sensor messages become frames of one time, and mounts are checked. Begin with `frame_synchroniser.py`."""
