"""Recordings become map folders, trajectories, point clouds and reports. Begin with `mapping.py`."""
