"""Dead reckoning by wheels and IMU with its uncertainty, and readings that are late or begin anew. Begin with
`odometry_filter.py`."""
