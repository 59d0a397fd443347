"""The running chair: localiser, pilot and drive base put together, its processes, its port for pages, and its black box.

Begin with `chair.py`, one tick of the whole chair; `drive_base.py` and `pilot.py` are its halves.
"""
