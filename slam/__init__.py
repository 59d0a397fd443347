"""SLAM: odometry, scan matching, loop closure, pose graphs, mapper, localiser and the memory of places.

Begin with `mapper.Mapper`, which builds a map from sensor frames, and `localiser.Localiser`, which follows the chair on one.
"""
