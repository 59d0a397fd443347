"""Chairs and people on a traffic graph instead of on a floor: hours of a whole house in seconds. Begin with `crowd.py`."""
