"""Figures of guidance for drivers who cannot see. Begin with `blind_doors.py`."""
