"""Occupancy grids: cells, evidence from scans, distances, images. Begin with `cells.py`."""
