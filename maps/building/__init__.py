"""A building as a hierarchical graph: storeys, wings, rooms, doorways, lifts. Begin with `hgraph.py`."""
