"""Whether the chair may drive: stops, supervisor and collision monitor. Begin with `stops.py`."""
