"""Scans as points, and matching them against surfaces, near and far. Begin with `scan_matching.py`."""
