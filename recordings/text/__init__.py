"""Laser logs as text: CARMEN, CoreSLAM and rows of ranges. Begin with `carmen.py`."""
