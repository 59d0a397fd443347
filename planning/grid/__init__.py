"""Shortest paths over cells: costmap, D* Lite and its plain references. Begin with `costmap.py`."""
