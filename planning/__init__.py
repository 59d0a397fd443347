"""Pure functions and small data structures that turn a map and a goal into a path and a (v, omega)."""
