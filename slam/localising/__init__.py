"""The pose on a saved map, and finding it again after a kidnapping. Begin with `localiser.py`."""
