"""A simulated fleet as processes: one world, and one for each chair; begin with `live_fleet.py`."""
