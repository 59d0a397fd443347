"""From a goal to a path cut into legs: doors, multi-point turns, leaving tight places, and the measure of a path's turns.
Begin with `global_planner.py`."""
