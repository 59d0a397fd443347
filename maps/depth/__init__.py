"""Depth pictures as evidence on the floor plan: ground, obstacles, drop-offs. Begin with `depth_scan.py`."""
