"""Figures of mapping, localisation and memory. Begin with `logs.py`."""
