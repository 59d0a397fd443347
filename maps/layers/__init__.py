"""Grids assembled from many scans and from several sessions. Begin with `grid_assembly.py`."""
