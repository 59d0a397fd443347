"""Several chairs in one building: paths for many agents at once, and the order in which chairs go.

Begin with `order.py` for chairs on a traffic graph, and with `solving.py` for agents on a grid.
"""
