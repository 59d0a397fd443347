"""What people draw on a map, and how it follows the map's nodes when the map bends. Begin with `places.py`."""
