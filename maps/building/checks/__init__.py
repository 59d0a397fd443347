"""Faults of a building's graph, each named at its place with advice. Begin with `hgraph_checks.py`."""
