"""The dynamic window: the next (v, omega) within the limits of motion. Begin with `dwa.py`."""
