"""A simulated chair in real time, behind the interface of the rider's page; begin with `live_chair.py`."""
