"""Checks of a recording's messages before they are mapped: codes, units, contradictions. Begin with `plausible_scans.py`."""
