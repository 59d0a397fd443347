"""Pose graphs as data, their optimisation, and the rejection of false loops. Begin with `graph_optimisation.py`."""
