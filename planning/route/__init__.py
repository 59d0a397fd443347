"""From a goal to a path cut into legs: doors, multi-point turns, leaving tight places. Begin with
`global_planner.py`."""
