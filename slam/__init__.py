"""SLAM: odometry, scan matching, loop closure, pose graphs, mapper, localiser and the memory of places.

Begin with `mapping/mapper.py`, which builds a map from sensor frames, and `localising/localiser.py`, which follows the chair
on one; `drive_joining.py` joins a drive to the map of earlier ones by both.
"""
