"""Dead reckoning by wheels and IMU with its uncertainty. Begin with `odometry_filter.py`."""
