"""Planning: from a map and a goal to a path, and from a path to the next command (v, omega).

Pure functions and small data structures; begin with `route/global_planner.py` for paths and `window/dwa.py` for commands.
"""
