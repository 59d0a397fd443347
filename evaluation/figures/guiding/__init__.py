"""Figures of guidance for drivers without sight. Begin with `blind_doors.py`."""
