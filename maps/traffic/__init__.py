"""The traffic graph of a building: where several chairs can meet, pass and step aside. Begin with `traffic_graph.py`."""
