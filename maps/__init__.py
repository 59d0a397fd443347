"""Maps: occupancy grids, distance fields, map files, and the places, zones and erased parts drawn on a map.

Begin with `grid/occupancy.py`, which makes a grid from laser scans, and `folders/map_files.py`, which saves and loads it.
"""
