"""Several chairs in simulation. Begin with `fleet_drive.py` for whole chairs, and with `fleet_graph.py` for chairs on a traffic graph."""
