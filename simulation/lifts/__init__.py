"""Lifts that move: cars with sliding leaves, calls, rides and passengers. Begin with `lifts.py`."""
