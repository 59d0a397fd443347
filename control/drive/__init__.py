"""One tick of a drive: obstacles by all sensors, plan, follow, pass doors, recover. Begin with `navigator.py`."""
