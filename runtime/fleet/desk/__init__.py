"""The staff's desk of several chairs: what staff see, and the priorities that they give; begin with `staff_desk.py`."""
