"""Scenes that score a mapper or a driving chair. Begin with `tight_places.py`."""
