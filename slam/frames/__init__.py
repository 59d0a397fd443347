"""Sensor messages become frames of one time, mounts are checked, and the first motion is found. Begin with
`frame_synchroniser.py`."""
