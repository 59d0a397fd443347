"""Several chairs in one building: the order in which chairs go, and paths for many agents at once.

Begin with `order.py` for chairs on a traffic graph, and with `solving.py` for agents on a grid. `granting.py` makes the order of a
few chairs as good as it can be, `booking.py` that of a hundred in a millisecond each. `section_plans.py` plans in the model of the
source paper, whose node network is `paper/`. `audit.py` checks a log of what was granted and done.
"""
