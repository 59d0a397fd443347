"""Rooms, corridors and doors of a mapped storey, from its occupancy grid. Begin with `floor_rooms.py`."""
