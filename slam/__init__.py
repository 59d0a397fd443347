"""Sensor frames in, pose and grid out: odometry, scan matching, loop closure, pose graph, mapper, localiser."""
