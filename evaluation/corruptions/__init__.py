"""Seeded corruptions of sound recordings, and the verdict on each run of `waychair map`; begin in `drawing.py`."""
