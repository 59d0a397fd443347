"""Several chairs in one building: the order in which chairs go, and paths for many agents at once.

Begin with `order.py` for chairs on a traffic graph, and with `solving.py` for agents on a grid. `paper/` is the node network of
the source paper.
"""
