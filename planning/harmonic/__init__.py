"""Potential fields from Laplace's equation, their solvers, and the rubber band. Begin with `harmonic_field.py`."""
