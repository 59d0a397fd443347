"""Planning: from a map and a goal to a path, and from a path to the next command (v, omega).

Pure functions and small data structures; begin with `global_planner` for paths and `dwa` for commands.
"""
