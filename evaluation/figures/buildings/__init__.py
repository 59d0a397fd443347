"""Figures of buildings: rooms, graphs of floors, and journeys over storeys. Begin with `rooms.py`."""
