"""One tick of a drive: plan, follow, pass doors, recover. Begin with `navigator.py`."""
